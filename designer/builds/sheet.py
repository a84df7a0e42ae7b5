"""Artwork that a print shop puts on one sheet or plate."""

from collections.abc import Sequence

from designer.base.units import SCALE_BAR_MM
from designer.builds.design import Design, Maker
from designer.builds.pictures import sheet_figures
from designer.formats.folder import OutputFile
from designer.make.bed import Plate
from designer.page.blocks import Section, Steps
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
        name = design.job.name
        shop = Steps((
            f"Send {name}.pdf, or {name}.svg to shops that cut: to be printed at 100 %, not traced. Magenta lines are "
            "the cut, all else is ink.",
            "Matt, no gloss laminate: mirrored lamps hide marks. Deep black on white.",
            "On a stiff flat plate, such as aluminium composite of 3 mm or more, or glass; printed straight on it "
            f"there is neither glue nor bubbles. {name}.body.stl is a bare plate to print, which warps.",
            f"Measure the scale bar when it comes: {SCALE_BAR_MM:g} mm, and along both directions of the board: "
            "carriage and feed can be off by different amounts.",
            "Keep it flat: hold it by its edges, store it lying.",
        ))  # fmt: skip
        return Section("Making it", (shop, *sheet_figures(design)), "A sheet from a print shop.")

    def next_step(self, design: Design, stem: str) -> str:
        """Send it."""
        return f"have {stem}.pdf printed at 100 % and measure its scale bar"


MAKER = Sheet()
