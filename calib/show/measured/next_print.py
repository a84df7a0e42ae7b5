"""What to do after a print was measured: calibrate with what is better, and correct the next print."""

from collections.abc import Iterator
from typing import TypeAlias

from calib.as_built.deviations import Compensation, WholePrint, compensation_percent, next_skew_rad
from calib.draw.print_errors import degrees, is_within_reach, next_options
from calib.records.as_built_file import AsBuiltRecord
from calib.show.measured.words import UNJUDGED, judged_gain, why_not
from designer.base.units import MOST_SKEW_DEG
from designer.base.words import capital
from designer.page.blocks import Command, Paragraph

Told: TypeAlias = Command | Paragraph

USES = "calibrates with the target as it was printed"


def next_print(whole: WholePrint, made_with: Compensation, *, plastic: bool) -> tuple[Told, ...]:
    """What to dial in, so that the next print of the same design comes out right."""
    if not whole.can_be_corrected:
        return (Paragraph("Size or shape is off by more than a printer can be: nothing to dial in against it."),)
    return tuple(_in_plastic(whole, made_with) if plastic else _on_paper(whole))


def _on_paper(whole: WholePrint) -> Iterator[Told]:
    """Of a print on paper the size is all that a printer's dialog takes back."""
    size = whole.known_size
    if size is None:
        yield Paragraph("Measure one length with a caliper or a ruler and give it with --length, to know the size.")
    elif not size.is_significant:
        yield Paragraph("The size needs no correction.")
    else:
        yield Paragraph(f"Print it at {100 + compensation_percent(size.value):.3f} % of its size.")
    if not whole.is_in_shape:
        yield Paragraph(
            "Axes or angles are off by more than noise: another printer or paper; until then use the measured target."
        )


def _in_plastic(whole: WholePrint, made_with: Compensation) -> Iterator[Told]:
    size, options = whole.known_size, next_options(whole, made_with)
    shrink, skew = options
    if size is None:
        yield Paragraph("Measure one length with a caliper and give it with --length, to know the shrinkage.")
    elif shrink.value == shrink.made_with:
        keep = f": keep {shrink.typed}" if shrink.value != "0" else ""
        yield Paragraph(f"The size needs no correction{keep}.")
    if any(one.value != one.made_with for one in options):
        used = " ".join(one.typed for one in options if (one.value, one.made_with) != ("0", "0"))
        made = " and ".join(one.made_with for one in options if one.made_with != "0")
        sure = ", ".join(one.sigma for one in options if one.sigma)
        before = f"; this one was made with {made}" if made else ""
        yield Command(f"design ... {used}", f"the next print of the same design, in plastic (± {sure}){before}")
    if whole.axes and whole.is_in_shape:
        beyond = f" beyond {skew.typed}" if skew.value != "0" else ""
        yield Paragraph(f"Axes and angles need no correction{beyond}.")
    axes = [
        f"{name} {100 + compensation_percent(one.value):.3f}%" for name, one in whole.axes.items() if one.is_significant
    ]
    if axes:
        yield Paragraph(f"In the slicer, beside that: scale {', '.join(axes)}.")
    skews = [f"{name} by {degrees(one)}" for name, one in whole.skews_rad.items() if one.is_significant]
    if skews:
        yield Paragraph(
            "Or, with --skew-compensation left as it was, in the printer's skew correction (Marlin M852, Klipper "
            f"SET_SKEW): its second axis leans towards the first, {', '.join(skews)}."
        )
    if not is_within_reach(next_skew_rad(whole, made_with.skew_rad)):
        yield Paragraph(
            f"design takes back no more than {MOST_SKEW_DEG:g} deg of skew: square the printer's axes first."
        )


def next_steps(record: AsBuiltRecord, use: str, *, plastic: bool) -> tuple[Told, ...]:
    """The next calibration with what was judged better, and the next print.

    Args:
        record: what was measured.
        use: the command line that calibrates with the measured target.
        plastic: whether `design` corrects such prints.
    """
    blocks: tuple[Told, ...]
    gain, not_to_be_used = judged_gain(record), why_not(record)
    if not_to_be_used:
        blocks = (Paragraph(f"{capital(not_to_be_used)}."),)
    elif gain is None:
        blocks = (Paragraph(UNJUDGED),)
    else:
        blocks = (Command(use, USES),)
    if record.status == "degenerate":
        return blocks
    return (*blocks, *next_print(record.whole, record.made_with, plastic=plastic))
