"""A body in one filament, resin or metal, whose grooves paint fills: what a hand inlays, a machine has measured out.

The rims of the grooves are in the face, so that walls with paint on them change nothing in what a camera sees: from
wherever it looks, black begins and ends at the rims (`designer.tolerance.sources.wall` has what else they may do).
"""

from collections.abc import Sequence

from designer.builds.design import Design
from designer.builds.one_piece import OnePiece
from designer.builds.slicing import colour_words, print_settings
from designer.formats.folder import OutputFile
from designer.make.bed import Piece, Plate, bed_from_target
from designer.make.mesh import Part
from designer.page.blocks import Fold, Section, Steps


class Recessed(OnePiece):
    """A body with grooves."""

    def plates(self, design: Design) -> tuple[Plate, ...]:
        """One, with the body."""
        motion = bed_from_target(design.target, design.job.printing)
        return (Plate("", (Piece(design.job.name, Part(design.part.body, None), motion),)),)

    def making(self, design: Design, files: Sequence[OutputFile]) -> Section:
        """Settings of a printer, what to send to others, and how grooves are filled."""
        name, printing, target = design.job.name, design.job.printing, design.target
        lying = "grooves up" if target.is_plate else f"face {target.face_count - 1} down, as in the file"
        settings = print_settings(design, printing.printer.machine.shells, lying)
        ink = colour_words(printing.ink_colour)
        body = Steps((
            f"Print {name}.prusa.3mf or .bambu.3mf in one filament; or send {name}.body.stl (--formats step: true "
            f"circles) to be sintered, cast or milled, white and matt. Grooves are {printing.inlay_mm:g} mm deep.",
            "Ask for walls without draft; of draft the rims count, which are in the face.",
        ))  # fmt: skip
        paint = Steps((
            "Printed layers let paint creep under: spray a coat of clear varnish over the face first, and let it dry.",
            f"Fill the grooves with {ink} paint, or with resin coloured {ink} from a syringe, up to the rims: walls "
            "must be black. Less in two coats is better than too much in one.",
            "Wipe the face with a card wrapped in cloth before it dries; sand it flat when it is hard, on a plate.",
            "What is left on white moves marks: scrape it off. A dull finish; gloss mirrors lamps.",
        ))  # fmt: skip
        return Section(
            "Making it",
            (settings, Fold("1. The body", (body,), is_open=True), Fold("2. Fill the grooves", (paint,), is_open=True)),
            "A body in one material, and paint in its grooves.",
        )

    def next_step(self, design: Design, stem: str) -> str:
        """One filament, then paint."""
        return f"print {stem}.prusa.3mf or {stem}.body.stl in one filament, then fill the grooves with paint"


MAKER = Recessed()
