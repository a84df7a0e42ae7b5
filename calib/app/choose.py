"""Which target to make for cameras: `design choose`, `calib.choose(field_rad=1.2, volume_mm=(1000, 1000, 500))`."""

import itertools
import math
from bisect import bisect_left
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from importlib import import_module
from shlex import quote
from typing import TYPE_CHECKING, Annotated

from calib.app.options import MAX_SIDE_PX, Seed, pair
from calib.cameras import fitted_models
from designer.base.answer import program
from designer.base.errors import InputError
from designer.base.marks import NOT_IN_FILE, Gap
from designer.base.options import option
from designer.base.units import format_mm, parse_lengths_mm, parse_quantity
from designer.base.words import figure as digits
from designer.kinds.presets import printer_templates
from designer.page.capability import capability
from designer.page.progress import Progress, unheard
from designer.page.result import Result
from designer.spec.build import BUILDS, builds_of
from designer.spec.kind import kinds
from designer.spec.options import AskedPrinting, is_required, options_of

if TYPE_CHECKING:
    from calib.studies.tolerance.forecast import Forecast, Foretold, Stage, Wish
    from designer.page.blocks import Page
    from designer.spec.spec import Job
    from designer.target import TargetGeometry

SIZES_MM = (1000, 800, 600, 500, 400, 300, 250, 200, 150, 120, 100, 80, 60, 50, 40, 30)
"""Edges, or longer sides, that are tried."""
SMALLER, MOST_SIZES = 0.72, 3
"""Of a size: the next one that is worth trying; and so many of a kind and build."""
HEIGHT = 0.7
"""Of the width of a flat target, as of a page."""
OF_BED = 1.2
"""Of its shorter side: of wider solids tiles, or halves of a core, find no room."""
DIAGONAL = 1.45
"""Of a square bed: no edge is longer."""
FAILURES = 1
"""That do not end the search for a size."""
TOO_LARGE = 0.95
"""Of the size of what a printer does not take: the next that may do."""
SPARE = 1.4
"""Of the least ring that is read: so large the rings are if that leaves enough of them."""
LINES = 7.5
"""Of a printer across a ring whose strokes are two of them; half as many are the least."""
AS_GOOD = 1.25
"""Times the least error, within which predictions are true: of what is no worse the cheapest is taken."""
ENOUGH = 1.25
"""Times what very many photos leave: more do little."""
MOST_SAID = 6
"""On a screen, of the shortlist; the page has all."""
PHOTOS = (6, 8, 10, 12, 15, 20, 25, 30, 40, 50, 60, 80, 100, 150, 200, 300, 500, 1000)
"""Numbers of them that are tried."""
WOULD_DO = (0.8, 1.25, 0.63, 1.6, 0.5, 2.0, 0.4, 2.5, 0.25, 4.0, 0.16, 6.3, 0.1, 10.0, 0.03, 30.0)
"""Times a volume that does not do."""
REMARKS = (
    "cameras stand where they just see all of the volume's front; the target is held anywhere in what they see of it, "
    "a flat one tilted by up to 45 degrees",
    "what a build comes out like is as its error template has it; your own print differs, and calib measure tells by "
    "how much: a target that was measured comes near one that is as drawn",
    "machined, engraved and other ways that no printer makes: design ways ranks them for a target",
)


@dataclass(frozen=True)
class Candidate:
    """A target that could be made."""

    kind: str
    build: str
    words: str
    command: str  # that makes it
    rings: float  # in a photo, the median
    far_radius_px: float  # of a ring that faces a camera at the volume's far end
    optics: "Foretold"  # of a target that is exactly as drawn: by the noise of the photos
    made: "Foretold"  # as this build comes out
    errors: str  # the error template that says how
    hours: Gap  # of work, nan: not known; by the error template's law, of the recommended one as `design` estimates
    price_eur: Gap  # likewise
    photos: Gap = math.nan  # that reach the goal, or from which on more do little; nan: none do, or not worked out
    faults: tuple[str, ...] = ()  # why nobody should print it so, if that was estimated

    @property
    def named(self) -> str:
        """As in `board of 200 x 140 mm, tiles`."""
        return f"{self.words}, {self.build}"

    @property
    def error(self) -> float:
        """What it is ranked by: px over the image of one camera, mm in space of several."""
        return self.made.image_px if math.isnan(self.made.point_mm) else self.made.point_mm

    def sentence(self, about: str = "") -> str:
        """What it comes to and takes, in a line; `about`: hours and price are by a law, not for the printer."""
        drawn = replace(self, made=self.optics).error_words
        takes = f"{about}{digits(self.hours, 2)} h, {digits(self.price_eur, 2)} EUR"
        faults = "".join(f", {one}" for one in self.faults)
        return (
            f"{self.error_words} as it is made ({drawn} as drawn), {round(self.rings)} rings a photo, {takes}{faults}"
        )

    @property
    def error_words(self) -> str:
        """The same with its unit."""
        return f"{digits(self.error, 2)} {'px' if math.isnan(self.made.point_mm) else 'mm'}"


