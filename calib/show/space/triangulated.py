"""What `calib triangulate` tells: where points lie, how surely, what contradicts, and a check object's distances."""

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from calib.records.triangulation_file import (
    POINTS_FILE,
    RESIDUALS_FILE,
    TRIANGULATION,
    TRIANGULATION_FILE,
    TriangulationRecord,
)
from calib.show.parts.origin import Origin
from calib.space.error_size import PointErrors
from calib.space.known_lengths import LengthCheck
from calib.space.triangulate import ONE_CAMERA, REASONS
from designer.base.number_text import figure as digits
from designer.base.words import printable
from designer.page.blocks import (
    Block,
    Cell,
    Column,
    Command,
    Facts,
    Figure,
    Finding,
    Findings,
    Headline,
    Level,
    Page,
    Section,
    Table,
    View3d,
)
from designer.page.folders import files_section, number, some_of, title_of, whole

MOST_FIGURES = 8
GOOD_SHARE, USABLE_SHARE = 0.95, 0.5
"""Of the points that two cameras or more saw, which have a position."""
GOOD_SCALE, USABLE_SCALE = 1.5, 3.0
"""Residuals over what noise and calibration leave to be expected: beyond, lens, rig or matches are wrong."""
GOOD_RATIO, USABLE_RATIO = 1.3, 2.0
"""Errors of known distances over their standard deviations, root mean square."""
WORDS: Mapping[Level, str] = {"good": "good", "usable": "usable", "bad": "do not use", "note": ""}
FILES = (
    (POINTS_FILE, "each point with its covariance: by noise, by the rig's errors, and both"),
    (RESIDUALS_FILE, "each sighting's residual in the image, and its ray's distance from the point"),
    (TRIANGULATION_FILE, "what this page is built from"),
)
MEANS = (
    "The error of a point is the root mean square of its length in space. Errors of the rig are shared by all points, "
    "so much of them cancels in distances between points that lie close together."
)


def triangulation_page(folder: Path, origin: Origin) -> Page:
    """The page of a folder of triangulated points.

    Raises:
        InputError: `triangulation.json` cannot be read; the message names it.
    """
    record = TRIANGULATION.read(folder / TRIANGULATION_FILE)
    sections = sections_of(record)
    again = Command("calib report .", "makes this page again")
    figures = Section("Residuals", _residual_figures(record), lead="Predicted less measured, in each camera's image.")
    return Page(
        title_of(folder), "Triangulation", headline_of(record),
        (*sections, *((figures,) if figures.blocks else ()), files_section(folder, FILES, again)),
        lead=(*_scene(record), Facts(facts_of(record))), made_by=origin.command, program=origin.program,
        is_negative=is_negative(record),
    )  # fmt: skip


def is_negative(record: TriangulationRecord) -> bool:
    """Whether no point has a position."""
    return record.placed == 0


def headline_of(record: TriangulationRecord) -> Headline:
    """The answer: the worst of what was checked."""
    once = seen_once(record)
    if is_negative(record):
        why = f"; {once} {_were(once)} seen by one camera only" if once else ""
        return Headline("bad", "no point", f"None of {record.points} points has a position{why}.")
    level = min((row.level for row in checks_of(record).rows), key=("bad", "usable", "good", "note").index)
    of = f"{record.points - once} points that two cameras or more saw" if once else f"{record.points} points"
    sentence = (
        f"{record.placed} of {of} have a position, half of them to {digits(record.total.median_mm, 2)} mm or better, "
        f"95 % to {digits(record.total.most_mm, 2)} mm or better (RMS of the error in space)."
        + f" {once} more {_were(once)} seen by one camera only."
        * bool(once)
    )
    return Headline(level, WORDS[level], sentence)


def seen_once(record: TriangulationRecord) -> int:
    """How many points one camera saw and no other: nothing was to be triangulated there."""
    return sum(one.seen_alone for one in record.cameras)


def _were(count: int) -> str:
    return "was" if count == 1 else "were"


def facts_of(record: TriangulationRecord) -> tuple[tuple[str, str], ...]:
    """What was triangulated from what."""
    rig = f"{len(record.rig.names)} cameras: {', '.join(map(printable, record.rig.names))}"
    given = tuple((printable(name), printable(text)) for name, text in record.settings.items() if text)
    frames = f"{record.points} in {record.frames} frame{'s' * (record.frames != 1)}"
    return ("rig", rig), *given, ("points", frames)


