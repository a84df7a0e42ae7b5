"""A measured target on the screen: what came out differently, and what to dial into the next print."""

import math
from collections.abc import Iterator

from rich.table import Table
from rich.text import Text

from calib.as_built.result import AsBuilt
from calib.as_built_report.deviations import (
    FREE_PARAMETERS,
    Estimate,
    FaceDeviations,
    RingDeviations,
    WholePrint,
    compensation_percent,
    next_skew_rad,
)
from calib.as_built_report.held_out import Gain, HeldOut
from calib.core.number_text import figure, with_digits
from designer.base.units import MOST_SKEW_DEG, NO_SKEW, SKEW_NAMES, Skew
from designer.target import TargetGeometry

LEAST_COMPENSATION_PERCENT = 0.005
"""Less is not worth dialling in: 5 um on 100 mm."""

LEAST_SPREAD_MM = 0.001
FINEST = 1.5e-4
"""Standard deviation to whose digits numbers are told at the most."""


def percent(estimate: Estimate) -> str:
    """`+0.312 +- 0.004 %`."""
    return f"{_signed(100 * estimate.value, 100 * estimate.sigma)} +- {figure(100 * estimate.sigma, 2)} %"


def degrees(estimate: Estimate) -> str:
    """`+0.031 +- 0.002 deg`."""
    value, sigma = math.degrees(estimate.value), math.degrees(estimate.sigma)
    return f"{_signed(value, sigma)} +- {figure(sigma, 2)} deg"


def spread_mm(sigma_mm: float) -> str:
    """`0.052 mm`; what is too small to matter is only called so."""
    return f"{figure(sigma_mm, 2)} mm" if sigma_mm >= LEAST_SPREAD_MM else f"less than {LEAST_SPREAD_MM:g} mm"


def _signed(value: float, sigma: float) -> str:
    text = with_digits(value, max(sigma, FINEST))
    return text if text.startswith("-") else f"+{text}"


def is_plastic(target: TargetGeometry) -> bool:
    """Whether it is of ours and printed in plastic, so that `design` corrects size and angles; else on paper, or so."""
    build = target.build or (None if target.spec is None else target.spec.builds[0])
    return build not in (None, "sheet")


def whole_print_lines(found: AsBuilt, whole: WholePrint) -> Iterator[str]:
    """Size and shape of the whole print."""
    if whole.size is None:
        yield "size      not known: no length was given; the measured target is as large as the nominal one"
    else:
        yield f"size      {percent(whole.size)} (larger than designed: +){_noise(whole.size)}"
    for name, one in whole.axes:
        yield f"axis {name}    {percent(one)} beyond the mean{_noise(one)}"
    for name, one in whole.skews:
        yield f"skew {name}   {degrees(one)}{_noise(one)}"
    yield axes_words(found.nominal)
    if found.ring_sigma_mm is not None:
        plane, normal = map(spread_mm, found.ring_sigma_mm)
        yield f"rings     off by {plane} in their plane and {normal} normal to it (1 sigma each)"


def axes_words(target: TargetGeometry) -> str:
    """What the axes of a print are."""
    if not is_plastic(target):
        return "axes are the print's: x along its longer side"
    return (
        f"axes are the bed's with the target as `design` lays it: face {target.face_count - 1} down, the longer side "
        "along x; give --bed-turn if it was turned"
    )


def _noise(estimate: Estimate) -> str:
    return "" if estimate.is_significant else ", which may be noise"


def next_print_lines(
    whole: WholePrint, made_with_percent: float, made_with_skew_rad: Skew = NO_SKEW, *, plastic: bool = True
) -> Iterator[str]:
    """What to dial in, so that the next print of the same design comes out right."""
    indent = "next print: "
    lines = _next_print(whole, made_with_percent, made_with_skew_rad) if plastic else _next_sheet(whole)
    for line in lines:
        yield indent + line
        indent = " " * len(indent)