@dataclass(frozen=True, eq=False, repr=False)
class TargetChoice(Result, kind="choice", title="Choice of a target", doing="looking at targets"):
    """Targets that could be made, the recommended one first: `found.shortlist[0].command`, `found.is_reached`."""

    program: str
    settings: dict[str, str]
    cameras: int
    model: str
    distance_mm: tuple[float, float]  # from a camera to the volume's front and back
    photos: int  # of each camera
    goal_px: Gap  # that 95 % of the image is to stay within; nan: none was given
    shortlist: tuple[Candidate, ...]  # of each kind and build one, the recommended first
    others: tuple[Candidate, ...]  # sizes of these
    reason: str  # why the first one
    remarks: tuple[str, ...]
    stage: Annotated["Stage", NOT_IN_FILE]
    geometry: Annotated["TargetGeometry", NOT_IN_FILE]  # of the first
    forecast: Annotated["Forecast", NOT_IN_FILE]

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self.shortlist[0].named}, {self.shortlist[0].sentence()}>"

    @property
    def is_reached(self) -> bool:
        """Whether the recommended one reaches the goal as it is made, if one was given."""
        return not self.shortlist[0].made.image_px > self.goal_px

    @property
    def is_negative(self) -> bool:
        """Whether it does not."""
        return not self.is_reached

    def page(self) -> "Page":
        """The recommended one, what the others come to, and a few of its photos."""
        from calib.app.plan_page import choice_page

        return choice_page(self)

    def words(self, page: "Page | None" = None) -> "Page":
        """The answer, the table, and the command."""
        from designer.page.blocks import Facts, Page

        told = self.page() if page is None else page
        rows = tuple((one.named, one.sentence("about " * (k > 0))) for k, one in enumerate(self.shortlist[:MOST_SAID]))
        return Page("", "", told.headline, (), lead=(Facts(rows),), next_steps=told.next_steps)


@dataclass(frozen=True, eq=False)
class _Ranked:
    """A candidate with what it is worked out from."""

    told: Candidate
    job: "Job"
    geometry: "TargetGeometry"
    forecast: "Forecast"
    way: int  # of the forecast's


def _euros(text: str) -> float:
    return parse_quantity(text, {"": 1.0, "EUR": 1.0, "€": 1.0}, "a price such as 20EUR", 1e6)


