"""Two cameras, or two rigs, compared: `calib diff`, `calib.diff("a/camera.json", "b.yaml")`."""

import math
from dataclasses import dataclass
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

from calib.app.cameras_told import numbers_of
from designer.base.codec import encode_written
from designer.base.errors import InputError
from designer.base.options import argument, option
from designer.base.own_files import require_ours
from designer.base.words import printable
from designer.page.capability import capability
from designer.page.output import Output, asked_output
from designer.page.result import Result

if TYPE_CHECKING:
    from calib.app.inputs import Place
    from calib.cameras.camera import Camera
    from calib.cameras.formats.reading import OpenedCamera, OpenedRig
    from calib.cameras.refit import CameraDifference
    from calib.cameras.rig import Rig
    from calib.cameras.undistortion import ZoneDifference
    from calib.rigs.relative import CameraApart, PairDifference, RigDifference
    from designer.base.files import JsonValue
    from designer.page.blocks import Cell, Headline, Page, Table

    _Zone = tuple[str, ZoneDifference]
    _Apart = CameraApart

MOST_ROWS = 15
ALIKE = 5e-7
"""A part of a length that four digits of a per cent do not show."""


@dataclass(frozen=True, eq=False)
class Difference(Result, kind="difference", title="Difference", doing="comparing", is_written=False):
    """What came of a comparison: `diff("a.json", "b.json").zones["corners"].rms_px`."""

    names: tuple[str, str]
    opened: "tuple[OpenedCamera | OpenedRig, OpenedCamera | OpenedRig]"
    cameras: "CameraDifference | None"  # None: rigs are compared
    rigs: "RigDifference | None"  # None: cameras are
    drawn: Path | None  # where the map of two cameras is
    remarks: tuple[str, ...]

    @property
    def zones(self) -> "dict[str, ZoneDifference]":
        """Of two cameras: the whole image, and from its centre to its corners."""
        from calib.cameras.undistortion import zones_of

        return {} if self.cameras is None else dict(zones_of(self.cameras))

    def document(self) -> "dict[str, JsonValue]":
        """What differs; null where nothing is known."""
        import numpy as np

        files = {
            mark: {"file": name, "format": one.format.name}
            for mark, name, one in zip("ab", self.names, self.opened, strict=True)
        }
        if self.cameras is None:
            return cast("dict[str, JsonValue]", {**files, **encode_written(self.rigs)})
        for mark, one in zip("ab", cast("tuple[OpenedCamera, OpenedCamera]", self.opened), strict=True):
            files[mark] |= cast("dict[str, str]", encode_written(numbers_of(one.read.camera)))
        zones, (pixel, off) = {name: encode_written(zone) for name, zone in self.zones.items()}, self.cameras.largest
        return cast("dict[str, JsonValue]", {
            **files, "rotation_removed_rad": self.cameras.turn_rad if self.cameras.radius_px else 0.0,
            "rotation_fitted_within_px": self.cameras.radius_px, **zones.pop("whole image"), "zones": zones,
            "largest_at_px": pixel.tolist(), "largest_difference_px": off.tolist(),
            "pixels": self.cameras.length_px.size, "pixels_not_compared": int(np.isnan(self.cameras.length_px).sum()),
        })  # fmt: skip

    def page(self) -> "Page":
        """Tables of what differs, the largest difference, and what was removed."""
        from designer.page.blocks import Command, Facts, Headline, Page, Section
        from designer.page.folders import notes
        from designer.page.terminal import quoted

        read = (
            (mark, f"{printable(name)}: {one.format.title}, {_words(one)}")
            for mark, name, one in zip("AB", self.names, self.opened, strict=True)
        )
        if self.cameras is None:
            rigs = cast("RigDifference", self.rigs)
            section = Section("Differences", (*_rig_tables(rigs), *notes(self.remarks)))
            return Page("", "", _placed(rigs), (section,), lead=(Facts(tuple(read)),))
        section = Section("Differences", (_zones_table(self.zones), *notes(self.remarks)))
        within = "" if _is_whole(self.cameras) else f" --radius {self.cameras.radius_px:g}"
        line = f"calib diff {' '.join(quoted(Path(name)) for name in self.names)}{within} --picture difference.png"
        whole = self.zones["whole image"]
        sentence = f"RMS where both see the same light, at most {whole.max_px:.4f} px."
        return Page(
            "", "", Headline("note", f"{whole.rms_px:.4f} px", sentence), (section,),
            lead=(Facts((*_camera_facts(self.cameras), *read)),),
            next_steps=() if self.drawn else (Command(line, "draws the map"),),
        )  # fmt: skip

    def picture(self) -> bytes:
        """The map of differences of two cameras, as a PNG.

        Raises:
            InputError: of rigs there is none.
        """
        import numpy as np

        from calib.draw.fields import difference_picture

        if self.cameras is None:
            raise InputError("two rigs: a map is of two cameras")
        whole = self.zones["whole image"]
        title = f"from {self.names[0]} to {self.names[1]}; {_rotation_words(self.cameras)}"
        note = f"RMS {whole.rms_px:.4f} px ({np.degrees(whole.rms_rad):.5f} deg), max {whole.max_px:.4f} px"
        return difference_picture(self.cameras, title, note)