def _next_sheet(whole: WholePrint) -> Iterator[str]:
    """The same of a print on paper: its size is all that a printer's dialog takes back."""
    if whole.size is None:
        yield "measure one length with a caliper or a ruler and give it with --length, to know the size"
    elif not whole.size.is_significant:
        yield "the size needs no correction"
    else:
        yield f"print it at {100 + compensation_percent(whole.size.value):.3f} % of its size"
    if not whole.is_in_shape:
        yield "axes or angles are off by more than noise: another printer or paper; until then use the measured target"


def _next_print(whole: WholePrint, made_with_percent: float, made_with_skew_rad: Skew) -> Iterator[str]:
    dialled, skew_rad = _next_percent(whole, made_with_percent), next_skew_rad(whole, made_with_skew_rad)
    if whole.size is None:
        yield "measure one length with a caliper and give it with --length, to know the shrinkage"
    elif not whole.size.is_significant:
        yield "the size needs no correction"
    elif dialled == made_with_percent:
        yield f"keep --shrink-compensation {made_with_percent:g}%; the size is right"
    is_too_skew = max(map(abs, skew_rad)) > math.radians(MOST_SKEW_DEG)
    made_skew = skew_words(made_with_skew_rad)
    skew = made_skew if is_too_skew else skew_words(skew_rad)
    options = []
    if dialled or made_with_percent:
        number = f"{made_with_percent:g}" if dialled == made_with_percent else f"{dialled:.3f}"
        options.append(f"--shrink-compensation {number}%")
    if skew != "0" or made_skew != "0":
        options.append(f'--skew-compensation "{skew}"')
    if dialled != made_with_percent or skew != made_skew:
        made = [f"{made_with_percent:g}%"] * bool(made_with_percent) + [f'"{made_skew}"'] * (made_skew != "0")
        before = f"; this one was made with {' and '.join(made)}" if made else ""
        yield f"design ... {' '.join(options)}   # printed plastic{before}"
    if whole.is_in_shape:
        yield "axes and angles need no correction" + (f' beyond --skew-compensation "{skew}"' if skew != "0" else "")
    yield from _by_other_means(whole)
    if is_too_skew:
        yield f"`design` takes back no more than {MOST_SKEW_DEG:g} deg of skew: square the printer's axes first"


def _next_percent(whole: WholePrint, made_with_percent: float) -> float:
    """The shrinkage compensation of the next print; that of this one, if no other is worth it."""
    if whole.size is None or not whole.size.is_significant:
        return made_with_percent
    dialled = compensation_percent(whole.size.value, made_with_percent)
    return made_with_percent if abs(dialled - made_with_percent) < LEAST_COMPENSATION_PERCENT else dialled


def skew_words(skew_rad: Skew) -> str:
    """Angles as `design --skew-compensation` reads them, to 0.001 deg: 2 um on 100 mm."""
    angles = [(name, f"{math.degrees(angle):.3f}") for name, angle in zip(SKEW_NAMES, skew_rad, strict=True)]
    return ", ".join(f"{name} {angle}deg" for name, angle in angles if float(angle)) or "0"


def _by_other_means(whole: WholePrint) -> Iterator[str]:
    """What the slicer and the printer can take back."""
    axes = [f"{name} {compensation_percent(one.value) + 100:.3f}%" for name, one in whole.axes if one.is_significant]
    if axes:
        yield f"in the slicer, beside that: scale {', '.join(axes)}"
    skews = [f"{name} by {degrees(one)}" for name, one in whole.skews if one.is_significant]
    if skews:
        yield (
            f"or, with --skew-compensation left as it was, in the printer's skew correction (Marlin M852, Klipper "
            f"SET_SKEW): its second axis leans towards the first, {', '.join(skews)}"
        )