@capability
def choose(
    *,
    field_rad: Annotated[
        float, option("what a camera sees from left to right: 70deg", math.radians(5), math.radians(175))
    ],
    volume_mm: Annotated[
        tuple[float, float, float],
        option(
            "width, height and depth of where the target is held: 1x1x0.5m", 10.0, 10_000.0,
            parse=partial(parse_lengths_mm, count=3), metavar="WxHxD",
        ),
    ],
    cameras: Annotated[int, option("how many, 30 degrees apart on an arc around the volume", 1, 24)] = 1,
    image_size: Annotated[
        tuple[int, int], option("of the photos: 1920x1200", parse=partial(pair, most=MAX_SIDE_PX), metavar="TEXT")
    ] = (1920, 1200),
    model: Annotated[
        str | None, option("that is solved (default: by the field opencv or fisheye)", names=fitted_models)
    ] = None,
    photos: Annotated[int, option("of each camera", PHOTOS[0], PHOTOS[-1])] = 30,
    printer: Annotated[
        str | None, option("printer template, or a TOML file of your own", complete=printer_templates)
    ] = None,
    budget_eur: Annotated[
        float | None, option("what it may cost: 20EUR", 0.01, 1e6, flag="--budget", parse=_euros, metavar="PRICE")
    ] = None,
    goal_px: Annotated[
        float | None, option("what 95 % of the image is to stay within (1 sigma): the cheapest that does", 1e-4, 100)
    ] = None,
    seed: Seed = 1,
    progress: Progress = unheard,
) -> TargetChoice:  # fmt: skip
    """Recommend a target by what cameras will be known to: `choose(field_rad=1.2, volume_mm=(800, 800, 400))`.

    Its kind, size and build. Photos of each candidate are simulated in the volume. Their information predicts the
    calibration; what the build comes out like, as its error template has it, is added. The exit code is 1 if none
    reaches the goal.

    >>> found = calib.choose(field_rad=1.2, volume_mm=(800, 800, 400), goal_px=0.5)
    >>> found.shortlist[0].command, found.shortlist[0].made.image_px

    Raises:
        InputError: options that break a rule, or a volume that no target is large or small enough for.
    """
    from calib.studies.tolerance.forecast import Wish, stage_of
    from designer.kinds.sizing import printer_of

    asked = {} if printer is None else {"printer": printer}
    printer_of(AskedPrinting(printer=printer))  # which refuses what is none
    wish = Wish(cameras, field_rad, volume_mm, image_size, model, seed)
    stage, tried = stage_of(wish), list(_tried(wish, photos, asked, progress))
    if not tried:
        raise InputError(_why_nothing(wish, asked))
    progress("working out what they cost", 0, 0)
    most_eur = math.inf if budget_eur is None else budget_eur
    shortlist, reason = _recommended([one for one in tried if not one.told.price_eur > most_eur], goal_px, most_eur)
    if not shortlist:
        least = min(one.told.price_eur for one in tried)
        raise InputError(f"--budget {budget_eur:g}EUR: a target that would do costs {digits(least, 2)}EUR or more")
    first, told = shortlist[0], tuple(replace(one.told, photos=_photos(one, goal_px)) for one in shortlist)
    shown = {one.command for one in told}
    others = sorted((one.told for one in tried if one.told.command not in shown), key=lambda one: one.error)
    return TargetChoice(
        program=program(),
        settings={
            "field": f"{math.degrees(field_rad):g}deg", "volume": format_mm(*volume_mm),
            "image size": "x".join(map(str, image_size)), "printer": first.job.printing.printer.name,
            "seed": str(seed), **({} if budget_eur is None else {"budget": f"{budget_eur:g}EUR"}),
        },
        cameras=cameras, model=stage.camera.model, distance_mm=stage.distance_mm, photos=photos,
        goal_px=math.nan if goal_px is None else goal_px,
        shortlist=told, others=tuple(others), reason=reason, remarks=REMARKS, stage=stage, geometry=first.geometry,
        forecast=first.forecast,
    )  # fmt: skip


def _tried(wish: "Wish", photos: int, asked: "dict[str, str]", progress: Progress) -> Iterator[_Ranked]:
    """All candidates that are read in the volume."""
    from calib.studies.tolerance.forecast import forecast, stage_of
    from designer.kinds.board_cuts import ring_pieces
    from designer.tolerance.effort import size_of
    from designer.tolerance.error_file import error_model

    stage, alike = stage_of(wish), dict[str, "list[tuple[Job, str, str, TargetGeometry]]"]()
    for job, line in _jobs(wish, asked):
        drawn, way = job.target.lay_out(), job.printing.way
        cut = ring_pieces(drawn, job.printing.printer, 1.0) if way.is_in_parts else None
        if errors := way.errors_of(drawn.form, drawn.face_count):
            made = replace(drawn, build=way.name, ring_piece=cut)
            alike.setdefault(drawn.geometry_id, []).append((job, line, errors, made))
    for number, same in enumerate(alike.values()):
        progress("looking at targets", number, len(alike))
        ahead = forecast(stage, [(made, error_model(errors)) for _, _, errors, made in same])
        if ahead is not None:
            optics = ahead.optics(photos)
            for row, (job, line, errors, made) in enumerate(same):
                model, size = error_model(errors), size_of(made)
                hours, price = (math.nan if one is None else one.of(size) for one in (model.hours, model.price))
                px = stage.radius_px(job.target.ring_diameter_mm / 2)
                told = Candidate(
                    job.target.kind, job.printing.build, job.target.words, line, ahead.rings, px, optics,
                    ahead.made(photos, row), errors, hours, price,
                )  # fmt: skip
                yield _Ranked(told, job, made, ahead, row)