@capability
def diff(
    a: Annotated[
        "Camera | Rig | Place", argument("file of a camera or a rig, of any kind that calib convert reads, or a folder")
    ],
    b: Annotated["Camera | Rig | Place", argument("another camera of the same image size, or rig of the same cameras")],
    *,
    radius_px: Annotated[
        float | None,
        option(
            "fit the rotation that is removed only this near to the centre, in px; 0: remove none (default: fit it to "
            "the whole image)",
            0,
            1e9,
        ),
    ] = None,
    out: Annotated[
        "Output | Place | None", option("draw the map of differences", flag="--picture", metavar="FILE.png")
    ] = None,
) -> Difference:
    """Compare two cameras: how far apart they see the same light: `diff("a/camera.json", "b.yaml")`.

    In px over the image, and as angles; or two rigs. The frames of two calibrations are never quite parallel, so the
    best rotation between them is removed first. Of two rigs of the same cameras it tells baselines, rotations, and how
    far apart they place the same points.

    >>> calib.diff("a/camera.json", "b.yaml").zones["corners"].rms_px

    Raises:
        InputError: a file that cannot be read, one rig and one camera, other image sizes, or nothing that both know.
    """
    from calib.app.inputs import opened_camera, opened_rig, rig_named
    from calib.cameras.camera import Camera
    from calib.cameras.formats.reading import only_camera
    from calib.cameras.refit import camera_difference
    from calib.cameras.rig import Rig
    from calib.rigs.relative import compare_rigs

    output = asked_output(out)
    names = [fspath(one) if isinstance(one, str | PathLike) else f"a {type(one).__name__.lower()}" for one in (a, b)]
    found = [
        opened_rig(one) if isinstance(one, Rig) else None if isinstance(one, Camera) else rig_named(one)
        for one in (a, b)
    ]
    rigs = [one for one in found if one is not None]
    if all(len(one.read.rig.names) == 1 for one in rigs):  # they are cameras
        rigs = []
    if len(rigs) == 1:
        rig, camera = names if found[0] is not None else names[::-1]
        raise InputError(
            f"{rig}: is a rig, {camera} none; name one of its cameras, as in {rig}#{rigs[0].read.rig.names[0]}"
        )
    if rigs:
        if radius_px is not None or output is not None:
            raise InputError("--radius and --picture are of two cameras; leave them out, or name cameras: RIG#NAME")
        apart = compare_rigs(rigs[0].read.rig, rigs[1].read.rig)
        alone = [(f"alone has {', '.join(only)}",) if only else () for only in apart.only]
        lines = [(*one.read.remarks, *only) for one, only in zip(rigs, alone, strict=True)]
        return Difference((names[0], names[1]), (rigs[0], rigs[1]), None, apart, None, _remarks(names, lines))
    first, second = (
        opened_camera(cast("Camera | Place", one)) if rig is None else only_camera(rig)
        for one, rig in zip((a, b), found, strict=True)
    )
    if output is not None:
        _check_picture(output.place, (first, second))
    difference = camera_difference(first.read.camera, second.read.camera, radius_px=radius_px)
    lines = [one.read.remarks for one in (first, second)]
    drawn = None if output is None else output.place
    made = Difference((names[0], names[1]), (first, second), difference, None, drawn, _remarks(names, lines))
    if output is not None:
        output.write({output.place: made.picture()})
    return made


def _remarks(names: list[str], lines: list[tuple[str, ...]]) -> tuple[str, ...]:
    """What there was to say of each file."""
    return tuple(
        f"{printable(name)}: {printable(line)}" for name, each in zip(names, lines, strict=True) for line in each
    )


def _check_picture(picture: Path, opened: "tuple[OpenedCamera, ...]") -> None:
    """Refuse a place that is no PNG file, an input, or holds something else, before any work is done."""
    if picture.suffix.lower() != ".png":
        raise InputError(f"{picture}: the picture is a .png file; name it so, such as {picture.stem or 'diff'}.png")
    if any(one.is_file(picture) for one in opened):
        raise InputError(f"{picture}: is a file to read; choose another name with --picture")
    require_ours(picture)


def _words(opened: "OpenedCamera | OpenedRig") -> str:
    """What a file holds."""
    from calib.cameras.formats.reading import OpenedRig

    if isinstance(opened, OpenedRig):
        return f"{len(opened.read.rig.names)} cameras"
    camera, fit = opened.read.camera, opened.read.refit
    width, height = camera.image_size
    fitted = "" if fit is None else f", fitted: max {fit.max_px:.4f} px off"
    return f"{camera.model}, {width} x {height} px{fitted}"


def _is_whole(difference: "CameraDifference") -> bool:
    """Whether the rotation is that of the whole image."""
    return difference.radius_px >= math.hypot(*difference.image_size) / 2


