"""The command `calib diff`."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from calib.commands.answers.cameras import camera_answer
from calib.show.screen import table_console
from designer.base.answer import Summary, Value
from designer.base.errors import InputError
from designer.base.words import printable

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from calib.cameras.refit import CameraDifference
    from calib.interop.reading import OpenedCamera

WHOLE = "whole image"


def diff(
    a: Annotated[str, typer.Argument(help="camera file of any kind that calib convert reads, or a folder with one")],
    b: Annotated[str, typer.Argument(help="another camera of the same image size")],
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
    """Compare two cameras: how far apart they see the same light, in px over the image.

    The frames of two calibrations are never quite parallel, so the best rotation between them is removed first.
    """
    from calib.cameras.refit import camera_difference
    from calib.interop.reading import open_camera

    opened = [open_camera(name) for name in (a, b)]
    if picture is not None:
        _check_picture(picture, opened)
    difference = camera_difference(opened[0].read.camera, opened[1].read.camera, radius_px=radius)
    if picture is not None:
        _draw(picture, difference, f"from {printable(a)} to {printable(b)}")
    for mark, name, one in zip("AB", (a, b), opened, strict=True):
        width, height = one.read.camera.image_size
        print(f"{mark}  {printable(name)}: {one.format.title}, {one.read.camera.model}, {width} x {height} px")
        for remark in one.read.remarks:
            fitted = "" if one.read.refit is None else f": max {one.read.refit.max_px:.4f} px off"
            print(f"   {remark}{fitted}")
    print(f"{_rotation(difference)}\n")
    _table(difference)
    _say_where(difference)
    if picture is None:
        print("next  the same command with --picture FILE.png draws the map")
    else:
        print(f"wrote {printable(str(picture))}: the map; arrows lead from where A sees the light to where B does")
    cameras = {
        mark: {"file": name, "format": one.format.name, **camera_answer(one.read.camera)}
        for mark, name, one in zip("ab", (a, b), opened, strict=True)
    }
    return Summary(
        {**cameras, **_numbers(difference)},
        () if picture is None else (picture,),
        remarks=tuple(
            f"{printable(name)}: {line}" for name, one in zip((a, b), opened, strict=True) for line in one.read.remarks
        ),
    )


def _check_picture(picture: Path, opened: "Sequence[OpenedCamera]") -> None:
    """Refuse a place that is no PNG file, an input, or holds something else, before any work is done."""
    from designer.base.own_files import require_ours

    if picture.suffix.lower() != ".png":
        raise InputError(f"{picture}: the picture is a .png file; name it so, such as {picture.stem or 'diff'}.png")
    if any(one.is_file(picture) for one in opened):
        raise InputError(f"{picture}: is a file to read; choose another name with --picture")
    require_ours(picture)


def _draw(picture: Path, difference: "CameraDifference", what: str) -> None:
    """The map into its file."""
    from calib.core.files import write_files
    from calib.figures.difference_picture import difference_picture

    rms, _, largest = _summary(difference.length_px)
    note = f"RMS {rms:.4f} px, max {largest:.4f} px"
    write_files({picture: difference_picture(difference, f"{what}; {_rotation(difference)}", note)})


def _rotation(difference: "CameraDifference") -> str:
    """What was removed."""
    import numpy as np

    if difference.radius_px == 0:
        return "no rotation removed"
    whole = difference.radius_px >= np.hypot(*difference.image_size) / 2
    where = "the whole image" if whole else f"{difference.radius_px:g} px about the centre"
    return f"rotation removed: {np.degrees(difference.turn_rad):.4f} deg, fitted to {where}"


def _table(difference: "CameraDifference") -> None:
    """RMS, median and max of the whole image, and from its centre to its corners."""
    import numpy as np
    from rich.table import Table

    table = Table(box=None, padding=(0, 2, 0, 0))
    table.add_column("difference (px)")
    for column in ("RMS", "median", "max"):
        table.add_column(column, justify="right")
    for name, lengths in _zones(difference):
        label = _label(name, float(np.isfinite(lengths).mean()) if lengths.size else 0.0)
        if np.isfinite(lengths).any():
            table.add_row(label, *(f"{value:.4f}" for value in _summary(lengths)))
        else:
            table.add_row(label, "not known", "", "")
    table_console().print(table)


def _label(zone: str, known: float) -> str:
    """What a zone is called: one that is compared in part must not pass for all of it.

    Args:
        zone: a name of `_zones`.
        known: the share of it in which both cameras know what they see.
    """
    if known == 1 or not known:
        return zone
    share = f"{100 * known:.0f} %" if known < 0.995 else "> 99 %"
    return f"where both are known ({share})" if zone == WHOLE else f"{zone} ({share} of it)"


def _zones(difference: "CameraDifference") -> "tuple[tuple[str, NDArray[np.float64]], ...]":
    """Lengths in px over the whole image, and from its centre to its corners."""
    import numpy as np

    part = difference.off_centre_px / (np.hypot(*difference.image_size) / 2)
    length = difference.length_px
    return (
        (WHOLE, length.ravel()),
        ("centre", length[part < 1 / 3]),
        ("between", length[(part >= 1 / 3) & (part < 2 / 3)]),
        ("corners", length[part >= 2 / 3]),
    )


def _numbers(difference: "CameraDifference") -> dict[str, Value]:
    """What differs, for a program; null where nothing is known."""
    import numpy as np

    zones: dict[str, Value] = {}
    for name, lengths in _zones(difference):
        known = lengths[np.isfinite(lengths)]
        rms, median, largest = _summary(known) if len(known) else (math.nan,) * 3
        percentile = float(np.percentile(known, 95)) if len(known) else math.nan
        zones[name.replace(" ", "_")] = {
            "rms_px": rms, "median_px": median, "percentile_95_px": percentile, "max_px": largest,
        }  # fmt: skip
    length = difference.length_px
    row, column = np.unravel_index(np.nanargmax(length), length.shape)
    whole = zones.pop("whole_image")
    return {
        "rotation_removed_rad": difference.turn_rad if difference.radius_px else 0.0,
        "rotation_fitted_within_px": difference.radius_px,
        **(whole if isinstance(whole, dict) else {}),
        "zones": zones,
        "largest_at_px": difference.pixel[row, column].tolist(),
        "largest_difference_px": difference.difference_px[row, column].tolist(),
        "pixels": length.size,
        "pixels_not_compared": int(np.isnan(length).sum()),
    }


def _summary(length_px: "NDArray[np.float64]") -> tuple[float, float, float]:
    """RMS, median and max of the lengths that are known."""
    import numpy as np

    known = length_px[np.isfinite(length_px)]
    return float(np.sqrt(np.mean(known**2))), float(np.median(known)), float(known.max())


def _say_where(difference: "CameraDifference") -> None:
    """Where the difference is largest, and how much of the image is compared."""
    import numpy as np

    length = difference.length_px
    row, column = np.unravel_index(np.nanargmax(length), length.shape)
    u, v = difference.pixel[row, column]
    du, dv = np.round(difference.difference_px[row, column], 4) + 0.0  # no -0.0000
    print(f"\nlargest at pixel ({u:.0f}, {v:.0f}): B sees its light ({du:+.4f}, {dv:+.4f}) px away")
    unknown = int(np.isnan(length).sum())
    if unknown:
        print(f"not compared: {unknown} of {length.size} pixels looked at, where a camera does not know what it sees")
