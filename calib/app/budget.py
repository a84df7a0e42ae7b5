"""What a rig can be expected to measure: `calib budget`, `calib.budget("rig.json", distance_mm=(500, 4000))`."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from os import PathLike, fspath
from typing import TYPE_CHECKING, Annotated

from designer.base.answer import program
from designer.base.errors import InputError
from designer.base.marks import NOT_IN_FILE
from designer.base.options import FARTHEST_MM, UNITS, argument, option, read_range
from designer.base.words import figure as digits
from designer.base.words import printable
from designer.page.capability import capability
from designer.page.result import Result

if TYPE_CHECKING:
    from calib.app.inputs import Place
    from calib.cameras.rig import Rig
    from calib.space.budget import ChangedRig, Expected, KnownExactly
    from calib.space.budget_views import DepthCurve, ErrorSlice
    from calib.space.propagate import PointErrors
    from calib.space.volume import WorkingVolume
    from designer.base.arrays import Array
    from designer.page.blocks import Page, Table

    _Row = tuple[str, PointErrors, PointErrors, float]

GRID_FILE = "grid.csv"
FRAMES = (
    "The error of a point is the root mean square of its length in space. In the rig's frame, it holds what turns or "
    "shifts all points together; with the best rigid motion of the whole volume taken off, only what bends or scales "
    "shapes is left. A length does not depend on the frame."
)
CONDITION = (
    "If one part were known exactly, and the others as well as they then were: so large would the errors be. Parts go "
    "together, so what they cost does not add up."
)
ALIKE = "By the same computation with a changed rig; what each change assumes stands below."
OF_RINGS = (
    "the noise is that of the target's marks in the photos that the rig was solved from; points that are found less "
    "surely are measured worse: give their noise with --noise"
)
AHEAD, ALONG = ("to the right", "down", "ahead"), ("along x", "along y", "along z")
MOST_DRAWN = 300
NOT_KNOWN = "not known"
NAMED_BELOW = 0.98
"""Of the errors: what leaves more than that is no part to name."""


@dataclass(frozen=True)
class LengthErrors:
    """Standard deviations of a length in space, of many places."""

    direction: str
    total: "PointErrors"
    by_noise: "PointErrors"
    by_calibration: "PointErrors"


@dataclass(frozen=True, eq=False)
class Budget(
    Result, kind="budget", title="Budget", doing="working out the errors",
    files={GRID_FILE: "an even lattice of points: their covariances, by noise, by the rig, and both"},
):  # fmt: skip
    """What to expect of a rig: `found.position.median_mm`, `found.expected.covariance_mm2`."""

    rig: Annotated["Rig", NOT_IN_FILE]
    expected: Annotated["Expected", NOT_IN_FILE]  # point by point of an even lattice over the volume
    shape_mm: Annotated["Array", NOT_IN_FILE]  # (N,) by the rig's errors, the best rigid motion of all points taken off
    depth: Annotated["DepthCurve | None", NOT_IN_FILE]
    slices: Annotated["tuple[ErrorSlice, ...]", NOT_IN_FILE]
    program: str
    settings: dict[str, str]
    volume: "WorkingVolume"
    share: float  # of the volume that enough cameras see
    seen_by: int
    noise_px: "Array"  # (C,)
    points: int
    position: "PointErrors"  # of a point, in the rig's frame
    by_noise: "PointErrors"
    by_calibration: "PointErrors"
    shape: "PointErrors"  # the best rigid motion of the whole volume taken off
    shape_by_calibration: "PointErrors"
    length_mm: float
    lengths: tuple[LengthErrors, ...]
    known: "tuple[KnownExactly, ...]"
    changes: "tuple[ChangedRig, ...]"
    remarks: tuple[str, ...]

    def page(self) -> "Page":
        """How large errors are, where, by what, and what would help."""
        return _page(self)

    def tables(self) -> dict[str, bytes]:
        """`grid.csv`."""
        from calib.space.budget import grid_csv

        return {GRID_FILE: grid_csv(self.expected, self.shape_mm)}


def _box(text: str) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """The corners of a box: three ranges of lengths, whose last unit is that of all that have none."""
    parts = text.split(",")
    if len(parts) != 3 or any(".." not in part for part in parts):
        raise ValueError("give three ranges x, y, z such as -20..20,-10..10,80..150cm")
    unit = re.search(r"[a-zA-Z]+\s*\Z", text)
    ended = [part if unit is None or re.search(r"[a-zA-Z]\s*\Z", part) else f"{part}{unit[0]}" for part in parts]
    low, high = zip(*(read_range(part, UNITS["mm"].parse, "mm") for part in ended), strict=True)
    return low, high


@capability
def budget(
    rig: Annotated["Rig | Place", argument("the rig's file: a rig.json with its covariance, or another tool's")],
    *,
    distance_mm: Annotated[
        tuple[float, float] | None,
        option(
            "what the cameras see from here to there: 0.5m..4m (default: around where the optical axes meet, or 5 to "
            "25 baselines)", 1e-3, FARTHEST_MM,
        ),
    ] = None,
    volume: Annotated[
        tuple[Sequence[float], Sequence[float]] | None,
        option("or a box in the rig's frame: x, y, z as '-20..20,-10..10,80..150cm'", parse=_box),
    ] = None,
    noise_px: Annotated[
        float | Sequence[float] | None,
        option("of a coordinate in the image: 0.1px (default: as the rig's file has it)", 1e-6, 1e3),
    ] = None,
    seen_by: Annotated[int, option("cameras that have to see a point", 2)] = 2,
    length_mm: Annotated[float, option("whose error is told, too", 1e-3, 1e6)] = 100.0,
) -> Budget:  # fmt: skip
    """Tell how large errors in space are to be expected, in mm: `budget("rig.json", distance_mm=(500, 4000))`.

    By pixel noise and by the calibration of the rig; also what they come from, and what more frames, another baseline
    or another camera would buy.

    >>> calib.budget("rig.json", distance_mm=(500, 4000)).by_noise.median_mm

    Args:
        volume: instead of it corners low and high, each x, y, z in mm in the rig's frame.
        noise_px: of a coordinate, of all cameras or each; None: the rig's.

    Raises:
        InputError: a file that cannot be read, options that break a rule, or a volume that too few cameras see.
    """
    import numpy as np

    from calib.app.inputs import load_rig
    from calib.space import budget as space
    from calib.space.budget import what_ifs
    from calib.space.budget_views import depth_curve, slices
    from calib.space.propagate import errors_of, rms_errors
    from calib.space.triangulate import noise_of, noise_of_each
    from calib.space.volume import box_volume, default_volume, volume_between

    known = load_rig(rig)
    if not 2 <= seen_by <= max(len(known.names), 2) or len(known.names) < 2:
        few = "a rig of one camera: depth needs two; give a rig of two cameras or more"
        raise InputError(few if len(known.names) < 2 else f"--seen-by {seen_by}: must be from 2 to {len(known.names)}")
    if volume is not None and distance_mm is not None:
        raise InputError("--volume and --distance: each says where is to be measured; give one")
    if distance_mm is not None and not distance_mm[0] < distance_mm[1]:
        raise InputError(f"--distance {distance_mm[0]:g}..{distance_mm[1]:g} mm: the smaller comes first")
    noise = noise_of(known, noise_of_each(known, noise_px))
    if volume is not None:
        where = box_volume(*(np.asarray(corner, dtype=np.float64) for corner in volume))
    elif distance_mm is None:
        where = default_volume(known, seen_by)
    else:
        where = volume_between(known, *distance_mm, seen_by)
    expected, share = space.over_volume(known, where, noise, seen_by)
    shape_mm = space.shape_error_mm(expected)
    return Budget(
        rig=known, expected=expected, shape_mm=shape_mm, depth=depth_curve(known, where, noise, seen_by),
        slices=slices(known, where, noise, seen_by), program=program(),
        settings={"rig file": fspath(rig)} if isinstance(rig, str | PathLike) else {},
        volume=where, share=share, seen_by=seen_by, noise_px=noise, points=len(expected.point_mm),
        position=space.position_errors(expected), by_noise=rms_errors(expected.noise_mm2),
        by_calibration=rms_errors(expected.calibration_mm2),
        shape=space.shape_errors(expected), shape_by_calibration=errors_of(shape_mm),
        length_mm=length_mm, lengths=_lengths(known, where, expected, length_mm, noise),
        known=space.if_known_exactly(known, expected), changes=what_ifs(known, where, noise, seen_by),
        remarks=_remarks(known, expected, is_usual=noise_px is None),
    )  # fmt: skip


def _lengths(
    rig: "Rig", volume: "WorkingVolume", expected: "Expected", length_mm: float, noise_px: "Array"
) -> tuple[LengthErrors, ...]:
    """The errors of a length along each axis of the volume."""
    import numpy as np

    from calib.space.budget import length_errors
    from calib.space.propagate import errors_of

    noise, shared = length_errors(rig, expected.point_mm, volume.rig_from_volume[:3, :3], length_mm, noise_px)
    total = noise if expected.by_calibration is None else noise + shared
    return tuple(
        LengthErrors(name, *(errors_of(np.sqrt(variance[:, axis])) for variance in (total, noise, shared)))
        for axis, name in enumerate(AHEAD if volume.is_ahead else ALONG)
    )


def _remarks(rig: "Rig", expected: "Expected", *, is_usual: bool) -> tuple[str, ...]:
    """What a person must know of the numbers."""
    from calib.space.budget import share_not_measured

    lost = share_not_measured(rig, expected)
    said = (
        ("the rig's file tells no covariance: all errors are of the noise alone, the rig's own come on top",
         expected.by_calibration is None),
        (OF_RINGS, is_usual),
        (f"in {100 * lost:.1f} % of the volume errors reach a third of the distance: nothing is measured there",
         lost > 0),
        ("what stands between a camera and a point is not regarded", True),
    )  # fmt: skip
    return tuple(text for text, is_so in said if is_so)


def _page(found: Budget) -> "Page":
    from calib.draw.rig_scene import depth_drawing, rig_and_errors, slice_drawing
    from calib.draw.style import figure_of
    from designer.page.blocks import Facts, Headline, Page, Section
    from designer.page.folders import Shown, notes, table_of

    half, most = (f"{digits(value, 2)} mm" for value in (found.position.median_mm, found.position.most_mm))
    sentence = (
        f"Half of the volume is measured to {half} or better, 95 % of it to {most} (RMS of a point's error in space)"
        f"{_because(found)}."
    )
    noise = ", ".join(dict.fromkeys(f"{digits(px, 2)} px" for px in found.noise_px.tolist()))
    facts = Facts((
        ("rig", f"{len(found.rig.names)} cameras: {', '.join(map(printable, found.rig.names))}"),
        *((name, printable(text)) for name, text in found.settings.items()), ("volume", printable(found.volume.words)),
        ("seen", f"{100 * found.share:.0f} % of its box, by {found.seen_by} cameras or more; {found.points} points"),
        ("noise", f"{noise}, of a coordinate in the image"),
    ))  # fmt: skip
    as_it_is = (found.position, found.shape, found.share)
    parts = [("nothing: as it is", *as_it_is), *((one.part, one.position, one.shape, 1.0) for one in found.known)]
    changes = [("nothing changed", *as_it_is), *((c.change, c.position, c.shape, c.share) for c in found.changes)]
    errors = (
        Shown["_Row"]("median mm", lambda row: row[1].median_mm, "of a point in the rig's frame"),
        Shown["_Row"]("95 % mm", lambda row: row[1].most_mm, "likewise"),
        Shown["_Row"]("shape, median mm", lambda row: row[2].median_mm, "rigid motion taken off", unknown=NOT_KNOWN),
        Shown["_Row"]("shape, 95 % mm", lambda row: row[2].most_mm, "likewise", unknown=NOT_KNOWN),
    )
    seen = Shown["_Row"]("seen", lambda row: f"{100 * row[3]:.0f} %", "share of the box")
    drawings = [*([] if found.depth is None else [depth_drawing(found.depth)]), *map(slice_drawing, found.slices)]
    assumed = Facts(tuple((printable(one.change), printable(one.assumes)) for one in found.changes))
    sections = [Section("How large are the errors?", (_errors_table(found), *notes(found.remarks)), lead=FRAMES)]
    if drawings:
        where = "Grey: too few cameras see it."
        sections.append(Section("Where", tuple(map(figure_of, drawings)), lead=where))
    if found.known:
        parts_table = table_of(parts, Shown["_Row"]("if known exactly", lambda row: row[0]), *errors)
        sections.append(Section("What they come from", (parts_table,), lead=CONDITION))
    if found.changes:
        gains = table_of(changes, Shown["_Row"]("with", lambda row: row[0]), *errors, seen)
        sections.append(Section("What would help", (gains, assumed), lead=ALIKE))
    every = slice(None, None, -(-found.points // MOST_DRAWN))
    scene = rig_and_errors(
        found.rig, found.expected.point_mm[every], found.expected.covariance_mm2[every], "The rig and its volume",
        sentence, "Points of the volume, each drawn as the axes of the error to be expected",
    )  # fmt: skip
    return Page("", "", Headline("note", half, sentence), tuple(sections), lead=(scene, facts))


def _because(found: Budget) -> str:
    """What makes the error, in the volume's median point."""
    noise, rig, total = (one.median_mm for one in (found.by_noise, found.by_calibration, found.position))
    if math.isnan(rig):
        return "; by the noise of the pixels alone, for the rig's own errors are not known"
    made = f"; pixel noise alone makes {digits(noise, 2)} mm, the rig's own errors {digits(rig, 2)} mm"
    parts = [one for one in found.known if one.part in ("the lenses", "the rotations", "the positions")]
    least = min(parts, key=lambda one: one.position.median_mm, default=None)
    if least is None or least.position.median_mm > NAMED_BELOW * total:
        return made
    return f"{made}. Were {least.part} known exactly, half were at {digits(least.position.median_mm, 2)} mm or better"


def _errors_table(found: Budget) -> "Table":
    """Positions, shapes and lengths."""
    from designer.page.folders import Shown, table_of

    kind = Shown["tuple[str, PointErrors, PointErrors, PointErrors]"]
    rows = [
        ("of a point, in the rig's frame", found.position, found.by_noise, found.by_calibration),
        ("of a point, rigid motion taken off", found.shape, found.by_noise, found.shape_by_calibration),
        *((f"of a length of {found.length_mm:g} mm {length.direction} (sigma)", length.total, length.by_noise,
           length.by_calibration) for length in found.lengths),
    ]  # fmt: skip
    return table_of(
        rows,
        kind("error", lambda row: row[0]),
        kind("median mm", lambda row: row[1].median_mm, unknown=NOT_KNOWN),
        kind("95 % mm", lambda row: row[1].most_mm, "95 % of the volume is better", unknown=NOT_KNOWN),
        kind("worst mm", lambda row: row[1].worst_mm, unknown=NOT_KNOWN),
        kind("by noise mm", lambda row: row[2].median_mm, "median"),
        kind("by the rig mm", lambda row: row[3].median_mm, "median, by the rig's own errors", unknown=NOT_KNOWN),
    )
