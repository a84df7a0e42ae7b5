"""What lies on the printer's bed at a time."""

from dataclasses import dataclass

from designer.base.arrays import Array
from designer.make.bed import mapped
from designer.make.mesh import Part


@dataclass(frozen=True, eq=False)
class Piece:
    """A part and where it lies; slicers show it as one object."""

    name: str
    part: Part  # in a frame of its own
    bed_from_part: Array  # (4, 4) a rigid motion; the bed's origin is a corner

    @property
    def as_it_lies(self) -> Part:
        """The part on its bed, for files that say nothing of motions."""
        motion = self.bed_from_part
        return self.part.placed(lambda points: mapped(points, motion[:3, :3]) + motion[:3, 3])


@dataclass(frozen=True)
class Plate:
    """The pieces of one print."""

    name: str  # part of its files' names, such as "plate-1"; "" where there is but one plate
    pieces: tuple[Piece, ...]
    words: str = ""  # what it holds, such as "tiles 0 to 6"
    tower_mm: tuple[float, float] | None = None  # front left corner of a prime tower in the place left free for it

    @property
    def title(self) -> str:
        """`plate 1, tiles 0 to 6`: letters that a file's name may hold, as slicers ask of a plate's name."""
        return ", ".join(part for part in (self.name.replace("-", " "), self.words) if part)

    @property
    def is_two_filament(self) -> bool:
        """Whether there is ink on it."""
        return any(piece.part.ink is not None for piece in self.pieces)
