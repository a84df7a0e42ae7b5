"""Flat pieces in two filaments: a few filament changes a plate, and each piece lies smooth.

A solid's faces are glued to a core; a board that is larger than the bed is joined from behind by keys.
"""

from collections.abc import Sequence
from functools import lru_cache

from designer.builds.assembling import assembling_section, jointing_section
from designer.builds.design import Design, Maker
from designer.builds.plates import plate_thumbnails
from designer.formats.folder import OutputFile
from designer.formats.png import Thumbnails
from designer.formats.project import MOST_PLATES
from designer.make.assembly import Assembly, assemble, plates_of
from designer.make.bed import Plate
from designer.make.board_tiles import board_in_pieces, board_plates
from designer.page.blocks import Section


class Tiles(Maker):
    """A solid or a board in parts."""

    def plates(self, design: Design) -> tuple[Plate, ...]:
        """What holds ink first, then core and post, or keys."""
        if design.job.target.solid is None:
            return board_plates(board_in_pieces(design.target, design.job.printing), design.job.printing)
        return plates_of(assembly_of(design), design.job.printing)

    def sample_plates(self, design: Design) -> tuple[Plate, ...]:
        """A tile stands for all that are cut alike."""
        solid, printing = design.job.target.solid, design.job.printing
        if solid is None:
            return design.plates
        return plates_of(assemble(design.target, solid, printing, is_sample=True), printing)

    def remarks(self, design: Design) -> tuple[str, ...]:
        """The mount, and how many plates."""
        inked = sum(plate.is_two_filament for plate in design.plates)
        if design.job.target.solid is None:
            board, others = board_in_pieces(design.target, design.job.printing), len(design.plates) - inked
            too_many = (
                f"project: left out, there are {len(design.plates)} plates; slicers take {MOST_PLATES} in one file"
            )
            return (
                f"plates: {inked} of {len(board.pieces)} pieces in two filaments, "
                f"{others} of {2 * len(board.seams)} keys in one",
                *((too_many,) if "project" in design.job.formats and len(design.plates) > MOST_PLATES else ()),
            )
        assembly = assembly_of(design)
        plates = f"plates: {inked} of tiles in two filaments, {len(design.plates) - inked} of the core in one"
        return tuple(line for line in (assembly.remark, plates) if line)

    def thumbnails(self, design: Design, plate: Plate) -> Thumbnails:
        """The plate from above."""
        return plate_thumbnails(design, plate)

    def making(self, design: Design, files: Sequence[OutputFile]) -> Section:
        """From plates to a measured solid, or to a board."""
        if design.job.target.solid is None:
            return jointing_section(design, board_in_pieces(design.target, design.job.printing), files)
        return assembling_section(design, assembly_of(design), files)

    def next_step(self, design: Design, stem: str) -> str:
        """Open the plates, together or one after another."""
        last = len(design.plates)
        plates = f"{stem}.plate-1.bambu.3mf to plate-{last}"
        if "project" in design.job.formats and last <= MOST_PLATES:
            plates = (
                f"{stem}.bambu-orca.3mf, the {last} plates (compare them with the page: not tried in either program),"
            )
        return (
            f"slice {plates} in Bambu Studio or OrcaSlicer, or the prusa.3mf files in "
            "PrusaSlicer; filament 1 is the body, 2 the ink"
        )


@lru_cache(maxsize=2)
def assembly_of(design: Design) -> Assembly:
    """The parts of a design, which page and files share."""
    solid = design.job.target.solid
    assert solid is not None  # noqa: S101 - the build is for solids
    return assemble(design.target, solid, design.job.printing)


MAKER = Tiles()