def faces_table(found: AsBuilt, faces: FaceDeviations) -> Table:
    """A line a face."""
    table = _table("face", "photos")
    for name in FREE_PARAMETERS:
        table.add_column(f"{name} {'mm' if name.startswith('shift') else 'deg'}", justify="right")
    table.add_column("", justify="left")
    for face, verdict in enumerate(faces.verdict):
        cells = [""] * len(FREE_PARAMETERS)
        if verdict != "not known":
            cells = [
                _cell(Estimate(value, sigma), k, is_starred=verdict == "moved")
                for k, (value, sigma) in enumerate(zip(faces.value[face], faces.sigma[face], strict=True))
            ]
        table.add_row(str(face), str(found.face_views[face]), *cells, _coloured(verdict))
    return table


def _coloured(verdict: str) -> Text:
    return Text(verdict, {"moved": "bold", "few photos": "yellow", "not known": "yellow"}.get(verdict, ""))


def _cell(one: Estimate, column: int, *, is_starred: bool) -> str:
    """A number with its sigma, and, of a face that moved, a star if it is more than noise."""
    unit = 1.0 if FREE_PARAMETERS[column].startswith("shift") else math.degrees(1)
    value, sigma = unit * one.value, unit * one.sigma
    return f"{_signed(value, sigma)} +-{figure(sigma, 2)}{'*' if is_starred and one.is_significant else ' '}"


def rings_line(rings: RingDeviations) -> str:
    """The ring that is off most."""
    import numpy as np

    if not len(rings.seen):
        return "rings     none of a face whose place is known"
    size_mm = np.linalg.norm(rings.offset_mm, axis=1)
    worst = int(np.argmax(size_mm))
    if size_mm[worst] < LEAST_SPREAD_MM:
        return f"rings     {len(rings.seen)} measured; none is off by {LEAST_SPREAD_MM:g} mm, bow included"
    x, y, z = (np.round(rings.offset_mm[worst], 3) + 0.0).tolist()  # no -0.000
    return (
        f"rings     {len(rings.seen)} measured; ring {int(rings.seen[worst])} is off most: {x:+.3f} {y:+.3f} mm in its "
        f"face's plane, {z:+.3f} mm normal to it, bow included"
    )


def gain_table(held: HeldOut) -> Table:
    """A line a metric: with the nominal and with the measured target."""
    table = _table("error")
    for name in ("unit", "n", "nominal", "measured", "times less", "at least"):
        table.add_column(name, justify="left" if name == "unit" else "right")
    for gain in held.gains:
        table.add_row(*_gain_cells(gain, gain.metric))
    for gain in held.against_truth:
        table.add_row(*_gain_cells(gain, f"{gain.metric} against the truth"))
    return table


def _gain_cells(gain: Gain, name: str) -> list[str]:
    least = "" if gain.least_factor is None else f"{gain.least_factor:.1f}"
    return [name, gain.unit, str(gain.count), figure(gain.nominal), figure(gain.measured), f"{gain.factor:.1f}", least]


UNJUDGED = (
    "not judged, as --held-out 0 asked: nothing shows whether the measured target is better than the drawing; leave "
    "--held-out away to know before you use it"
)


def no_gain_line(held: HeldOut | None) -> str:
    """Why the measured target is not to be used; "" if it is better."""
    gain = None if held is None else held.judged_by
    if gain is None:
        return (
            "too few photos to hold out and judge the measured target by: keep the drawing, and take more photos, "
            "from all sides"
        )
    if gain.is_better:
        return ""
    return (
        f"in photos held out the measured target is no better than the drawing beyond chance ({gain.metric} error "
        f"{figure(gain.measured)} against {figure(gain.nominal)} {gain.unit}): keep the drawing, or take more photos, "
        "from more sides"
    )


def _table(*columns: str) -> Table:
    table = Table(box=None, padding=(0, 2, 0, 0))
    for number, name in enumerate(columns):
        table.add_column(name, justify="right" if number else "left")
    return table