def _rotation_words(difference: "CameraDifference") -> str:
    """What was removed."""
    if difference.radius_px == 0:
        return "no rotation removed"
    where = "the whole image" if _is_whole(difference) else f"{difference.radius_px:g} px about the centre"
    return f"rotation removed: {math.degrees(difference.turn_rad):.4f} deg, fitted to {where}"


def _camera_facts(difference: "CameraDifference") -> tuple[tuple[str, str], ...]:
    import numpy as np

    pixel, off = difference.largest
    du, dv = np.round(off, 4) + 0.0  # no -0.0000
    unknown = int(np.isnan(difference.length_px).sum())
    looked = f"{unknown} of {difference.length_px.size} pixels looked at, where a camera does not know what it sees"
    return (
        ("largest", f"at pixel ({pixel[0]:.0f}, {pixel[1]:.0f}): B sees its light ({du:+.4f}, {dv:+.4f}) px away"),
        *((("not compared", looked),) if unknown else ()),
        ("frames", _rotation_words(difference)),
    )


def _zones_table(zones: "dict[str, ZoneDifference]") -> "Table":
    """RMS, median and max of the whole image, and from its centre to its corners, and the angle between directions."""
    from designer.page.folders import Shown, table_of

    kind = Shown["_Zone"]
    return table_of(
        zones.items(),
        kind("difference (px)", lambda row: _label(row[0], row[1].share)),
        kind("RMS", lambda row: _fixed(row[1].rms_px, ".4f")),
        kind("median", lambda row: _fixed(row[1].median_px, ".4f")),
        kind("max", lambda row: _fixed(row[1].max_px, ".4f")),
        kind("RMS (deg)", lambda row: _fixed(math.degrees(row[1].rms_rad), ".5f")),
    )


def _label(zone: str, known: float) -> str:
    """What a zone is called: one that is compared in part must not pass for all of it."""
    if known in (0, 1):
        return zone
    share = f"{100 * known:.0f} %" if known < 0.995 else "> 99 %"
    return f"where both are known ({share})" if zone == "whole image" else f"{zone} ({share} of it)"


def _placed(difference: "RigDifference") -> "Headline":
    """Where two rigs place the same points."""
    from designer.page.blocks import Headline

    placed = difference.placed
    if placed is None:
        return Headline(
            "note", "nothing in space", "no two cameras see the same points in both rigs, so nothing is told in space"
        )
    per_cent = f"{100 * abs(placed.scale):.4f} % {'longer' if placed.scale > 0 else 'shorter'}"
    longer = "as long" if abs(placed.scale) < ALIKE else per_cent
    return Headline(
        "note",
        f"{placed.rms_mm:.4f} mm",
        f"RMS between where both place the same pixels, at most {placed.max_mm:.4f} mm, and lengths by B are {longer}: "
        f"{placed.points} points of {placed.volume}, B laid over A.",
    )


def _rig_tables(difference: "RigDifference") -> "tuple[Table, ...]":
    """Pairs of cameras, those first that differ the most; and how far apart each camera sees the same points."""
    from designer.page.folders import Shown, table_of

    pair, camera = Shown["PairDifference"], Shown["_Apart"]
    more = len(difference.pairs) - MOST_ROWS
    pairs = table_of(
        sorted(difference.pairs, key=lambda one: -one.place_mm)[:MOST_ROWS],
        pair("cameras", lambda one: f"{one.a} - {one.b}"),
        pair("baseline A (mm)", lambda one: _fixed(one.baseline_mm[0], ".3f")),
        pair("B - A (mm)", lambda one: _fixed(one.baseline_mm[1] - one.baseline_mm[0], "+.3f")),
        pair("sigmas", _sigmas),
        pair("place (mm)", lambda one: _fixed(one.place_mm, ".3f")),
        pair("turn (deg)", lambda one: _fixed(math.degrees(one.turn_rad), ".4f")),
        note=f"and {more} pairs that differ less" if more > 0 else "",
    )
    if difference.placed is None:
        return (pairs,)
    order = sorted(difference.placed.cameras, key=lambda one: -one.rms_px if math.isfinite(one.rms_px) else 1.0)
    cameras = table_of(
        order[:MOST_ROWS], camera("difference (px)", lambda one: one.name),
        camera("RMS", lambda one: _fixed(one.rms_px, ".4f")), camera("max", lambda one: _fixed(one.max_px, ".4f")),
    )  # fmt: skip
    return pairs, cameras


def _sigmas(one: "PairDifference") -> "Cell":
    """By how many standard deviations a baseline differs."""
    known, longer = one.baseline_sigma_mm > 0, one.baseline_mm[1] - one.baseline_mm[0]
    return _fixed(longer / one.baseline_sigma_mm if known else math.nan, "+.1f", "")


def _fixed(value: float, spec: str, unknown: str = "not known") -> "Cell":
    """A number to so many places, as its neighbours."""
    from designer.page.blocks import Cell

    return Cell(format(value, spec), value) if math.isfinite(value) else Cell(unknown)
