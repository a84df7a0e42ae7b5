"""An AprilGrid as Kalibr has it: square tags in rows, whose points are the tags' corners."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from designer.base.arrays import Array, Rows
from designer.marks.face_marks import FaceMarks, lattice


@dataclass(frozen=True)
class AprilGrid(FaceMarks):
    """Tags row by row from the lower left, as Kalibr numbers them; of each its corners from the lower left one, ccw."""

    kind: ClassVar[str] = "aprilgrid"

    tags: tuple[int, int]  # columns, rows
    tag_mm: float  # side of a tag, its black border included
    spacing: float = 0.3  # the gap between two tags, in sides of a tag
    dictionary: str = "DICT_APRILTAG_36h11"
    first_id: int = 0
    border_bits: int = 2  # of black around a tag's bits: Kalibr prints 2, others 1
    corner_squares: bool = True  # small black squares between the tags' corners, which make saddles of them
    from_top: bool = False  # tags are numbered from the upper left instead

    def __post_init__(self) -> None:
        if min(self.tags) < 1 or max(self.tags) < 2:
            raise ValueError(f"an AprilGrid has at least 2 x 1 tags, not {self.tags[0]} x {self.tags[1]}")
        if not self.tag_mm > 0 or not 0 < self.spacing < 2:
            raise ValueError(f"tags of {self.tag_mm:g} mm must be above 0, gaps of {self.spacing:g} sides in 0..2")

    @property
    def pitch_mm(self) -> float:
        """From tag to tag."""
        return self.tag_mm * (1 + self.spacing)

    @property
    def index(self) -> Rows:
        """Of the lattice of corners, two columns and two rows a tag, from the lower left."""
        at = lattice(*self.tags)
        if self.from_top:
            at = np.column_stack([at[:, 0], self.tags[1] - 1 - at[:, 1]])
        corner = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
        index: Rows = (2 * at[:, None] + corner).reshape(-1, 2)
        return index

    @property
    def position_mm(self) -> Array:
        """Of the tags' corners."""
        tag, corner = np.divmod(self.index, 2)
        at: Array = tag * self.pitch_mm + corner * self.tag_mm - np.array(self._tags_mm) / 2
        return at

    @property
    def _tags_mm(self) -> tuple[float, float]:
        gap = self.tag_mm * self.spacing
        return self.tags[0] * self.pitch_mm - gap, self.tags[1] * self.pitch_mm - gap

    @property
    def size_mm(self) -> tuple[float, float]:
        """Of the tags, with the small squares around them if there are any."""
        width, height = self._tags_mm
        more = 2 * self.tag_mm * self.spacing * self.corner_squares
        return width + more, height + more

    @property
    def words(self) -> str:
        """With its tags."""
        return f"AprilGrid of {self.tags[0]} x {self.tags[1]} tags of {self.tag_mm:g} mm from {self.dictionary}"


MARKS = AprilGrid
