"""Artwork that a print shop puts on one sheet or plate."""

from collections.abc import Sequence

from designer.formats.folder import OutputFile
from designer.make.bed import Plate
from designer.page.blocks import Section
from designer.produce import Design, Maker
from designer.report.making import sheet_blocks
from designer.report.pictures import sheet_figures
from designer.spec.spec import PrintSpec


class Sheet(Maker):
    """A printed sheet."""

    def plates(self, design: Design) -> tuple[Plate, ...]:
        """Nothing is printed of plastic."""
        return ()

    def machine_words(self, printing: PrintSpec) -> str:
        """The sheet."""
        return "a printed sheet"

    def making(self, design: Design, files: Sequence[OutputFile]) -> Section:
        """What to tell the shop."""
        return Section("Making it", (*sheet_blocks(design), *sheet_figures(design)), "A sheet from a print shop.")

    def next_step(self, design: Design, stem: str) -> str:
        """Send it."""
        return f"have {stem}.pdf printed at 100 % and measure its scale bar"


MAKER = Sheet()