def checks_of(record: TriangulationRecord) -> Findings:
    """How many points have a position, how large residuals are, and what a check object says."""
    once = seen_once(record)
    judged = record.points - once
    share = record.placed / max(judged, 1)
    without = [f"{count} {why}" for why, count in record.without.items() if why != REASONS[ONE_CAMERA]]
    rows = [Finding(
        "good" if share >= GOOD_SHARE else "usable" if share >= USABLE_SHARE else "bad", "Points with a position",
        "; ".join(without) or f"All {'that two cameras or more saw' if once else 'of them'}.",
        f"{record.placed} of {judged}", f"good from {100 * GOOD_SHARE:.0f} %",
    )]  # fmt: skip
    if once:
        by = [f"{one.seen_alone} by {printable(one.name)}" for one in record.cameras if one.seen_alone]
        rows.append(Finding(
            "note", "Seen by one camera only", f"{', '.join(by)}: nothing to triangulate, and not judged.",
            f"{once} of {record.points}",
        ))  # fmt: skip
    if math.isfinite(record.scale):
        rows.append(Finding(
            _level(record.scale, GOOD_SCALE, USABLE_SCALE), "Residuals",
            "Against what the stated noise and the rig's covariance leave to be expected, of the usual point. Where "
            "they are larger, so are the errors of the points, by about as much.",
            f"{digits(record.scale, 2)} times", f"good up to {GOOD_SCALE:g}, usable up to {USABLE_SCALE:g}",
        ))  # fmt: skip
    if record.lengths is not None:
        rows.append(_length_finding(record.lengths))
    return Findings(tuple(rows))


def _length_finding(check: LengthCheck) -> Finding:
    return Finding(
        _level(check.ratio, GOOD_RATIO, USABLE_RATIO), "Known distances",
        f"Errors of distances on {printable(check.object_name)} are {digits(check.rms_mm, 2)} mm, "
        f"{digits(check.expected_mm, 2)} mm is to be expected by the covariances; {100 * check.within_95:.0f} % lie "
        "within their 95 % limits.",
        f"{digits(check.ratio, 2)} times", f"good up to {GOOD_RATIO:g}, usable up to {USABLE_RATIO:g}",
    )  # fmt: skip


def _level(value: float, good: float, usable: float) -> Level:
    return "good" if value <= good else "usable" if value <= usable else "bad"


def sections_of(record: TriangulationRecord) -> tuple[Section, ...]:
    """All that is told, for page and terminal alike."""
    remarks: tuple[Block, ...] = (
        (Findings(tuple(Finding("usable", "Remark", printable(line)) for line in some_of(record.remarks))),)
        if record.remarks else ()
    )  # fmt: skip
    sections = [
        Section("Can the points be used?", (checks_of(record), *remarks)),
        Section("Errors", (errors_table(record),), lead=MEANS),
        Section("Cameras", (cameras_table(record), *gross_tables(record)), lead=_gross_words(record)),
    ]
    if record.lengths is not None:
        check = record.lengths
        sections.append(Section("Known distances", (lengths_table(check),), lead=scale_words(check)))
    return tuple(sections)


def errors_table(record: TriangulationRecord) -> Table:
    """How large errors are, and what they come from."""
    rows: list[tuple[str, PointErrors]] = [
        ("total", record.total), ("by the noise of the pixels", record.by_noise),
        ("by the rig's own errors", record.by_calibration),
    ]  # fmt: skip
    heads = (
        Column("error of a point", is_number=False), Column("median mm"), Column("95 % mm", note="95 % are better"),
        Column("worst mm"),
    )  # fmt: skip
    return Table("", heads, tuple(
        (Cell(name), *(number(value) if math.isfinite(value) else Cell("not known")
                       for value in (row.median_mm, row.most_mm, row.worst_mm)))
        for name, row in rows
    ))  # fmt: skip


def cameras_table(record: TriangulationRecord) -> Table:
    """What each camera saw."""
    heads = (
        Column("camera", is_number=False), Column("sightings"),
        Column("alone", note="points that no other camera saw"), Column("left out", note="contradict the others"),
        Column("noise px", note="of a coordinate, as the sightings state it, or the rig where they do not"),
        Column("RMS px", note="of the residuals"), Column("ray mm", note="RMS of the points' distances from its rays"),
    )  # fmt: skip
    return Table("", heads, tuple(
        (Cell(printable(one.name)), whole(one.sightings), whole(one.seen_alone), whole(one.left_out),
         number(one.noise_px), number(one.rms_px), number(one.ray_rms_mm))
        for one in record.cameras
    ))  # fmt: skip


