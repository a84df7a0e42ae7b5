"""The command `calib diff`."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

import typer

from calib.commands.camera_argument import camera_answer
from calib.commands.diffed_rigs import tell_compared_rigs
from designer.base.answer import Summary, Value
from designer.base.errors import InputError
from designer.base.words import printable
from designer.page.terminal import quoted, shown

if TYPE_CHECKING:
    from calib.api.diffing import ComparedCameras, ZoneDifference
    from designer.page.blocks import Table


def diff(
    a: Annotated[
        str, typer.Argument(help="file of a camera or a rig, of any kind that calib convert reads, or a folder")
    ],
    b: Annotated[str, typer.Argument(help="another camera of the same image size, or rig of the same cameras")],
    *,
    radius: Annotated[
        float | None,
        typer.Option(
            min=0,
            help="fit the rotation that is removed only this near to the centre, in px; 0: remove none "
            "(default: fit it to the whole image)",
            metavar="PX",
        ),
    ] = None,
    picture: Annotated[Path | None, typer.Option(help="draw the map of differences", metavar="FILE.png")] = None,
) -> Summary:
    """Compare two cameras: how far apart they see the same light, in px over the image, and as angles; or two rigs.

    The frames of two calibrations are never quite parallel, so the best rotation between them is removed first. Of two
    rigs of the same cameras it tells baselines, rotations, and how far apart they place the same points.
    """
    import numpy as np

    from calib.api.diffing import diff as compare
    from calib.api.diffing_rigs import diff_rigs
    from designer.page.terminal import say_table

    rigs = diff_rigs(a, b)
    if rigs is not None:
        if radius is not None or picture is not None:
            raise InputError("--radius and --picture are of two cameras; leave them out, or name cameras: RIG#NAME")
        return tell_compared_rigs(rigs)
    compared = compare(a, b, radius_px=radius, picture=picture)
    if picture is not None:
        compared.save_picture(picture)
    say_table(_table(compared))
    pixel, off = compared.largest
    du, dv = np.round(off, 4) + 0.0  # no -0.0000
    print(f"largest at pixel ({pixel[0]:.0f}, {pixel[1]:.0f}): B sees its light ({du:+.4f}, {dv:+.4f}) px away")
    if compared.not_compared:
        looked = f"{compared.not_compared} of {compared.difference.length_px.size} pixels looked at"
        print(f"not compared: {looked}, where a camera does not know what it sees")
    print(compared.rotation_words)
    for mark, name, one in zip("AB", compared.names, compared.opened, strict=True):
        width, height = one.read.camera.image_size
        print(f"{mark}  {printable(name)}: {one.format.title}, {one.read.camera.model}, {width} x {height} px")
        for remark in one.read.remarks:
            fitted = "" if one.read.refit is None else f": max {one.read.refit.max_px:.4f} px off"
            print(f"   {remark}{fitted}")
    if picture is None:
        within = "" if radius is None else f" --radius {radius:g}"
        print(
            f"next  calib diff {quoted(Path(a))} {quoted(Path(b))}{within} --picture difference.png   # draws the map"
        )
    else:
        print(f"wrote {shown(picture)}: the map; arrows lead from where A sees the light to where B does")
    remarks = (
        f"{printable(name)}: {line}"
        for name, one in zip(compared.names, compared.opened, strict=True)
        for line in one.read.remarks
    )
    return Summary(_answer(compared), () if picture is None else (picture,), remarks=tuple(remarks))


def _table(compared: "ComparedCameras") -> "Table":
    """RMS, median and max of the whole image, and from its centre to its corners, and the angle between directions."""
    from designer.page.blocks import Cell, Column, Table

    rows = []
    for name, zone in compared.zones.items():
        texts = [f"{number:.4f}" for number in (zone.rms_px, zone.median_px, zone.max_px)]
        texts = [*texts, f"{math.degrees(zone.rms_rad):.5f}"] if zone.share else ["not known", "", "", ""]
        rows.append((Cell(_label(name, zone.share)), *map(Cell, texts)))
    head = (Column("difference (px)", is_number=False), *map(Column, ("RMS", "median", "max", "RMS (deg)")))
    return Table("", head, tuple(rows))


def _label(zone: str, known: float) -> str:
    """What a zone is called: one that is compared in part must not pass for all of it."""
    if known in (0, 1):
        return zone
    share = f"{100 * known:.0f} %" if known < 0.995 else "> 99 %"
    return f"where both are known ({share})" if zone == "whole image" else f"{zone} ({share} of it)"


def _answer(compared: "ComparedCameras") -> dict[str, Value]:
    """What differs, for a program; null where nothing is known."""
    zones = {name: _numbers(zone) for name, zone in compared.zones.items()}
    difference, (pixel, off) = compared.difference, compared.largest
    cameras: dict[str, Value] = {
        mark: {"file": name, "format": one.format.name, **camera_answer(one.read.camera)}
        for mark, name, one in zip("ab", compared.names, compared.opened, strict=True)
    }
    return {
        **cameras,
        "rotation_removed_rad": difference.turn_rad if difference.radius_px else 0.0,
        "rotation_fitted_within_px": difference.radius_px,
        **zones.pop("whole image"),
        "zones": zones,
        "largest_at_px": pixel.tolist(),
        "largest_difference_px": off.tolist(),
        "pixels": difference.length_px.size,
        "pixels_not_compared": compared.not_compared,
    }


def _numbers(zone: "ZoneDifference") -> dict[str, Value]:
    from calib.api.diffing import ZoneDifference
    from designer.base.codec import encode

    keys = cast("dict[str, Value]", encode(ZoneDifference, zone))
    return {name: value for name, value in keys.items() if name != "share"}
