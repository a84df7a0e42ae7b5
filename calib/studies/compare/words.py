"""What a comparison says, in sentences."""

import math
from collections.abc import Iterator, Sequence

from calib.cameras import COMMON
from calib.core.number_text import figure
from calib.studies.compare.alone import NOISE, TOGETHER
from calib.studies.compare.cases import FIGURE, LENS_DRAWN, LENS_MADE, LENS_OBJECTS, PLAIN_DRAWN, WITHOUT_EFFECT
from calib.studies.compare.objects import MODELS, OBJECTS, REPROJECTION_RATIO, PaperObject
from calib.studies.compare.photographed import ALL_PHOTOS
from calib.studies.compare.results import REACH, Explanation, Results, short
from calib.studies.compare.scene import CAP_RAD

LOSES = "loses"
ALIKE = 0.03
"""Errors that differ by less than this part are called the same."""


def sentences(results: Results) -> tuple[str, ...]:
    """All of them."""
    return (*setting_words(results), *size_words(results), *source_words(results), *lens_words(results))


def setting_words(results: Results) -> Iterator[str]:
    """From where the photos are taken, and what cannot show."""
    scenes = results.comparison.scenes
    far = ", ".join(f"{name} {scene.distance_mm:g} mm" for name, scene in scenes.items())
    yield (
        f"Distances at which each object just fills the image: {far}; boards from within "
        f"{math.degrees(CAP_RAD):g} degrees of their normal, icosahedra from all sides."
    )
    yield (
        f"{', '.join(WITHOUT_EFFECT).replace('_', ' ')} cost nothing against the drawing: a wrong size only moves the "
        "cameras, and a ring's centre does not depend on its width. They are in the prints, but can explain nothing."
    )


def size_words(results: Results) -> Iterator[str]:
    """The templates' errors against the paper's medians."""
    for one in OBJECTS:
        found = results.of(one.name, FIGURE, COMMON)
        if found is None or not one.is_known:
            continue
        middle = found.middle("intersection")
        inside = middle.low <= one.intersection_mm <= middle.high
        text = "as the paper has it" if inside else f"{figure(one.intersection_mm / middle.median, 2)} times as much"
        yield (
            f"{one.name} made as {one.errors}: intersection error {figure(middle.median, 2)} mm, 95 % of "
            f"{middle.prints} prints {figure(middle.low, 2)} to {figure(middle.high, 2)}; the paper has "
            f"{one.intersection_text}: {text}."
        )
    first, second, ratio = REPROJECTION_RATIO
    pair = [results.of(name, FIGURE, COMMON) for name in (first, second)]
    if pair[0] is not None and pair[1] is not None:
        ours = pair[0].middle("reprojection").median / pair[1].middle("reprojection").median
        yield (
            f"Reprojection error of {first} over that of {second}: {figure(ours, 2)} with the templates, "
            f"{ratio:g} in the paper."
        )


def source_words(results: Results) -> Iterator[str]:
    """Which errors explain the paper's numbers, and which cannot."""
    for one in OBJECTS:
        rows = [row for row in results.explanations if row.name == one.name]
        if rows:
            yield from _source_words(one, rows)


def _source_words(one: PaperObject, rows: Sequence[Explanation]) -> Iterator[str]:
    single = sorted((row for row in rows if row.source not in (NOISE, TOGETHER)), key=lambda row: row.multiple)
    both = f"the paper's {one.intersection_text} mm and {one.reconstruction_mm:g} mm"
    fitting = [row for row in single if row.fits and row.is_within_reach]
    far = [row for row in single if row.fits and not row.is_within_reach]
    others = [row for row in single if not row.fits]
    if fitting:
        yield f"{one.name}: {both} are what one of these alone would give: {_listed(fitting)}."
    else:
        yield f"{one.name}: no single source within {REACH:g} times its template gives {both}."
    if far:
        yield f"{one.name}: would give both, but only far beyond what such prints are: {_listed(far)}."
    if others:
        yield (
            f"{one.name}: cannot be it alone, their reconstruction error being another at that intersection error: "
            f"{', '.join(_with_ratio(row) for row in others)}."
        )
    for row in rows:
        if row.source == TOGETHER and row.prints:
            fit = "both numbers" if row.fits else "the first number only"
            yield (
                f"{one.name}: all errors of {one.errors} {short(row.multiple)} times as large give {fit} "
                f"({figure(row.reconstruction_mm, 2)} mm, paper {one.reconstruction_mm:g} mm)."
            )
        if row.source == NOISE and row.prints:
            yield (
                f"{one.name}: detection noise would have to be {short(row.multiple)} times what it is, and its "
                f"reconstruction error would be {figure(row.reconstruction_mm, 2)} mm: photos average it out. "
                + ("It is not the noise." if not row.fits else "")
            )