def gross_tables(record: TriangulationRecord) -> tuple[Table, ...]:
    """The sightings that were left out, the largest first."""
    if not record.gross:
        return ()
    heads = tuple(Column(name, is_number=False) for name in ("camera", "frame", "point"))
    residual = Column("off by px", note="from where the other cameras have the point")
    rows = tuple(
        (*(Cell(printable(text)) for text in (one.camera, one.frame, one.point)), number(one.residual_px))
        for one in record.gross
    )
    return (Table("Left out", (*heads, residual), rows),)


def _gross_words(record: TriangulationRecord) -> str:
    left_out = sum(one.left_out for one in record.cameras)
    if len(record.rig.names) == 2:
        return "Of two cameras an error along the line of sight's image, the epipolar line, shows in no residual."
    if left_out:
        what = "1 sighting contradicts" if left_out == 1 else f"{left_out} sightings contradict"
        return f"{what} the others of the same point, and {'was' if left_out == 1 else 'were'} left out."
    return "No sighting contradicts the others of its point."


def lengths_table(check: LengthCheck) -> Table:
    """Errors of known distances, by distance."""
    heads = (
        Column("distance mm", is_number=False), Column("pairs"), Column("mean mm", note="measured less known"),
        Column("RMS mm"), Column("expected mm", note="by the covariances"), Column("within 95 %"),
    )  # fmt: skip
    return Table("", heads, tuple(
        (Cell(f"{digits(one.from_mm, 3)} to {digits(one.to_mm, 3)}", one.from_mm), whole(one.pairs),
         number(one.mean_mm, 2), number(one.rms_mm, 2), number(one.expected_mm, 2),
         Cell(f"{100 * one.within_95:.0f} %", one.within_95))
        for one in check.bins
    ))  # fmt: skip


def scale_words(check: LengthCheck) -> str:
    """Whether the rig's millimetres are millimetres."""
    every = "all pairs" if check.every == 1 else f"one of {check.every} pairs"
    percent, sigma = 100 * check.scale, 100 * check.scale_sigma
    return (
        f"Distances are measured {digits(abs(percent), 2)} % too {'long' if percent > 0 else 'short'} (sigma "
        f"{digits(sigma, 2)} %), by {every} of {check.points} points in {check.frames} frames. "
        "By how much the object itself is off, as it was printed, counts as the rig's error here."
    )


def _residual_figures(record: TriangulationRecord) -> tuple[Figure, ...]:
    """The residuals of the first cameras, as arrows over their images."""
    from calib.draw.fields import residuals_drawing
    from calib.metrics.residual_cells import Residuals
    from calib.show.run.figures import figure_of

    figures: list[Figure] = []
    for one, arrows, camera in zip(record.cameras, record.arrows, record.rig.cameras, strict=False):
        if len(arrows.pixel) and len(figures) < MOST_FIGURES:
            shown = Residuals(camera.image_size, arrows.pixel, arrows.residual_px, arrows.left_out)
            words = f"{printable(one.name)}: {one.sightings - one.left_out} sightings, {digits(one.rms_px, 2)} px RMS"
            drawing = replace(
                residuals_drawing(shown, one.rms_px), title=f"Residuals of {printable(one.name)}", words=words
            )
            figures.append(figure_of(drawing))
    return tuple(figures)


def _scene(record: TriangulationRecord) -> tuple[View3d, ...]:
    """The rig and some of the points."""
    if not len(record.drawn_mm):
        return ()
    from calib.draw.rig_scene import CAMERA, POINT, error_axes, looked_at, rig_layer, scene_size_mm

    size_mm = scene_size_mm(record.rig, record.drawn_mm)
    points, enlarged = error_axes(record.drawn_mm, record.drawn_mm2, size_mm)
    every = "" if len(record.drawn_mm) == record.placed else f" {len(record.drawn_mm)} of {record.placed} are drawn."
    scene = looked_at(record.rig, (rig_layer(record.rig, size_mm), points), ((CAMERA, "camera"), (POINT, "point")))
    return (View3d(
        "Cameras and points", scene, headline_of(record).sentence,
        f"Each point is drawn as the axes of its error, {enlarged:g} times enlarged.{every} Point at a camera for its "
        "name.",
    ),)  # fmt: skip
