"""A body in one filament, smaller by the thickness of the stickers that are glued on its faces."""

from collections.abc import Sequence

from designer.base.units import NO_SKEW, SCALE_BAR_MM
from designer.base.words import capital
from designer.builds.design import Design, Maker
from designer.builds.pictures import sheet_figures
from designer.builds.slicing import scale_words, turn_words
from designer.formats.folder import OutputFile
from designer.kinds.layout import joined_faces, lip_of
from designer.make.bed import Piece, Plate, bed_from_target
from designer.make.lip import engraved
from designer.make.printability import count_words
from designer.page.blocks import Fold, Section, Steps
from designer.spec.machine import Shells
from designer.spec.spec import PrintSpec


class Stickers(Maker):
    """A plain body and printed sheets."""

    def plates(self, design: Design) -> tuple[Plate, ...]:
        """One, with the body."""
        return (Plate("", (Piece("body", design.part, bed_from_target(design.target, design.job.printing)),)),)

    def machine_words(self, printing: PrintSpec) -> str:
        """Printer and paper."""
        return f"printed stickers on a body from {super().machine_words(printing)}"

    def making(self, design: Design, files: Sequence[OutputFile]) -> Section:
        """Print, cut, glue."""
        job, printing, count = design.job, design.job.printing, len(design.pages)
        beside = [each for each in joined_faces(design.target)[0] if each >= 0] or [0]
        lies = f"{capital(turn_words(printing))}. " if printing.skew_compensation_rad != NO_SKEW else ""
        by_number = (
            f"Glue face 0 on any face, its border along the {count_words(len(beside))} edges; then its neighbours: "
            f"its edge 'joins {beside[0]}' meets the edge 'joins 0' of face {beside[0]}."
        )
        if engraved(design.target, 0, printing):
            by_number = "The body has each number engraved where its sticker lies, and an arrow to the code corner."
        frames, drop = "", ""
        lay: tuple[str, ...] = ()
        if printing.lip:
            lip = lip_of(design.target, printing)
            frames = f"Lips stand {lip.rise_mm:.2g} mm out around stickers; in black they belong to the border. "
            drop = f", rather inside than outside: it has {lip.clearance_mm:g} mm around it in its lip"
            lay = (
                "Lay one edge against the lip, then the rest down. What does not drop in is trimmed, not pressed.",
                "The face that lay on the bed has a groove around it in place of a lip: aim at its inner edge.",
            )
        body = Steps((
            f"Open {job.name}.body.stl in your slicer; one filament, matt. Every face is "
            f"{printing.sticker_thickness_mm:g} mm lower than the target's, for the sticker. {frames}"
            f"{lies}Scale: {scale_words(printing)}.",
            f"Layer height {printing.printer.layer_height_mm:g} mm, {Shells().words()}; ironing off. Remove blobs and "
            "seams: a sticker over them is not flat.",
        ))  # fmt: skip
        sheets = Steps((
            f"Print {job.name}.pdf, {count} page{'s' * (count > 1)} of {job.page}, at 100 %, never 'fit to page', on "
            f"matt label stock {printing.sticker_thickness_mm:g} mm thick.",
            f"Measure the scale bar of every sheet: {SCALE_BAR_MM:g} mm; if off by more than 0.1 mm (0.1 %), mend the "
            "printer's scale and print again.",
            f"Cut along the thin line with knife and ruler{drop}; the marks at the corners show where to lay it.",
        ))  # fmt: skip
        glue = Steps((
            f"A triangle outside a sticker points at its code corner; 'FACE 0' is its number, 'joins {beside[0]}' "
            "names the face across that edge.",
            by_number,
            *lay,
            "Rub down from the middle outwards: bubbles and folds are errors of the target.",
            "Compare with the net before the glue sets: calib leaves out a face in another's place, or turned.",
        ))  # fmt: skip
        return Section(
            "Making it",
            (Fold("1. The body", (body,), is_open=True),
             Fold("2. The sheets", (sheets, *sheet_figures(design)), is_open=True),
             Fold("3. Glue by numbers", (glue,), is_open=True)),
            f"A body in one filament, and {design.target.face_count} printed stickers.",
        )  # fmt: skip

    def next_step(self, design: Design, stem: str) -> str:
        """Both printers."""
        return (
            f"print {stem}.pdf at 100 % and {stem}.body.stl in one filament, then glue the stickers on by their numbers"
        )


MAKER = Stickers()
