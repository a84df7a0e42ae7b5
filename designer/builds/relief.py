"""Rings raised above a plate: a printer with one filament at a time, which changes at one height.

The target's plane is half-way up the walls of the rings, where an oblique camera sees them (`designer.make.mesh`).
"""

from collections.abc import Sequence

from designer.builds.design import Design
from designer.builds.one_piece import OnePiece
from designer.builds.slicing import colour_words, print_settings, usual_slicer
from designer.formats.folder import OutputFile
from designer.make.bed import Piece, Plate, bed_from_target
from designer.page.blocks import Fold, Section, Steps

_SETTING_THE_CHANGE = {
    "PrusaSlicer": "the change stands in the file: a coloured mark at {z:g} mm on the slider at the right",
    "Bambu Studio, OrcaSlicer": "the pause stands in the file, on the slider at the right at layer {layer}, {z:g} mm; "
    "if it was loaded as geometry alone, add it there by the right mouse button",
    "Cura": "Extensions, Post processing, Filament change, at layer {layer}",
}
"""By a slicer's title, when the file has been sliced."""


class Relief(OnePiece):
    """A plate, and rings on it."""

    def plates(self, design: Design) -> tuple[Plate, ...]:
        """One, with the whole target."""
        return (Plate("", (Piece(design.job.name, design.part, bed_from_target(design.target, design.job.printing)),)),)

    def remarks(self, design: Design) -> tuple[str, ...]:
        """Where the filament changes, and where the target's plane is."""
        z, layer = change_of(design)
        height = design.job.printing.inlay_mm
        return (
            f"change of filament: before layer {layer}, whose top is at {z:g}mm; marks stand {height:g}mm high and "
            f"the target's plane is {height / 2:g}mm below their tops",
        )

    def making(self, design: Design, files: Sequence[OutputFile]) -> Section:
        """The settings, and the steps in a slicer."""
        printing, own = design.job.printing, usual_slicer(design.job.printing.printer)
        (z, layer), name = change_of(design), design.job.name
        first, second = colour_words(printing.body_colour), colour_words(printing.ink_colour)
        titles = sorted(_SETTING_THE_CHANGE, key=lambda title: title != own)
        opened = {"PrusaSlicer": f"{name}.prusa.3mf"}
        steps = Steps((
            f"Load {first}. Choose the printer with one filament, and open "
            + "; ".join(f"in {title} {opened.get(title, f'{name}.bambu.3mf')}" for title in titles)
            + f"; in any other {name}.stl.",
            "Set the values of the table above, and slice.",
            *(f"In {title}: {_SETTING_THE_CHANGE[title].format(z=z, layer=layer)}." for title in titles),
            f"Preview by colour: all {layer - 1} layers below the change are one colour, those above are marks.",
            f"Print. When the printer stops, change to {second}, push until no {first.split(' ')[0]} comes, pick the "
            "thread off, go on.",
        ))  # fmt: skip
        light = Steps((
            "Light it from where the cameras are, or from all around: a lamp from one side casts the shadow of each "
            f"mark on the white beside it, up to {printing.inlay_mm:g} mm wide at 45 deg, and shifts all marks alike.",
            "A caliper over the marks reads the full thickness; the plane of the target file is "
            f"{printing.inlay_mm / 2:g} mm below their tops, half-way up their walls, where cameras see them.",
        ))  # fmt: skip
        height_mm = design.plates[0].in_turn[2]
        in_turn = Steps((
            "Only where Z homes on a switch, beside the plate: a printer that feels for its bed touches the plate, and "
            "can pause instead.",
            f"Print {name}.body.prusa.3mf in {first}. Leave it on the bed, and the bed warm; change to {second}.",
            f"Open {name}.pattern.prusa.3mf and keep its printer: there Z offset is {height_mm:g} mm, and the first "
            f"layer's top {z:g} mm. In your own printer set that under Printers, General, and back to 0 afterwards: "
            "without it the nozzle goes into the plate. Its start may neither level the bed nor purge over the plate.",
            "Don't move or arrange it: it lies over the plate. Skirt, brim, supports off, as in the file.",
            f"Export, and look into the G-code: where lines begin, and from there on, no G1 Z below {z:g}.",
            f"In other programs: {name}.body.stl and {name}.pattern.stl, opened together as one object of two parts, "
            f"which keeps them in register; print one without the other, the second with Z offset {height_mm:g} mm.",
        ))  # fmt: skip
        table = print_settings(design, printing.printer.machine.shells, "as in the file: marks up")
        return Section(
            "Making it",
            (
                table,
                Fold("One change of filament", (steps,), is_open=True),
                Fold("No pause: two files, one after the other", (in_turn,)),
                Fold("Light, and the plane", (light,)),
            ),
            f"One filament, then the other: one change, before layer {layer} at {z:g} mm.",
        )

    def next_step(self, design: Design, stem: str) -> str:
        """Open it, and mind the change."""
        z, layer = change_of(design)
        return (
            f"open {stem}.prusa.3mf in PrusaSlicer, where the change of filament is set; in others {stem}.bambu.3mf or "
            f"{stem}.stl with a pause before layer {layer}, {z:g} mm"
        )


def change_of(design: Design) -> tuple[float, int]:
    """The top of the first layer of ink, and its number from 1 on."""
    layer_mm = design.job.printing.printer.layer_height_mm
    z = design.plates[0].change_z_mm(layer_mm)
    assert z is not None  # noqa: S101 - its rings are raised
    return z, round(z / layer_mm)


MAKER = Relief()
