"""One piece in two filaments: the ink is set into the body, and both lie on the bed as one object."""

from collections.abc import Sequence

from designer.builds.design import Design, Maker
from designer.builds.slicing import print_settings, slicer_folds
from designer.formats.folder import OutputFile
from designer.make.bed import Piece, Plate, bed_from_target, mapped, printed_corners_mm, tower_area
from designer.page.blocks import Section


class OnePiece(Maker):
    """A two-filament print."""

    def plates(self, design: Design) -> tuple[Plate, ...]:
        """One, with the whole target."""
        printing, motion = design.job.printing, bed_from_target(design.target, design.job.printing)
        corners = mapped(printed_corners_mm(design.target, printing), motion[:3, :3]) + motion[:3, 3]
        tower = tower_area(corners[:, :2], printing.printer)
        return (Plate("", (Piece(design.job.name, design.part, motion),), tower_area=tower),)

    def making(self, design: Design, files: Sequence[OutputFile]) -> Section:
        """The settings, and the steps in a slicer."""
        target = design.target
        lying = f"face {target.face_count - 1} down, as in the file"
        if target.has_back:
            lying = "the back (face 1) down, as flat and glossy as the bed; the front shows its lines"
        elif target.is_plate:
            lying = "printed side down: the bed makes the ink flat"
        settings = print_settings(design, design.job.printing.printer.machine.shells, lying)
        return Section("Making it", (settings, *slicer_folds(design, files)))

    def next_step(self, design: Design, stem: str) -> str:
        """Open the package."""
        slicers = f"{stem}.bambu.3mf in Bambu Studio or OrcaSlicer, or {stem}.prusa.3mf in PrusaSlicer"
        return f"open {slicers}; filament 1 is the body, 2 the ink"


MAKER = OnePiece()