def _jobs(wish: "Wish", asked: "dict[str, str]") -> "Iterator[tuple[Job, str]]":
    """Targets that can be made, and turned in the volume, with rings that are large enough at its end.

    With the command lines that make them; of each kind and build the largest and some smaller ones.
    """
    from calib.studies.tolerance.forecast import stage_of
    from designer.kinds.sizing import printer_of

    machine = printer_of(AskedPrinting(printer=asked.get("printer")))
    seen_mm, least = stage_of(wish).least_ring_mm, LINES * machine.line_width_mm
    good = SPARE * seen_mm
    sizes = {max(good, least), max(seen_mm, least), max(seen_mm, least / 2)}
    rings = [{"ring_diameter": format_mm(math.ceil(2 * one) / 2)} for one in sorted(sizes, reverse=True)]
    for kind in kinds():
        options, name = options_of(kind.asked), next(iter(kind.spec.extent), "")
        takes = options[name].value if name in options else ""
        more = {one for one in options if is_required(kind.asked, one)} - {name}
        if kind.spec.is_graded or more or takes not in ("length above 0", "size"):
            continue  # it tells the printer, or is made of more than a size
        usual, *_ = every = builds_of(kind.spec.form)
        builds = [build for build in every if BUILDS[build].ink != "recessed"]  # whose hours of painting are not known
        for build in builds:
            way, largest_mm, found, failed = BUILDS[build], min(wish.volume_mm[:2]), 0, 0
            if way.has_body and not (way.is_in_parts and kind.spec.form == "plate"):
                largest_mm = min(largest_mm, DIAGONAL * min(machine.bed_mm[:2]))
            for size_mm in map(float, SIZES_MM):
                if size_mm > largest_mm or found == MOST_SIZES or failed > FAILURES:
                    continue
                lengths = (size_mm, round(HEIGHT * size_mm, -1)) if takes == "size" else (size_mm,)
                values = {name: format_mm(*lengths), **({} if build == usual else {"build": build}), **asked}
                tried = ((each, _sized({"kind": kind.name, **values, **each})) for each in rings)
                each, job = next((one for one in tried if one[1] is not None), ({}, None))
                failed = failed + 1 + found if job is None else 0  # of smaller ones the rings are too large
                room = 0.0 if job is None else _room(job, wish)
                if job is not None and room >= 1:
                    words = (f"--{key.replace('_', '-')} {quote(text)}" for key, text in {**values, **each}.items())
                    yield job, f"design {kind.name} {' '.join(words)}"
                    found += 1
                largest_mm = min(SMALLER if room >= 1 else room or 1.0, 1.0) * size_mm


def _sized(values: "dict[str, str]") -> "Job | None":
    """What is asked for with all sizes; None: there is no such target, or the process does not make it."""
    from designer.kinds.sizing import size_job
    from designer.kinds.spec_file import parse_spec

    try:
        return size_job(parse_spec(values, "")).job
    except InputError:
        return None


def _room(job: "Job", wish: "Wish") -> float:
    """How many times as large it may be to be turned in the volume and made; less than 1 if it is too large."""
    from designer.target import bounding_radius_mm

    target, printer, way = job.target.lay_out(), job.printing.printer, job.printing.way
    room_mm = min(wish.volume_mm[:2])
    if way.is_in_parts and not target.is_plate:
        room_mm = min(room_mm, OF_BED * min(printer.bed_mm[:2]))
    printability = import_module("designer.make.printability")  # which this command of `design` alone asks
    is_made = not printability.check_printability(target, job.printing).violations
    return min(room_mm / (2 * bounding_radius_mm(target)), math.inf if is_made else TOO_LARGE)


def _why_nothing(wish: "Wish", asked: "dict[str, str]") -> str:
    """What is in the way, and which volume would do."""
    from calib.studies.tolerance.forecast import stage_of

    stage, said = stage_of(wish), ""
    for times in WOULD_DO:
        width, height, depth = (float(f"{times * length:.2g}") for length in wish.volume_mm)
        if next(_jobs(replace(wish, volume_mm=(width, height, depth)), asked), None):
            said = f"; --volume {format_mm(width, height, depth)} would do{', or more pixels' * (times < 1)}"
            break
    near, far = (f"{one:.0f}" for one in stage.distance_mm)
    return (
        f"--volume {format_mm(*wish.volume_mm)}: no target that can be made, and turned in it, has rings of "
        f"{digits(stage.least_ring_mm, 2)} mm, which are still read {near} to {far} mm away{said}"
    )


