"""One piece in two filaments: the ink is set into the body, and both lie on the bed as one object."""

from collections.abc import Sequence

from designer.formats.folder import OutputFile
from designer.make.bed import Piece, Plate, bed_from_target
from designer.page.blocks import Section
from designer.produce import Design, Maker
from designer.report.making import print_settings, slicer_folds
from designer.spec.spec import PrintSpec


class OnePiece(Maker):
    """A two-filament print."""

    def plates(self, design: Design) -> tuple[Plate, ...]:
        """One, with the whole target."""
        return (Plate("", (Piece(design.job.name, design.part, bed_from_target(design.target, design.job.printing)),)),)

    def machine_words(self, printing: PrintSpec) -> str:
        """The printer."""
        return printer_words(printing)

    def making(self, design: Design, files: Sequence[OutputFile]) -> Section:
        """The settings, and a fold a slicer."""
        folds = slicer_folds(design, [file.name for file in files])
        blocks = (*print_settings(design, design.job.printing.printer.machine.shells), *folds)
        return Section("Making it", blocks, "One object in two filaments, as it lies in the file.")

    def next_step(self, design: Design, stem: str) -> str:
        """Open the package."""
        slicers = f"{stem}.bambu.3mf in Bambu Studio or OrcaSlicer, or {stem}.prusa.3mf in PrusaSlicer"
        return f"open {slicers}; filament 1 is the body, 2 the ink"


def printer_words(printing: PrintSpec) -> str:
    """`bambu-p1s with a 0.4 mm nozzle`."""
    return f"{printing.printer.name} with a {printing.printer.nozzle_mm:g} mm nozzle"


MAKER = OnePiece()
