"""What `calib measure` shows of a measured target."""

from typing import TYPE_CHECKING

from calib.show.screen import table_console
from designer.base.words import printable

if TYPE_CHECKING:
    from calib.as_built_report.deviations import Estimate
    from calib.as_built_report.files import MeasureReport


def say_next_size(size: "Estimate", made_with_percent: float, *, plastic: bool) -> None:
    """The shrinkage compensation of the next print, where one length alone tells the size."""
    from calib.as_built_report.deviations import WholePrint, compensation_percent
    from calib.as_built_report.words import next_print_lines

    if not plastic:
        print(*next_print_lines(WholePrint(size, (), ()), 0.0, plastic=False), sep="\n")
        return
    if not size.is_significant:
        keep = f"keep --shrink-compensation {made_with_percent:g}%; " if made_with_percent else ""
        print(f"next print: {keep}the size is right, as far as this reading tells")
        return
    percent = compensation_percent(size.value, made_with_percent)
    before = f"; this one was made with {made_with_percent:g}%" if made_with_percent else ""
    print(f"next print: design ... --shrink-compensation {percent:.3f}%   # printed plastic{before}")


def say_measured(report: "MeasureReport") -> None:
    """Status, the whole print, faces, rings and what is gained."""
    from calib.as_built_report.words import (
        faces_table,
        gain_table,
        is_plastic,
        next_print_lines,
        rings_line,
        whole_print_lines,
    )

    found, console = report.found, table_console()
    views, sightings = (
        sum(one.view_count for one in found.observations),
        sum(len(one.view) for one in found.observations),
    )
    worth = "times the stated sigma" if report.weighted else "px"
    print(
        f"{len(found.cameras)} camera{'s' if len(found.cameras) > 1 else ''}, {views} photos, {sightings} sightings: "
        f"{found.status}; an observation's standard deviation is {found.scale:.4f} {worth}; {found.seconds:.1f} s"
    )
    for remark in found.remarks:
        console.print(f"  {printable(remark)}", style="yellow", markup=False)
    for asked, (_, left) in zip(report.lengths, found.lengths, strict=True):
        print(f"length {asked.text}; left over {left:+.1f} sigma")
    print()
    for line in whole_print_lines(found, report.whole):
        print(line)
    if report.rings is not None:
        print(rings_line(report.rings))
    print()
    plastic = is_plastic(found.nominal)
    for line in next_print_lines(report.whole, report.made_with_percent, report.made_with_skew_rad, plastic=plastic):
        print(line)
    print()
    if report.faces is not None:
        print("how faces lie, in their own axes (z outwards); * is more than 3 sigma, of a face that moved")
        console.print(faces_table(found, report.faces))
        print()
    if report.held_out is not None:
        held = report.held_out
        for remark in held.remarks:
            console.print(f"  {printable(remark)}", style="yellow", markup=False)
        if held.gains:
            print(
                f"root mean square errors of photos held out, in {held.folds} parts: camera and target are solved from "
                "the other parts,\nonly a photo's own pose from itself; at least: with 97.5 % certainty"
            )
            console.print(gain_table(held))
        print()