def _shortlist(tried: Sequence[_Ranked], goal_px: float | None) -> list[_Ranked]:
    """Of each kind and build the size to take, the surest first: the smallest that reaches the goal, or is as sure.

    With a goal that none of these sizes reaches, it is the one that comes nearest.
    """
    from designer.target import bounding_radius_mm

    groups = dict[tuple[str, str], list[_Ranked]]()
    for one in tried:
        groups.setdefault((one.told.kind, one.told.build), []).append(one)
    chosen = []
    for some in groups.values():
        reach = [one for one in some if goal_px is not None and one.told.made.image_px <= goal_px]
        if goal_px is None:
            least = min(one.told.error for one in some)
            fine = [one for one in some if one.told.error <= AS_GOOD * least]
        else:
            fine = reach or [min(some, key=lambda one: one.told.made.image_px)]
        chosen.append(min(fine, key=lambda one: bounding_radius_mm(one.geometry)))
    return sorted(chosen, key=lambda one: one.told.error)


def _estimated(one: _Ranked) -> _Ranked | None:
    """With hours, price and faults as `design` estimates them for the printer; None: it cannot be made after all."""
    if not one.job.printing.way.has_body:
        return one
    takes = import_module("designer.app.costs").build_costs(one.job)
    if takes is None:
        return None
    hours, price = takes.estimate.time_s / 3600, takes.estimate.price
    if takes.estimate.filament.currency != "EUR":  # of the printer's file, and nobody knows the rate
        price = one.told.price_eur
    return replace(one, told=replace(one.told, hours=hours, price_eur=price, faults=takes.faults))


def _photos(one: _Ranked, goal_px: float | None) -> float:
    """So many reach the goal or, without one, come near what very many would; nan: none do."""

    def error(photos: int) -> float:
        told = replace(one.told, made=one.forecast.made(photos, one.way))
        return told.error if goal_px is None else told.made.image_px

    wanted = ENOUGH * error(PHOTOS[-1]) if goal_px is None else goal_px
    row = bisect_left(PHOTOS, True, key=lambda photos: error(photos) <= wanted)
    return float(PHOTOS[row]) if row < len(PHOTOS) else math.nan


def _recommended(tried: Sequence[_Ranked], goal_px: float | None, most_eur: float) -> tuple[list[_Ranked], str]:
    """The shortlist, the one to make first, and why it is that one; what cannot be made or paid is left out.

    Nobody should make what has faults, so that it is recommended only where all others have some, too.
    """
    left, fine = list(tried), set[str]()
    while True:
        some = _shortlist(left, goal_px)
        sound = [one for one in some if not one.told.faults] or some
        if not sound:
            return [], ""
        first, reason = _best(sound, goal_px)
        if first.told.command in fine:
            others = (one.told for one in some if one.told.kind != first.told.kind)
            for other in itertools.islice(others, 1):
                reason += f"; of other kinds {other.named} comes to {other.error_words}"
            return [first, *(one for one in some if one is not first)], reason
        fine.add(first.told.command)
        told = _estimated(first)
        rest = [one for one in left if one is not first]
        left = rest if told is None or told.told.price_eur > most_eur else [*rest, told]


def _best(sound: Sequence[_Ranked], goal_px: float | None) -> tuple[_Ranked, str]:
    """The one to make of a shortlist, and why."""

    def price(one: _Ranked) -> float:
        return math.inf if math.isnan(one.told.price_eur) else one.told.price_eur

    surest = min(sound, key=lambda one: one.told.error)
    if goal_px is None:
        first = min((one for one in sound if one.told.error <= AS_GOOD * surest.told.error), key=price)
        if first is surest:
            return first, f"it is the surest of {len(sound)} kinds and builds"
        return first, f"it is about as sure as {surest.told.named}, {surest.told.error_words}, and cheaper"
    reach = [one for one in sound if one.told.made.image_px <= goal_px]
    if reach:
        return min(reach, key=price), f"it is the cheapest of {len(reach)} kinds and builds that reach that"
    first = min(sound, key=lambda one: one.told.made.image_px)
    said = "more photos, a smaller volume or a finer camera may"
    if first.told.optics.image_px <= goal_px:
        said = f"as drawn it would, {digits(first.told.optics.image_px, 2)} px: measure it with calib measure"
    return first, f"none reaches that as it is made, and this one comes nearest; {said}"
