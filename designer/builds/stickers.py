"""A body in one filament, smaller by the thickness of the stickers that are glued on its faces."""

from collections.abc import Sequence

from designer.builds.one_piece import printer_words
from designer.formats.folder import OutputFile
from designer.make.bed import Piece, Plate, bed_from_target
from designer.page.blocks import Section
from designer.produce import Design, Maker
from designer.report.making import sticker_blocks
from designer.report.pictures import sheet_figures
from designer.spec.spec import PrintSpec


class Stickers(Maker):
    """A plain body and printed sheets."""

    def plates(self, design: Design) -> tuple[Plate, ...]:
        """One, with the body."""
        return (Plate("", (Piece("body", design.part, bed_from_target(design.target, design.job.printing)),)),)

    def machine_words(self, printing: PrintSpec) -> str:
        """Printer and paper."""
        return f"printed stickers on a body from {printer_words(printing)}"

    def making(self, design: Design, files: Sequence[OutputFile]) -> Section:
        """Print, cut, glue."""
        lead = f"A body in one filament, and {design.target.face_count} printed stickers."
        return Section("Making it", sticker_blocks(design, sheet_figures(design)), lead)

    def next_step(self, design: Design, stem: str) -> str:
        """Both printers."""
        return (
            f"print {stem}.pdf at 100 % and {stem}.body.stl in one filament, then glue the stickers on by their numbers"
        )


MAKER = Stickers()