def _listed(rows: Sequence[Explanation]) -> str:
    return ", ".join(
        f"{row.source.replace('_', ' ')} of {row.amount} ({short(row.multiple)} times the template's)" for row in rows
    )


def _with_ratio(row: Explanation) -> str:
    if not row.prints:
        return f"{row.source.replace('_', ' ')} ({row.why})"
    return f"{row.source.replace('_', ' ')} ({figure(row.reconstruction_mm, 2)} mm)"


def lens_words(results: Results) -> Iterator[str]:
    """Whether the virtual camera wins."""
    for name in LENS_OBJECTS:
        for part, made in ((LENS_DRAWN, "as drawn"), (LENS_MADE, "as made")):
            brown = [found for model in MODELS[:2] if (found := results.of(name, part, model)) is not None]
            learned = [
                found for model in (MODELS[2], ALL_PHOTOS) if (found := results.of(name, part, model)) is not None
            ]
            if not (brown and learned):
                continue
            for one in learned:
                solved = min(case.middle("intersection").median for case in brown), one.middle("intersection").median
                held = (
                    min(case.middle("held_intersection").median for case in brown),
                    one.middle("held_intersection").median,
                )
                yield (
                    f"Smooth lens, {name} {made}: {one.model} {_verdict(*solved)} in the photos it was solved from "
                    f"(intersection {figure(solved[1], 2)} mm, Brown {figure(solved[0], 2)}) and {_verdict(*held)} in "
                    f"photos held out ({figure(held[1], 2)} mm, Brown {figure(held[0], 2)}); it has rays for "
                    f"{100 * one.middle('held_share').median:.1f} % of the held-out rings and "
                    f"{100 * one.middle('image_share').median:.0f} % of the image."
                )
    yield from _price_words(results)


def _price_words(results: Results) -> Iterator[str]:
    """What the freedom costs where it is not needed."""
    for name in LENS_OBJECTS:
        plain, learned = results.of(name, PLAIN_DRAWN, COMMON), results.of(name, PLAIN_DRAWN, MODELS[2])
        if plain is not None and learned is not None:
            ours, brown = (one.middle("held_intersection").median for one in (learned, plain))
            yield (
                f"Without distortion, {name} as drawn, photos held out: virtual {_verdict(brown, ours)} "
                f"({figure(ours, 2)} mm, {COMMON} {figure(brown, 2)} mm)."
            )
    boards = [
        one
        for one in OBJECTS
        if (scene := results.comparison.scenes.get(one.name)) is not None and scene.target.is_planar
    ]
    for one in boards:
        plain, learned = results.of(one.name, FIGURE, COMMON), results.of(one.name, FIGURE, MODELS[2])
        if plain is not None and learned is not None:
            ours, brown = (case.middle("held_intersection").median for case in (learned, plain))
            verdict = _verdict(brown, ours)
            why = (
                "; one photo of the board gives its map, whose bend it takes for the lens's" if verdict == LOSES else ""
            )
            yield (
                f"Camera {results.comparison.plan.camera}, {one.name} made as {one.errors}, photos held out: virtual "
                f"{verdict} ({figure(ours, 2)} mm, {COMMON} {figure(brown, 2)} mm){why}."
            )


def _verdict(brown: float, learned: float) -> str:
    if not (math.isfinite(brown) and math.isfinite(learned)):
        return "cannot be compared"
    if abs(learned / brown - 1) < ALIKE:
        return "is level"
    return "wins" if learned < brown else LOSES
