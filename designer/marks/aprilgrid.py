"""An AprilGrid as Kalibr has it: square tags in rows, whose points are the tags' corners."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from designer.base.arrays import Array, Rows
from designer.marks.dictionaries import TAG_TURN, check_markers, family_of, marker_cells, marker_mm
from designer.marks.face_marks import FaceMarks, check_marks, lattice, rectangle_mm


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
    upright: bool = False  # tags stand as OpenCV draws them; else as AprilTag and Kalibr print them: see `is_turned`

    def __post_init__(self) -> None:
        check_marks(self.tags, (2, 1), "tags", tags=self.tag_mm)
        if not 0 < self.spacing < 2:
            raise ValueError(f"gaps of {self.spacing:g} sides of a tag: must be above 0 and below 2")
        if not 1 <= self.border_bits <= 3:
            raise ValueError(f"borders of {self.border_bits} bits: must be 1 to 3")
        check_markers(self.dictionary, self.first_id, len(self.marker_ids))

    @property
    def marker_ids(self) -> range:
        """Of the tags, in the order of the points."""
        return range(self.first_id, self.first_id + self.tags[0] * self.tags[1])

    @property
    def family(self) -> str:
        """See `FaceMarks.family`."""
        return family_of(self.dictionary)

    @property
    def following(self) -> "AprilGrid":
        """See `FaceMarks.following`."""
        return replace(self, first_id=self.marker_ids.stop)

    @property
    def is_turned(self) -> bool:
        """Whether tags stand on their heads against OpenCV's pictures, whose first corner is then the lower right.

        Of the AprilTag families OpenCV has the bits of the others' pictures from the last to the first.
        """
        return not self.upright and self.dictionary.startswith(TAG_TURN)

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
    def reach_mm(self) -> float:
        """Half of a small square between tags; without these, half of a tag's side."""
        return self.tag_mm * (min(self.spacing, 1.0) if self.corner_squares else 1.0) / 2

    @property
    def clear_mm(self) -> float:
        """To the bits within a tag's border, of at most 8 in a row."""
        return min(self.reach_mm, self.tag_mm * self.border_bits / (8 + 2 * self.border_bits))

    @property
    def is_crossing(self) -> bool:
        """As the small squares make it."""
        return self.corner_squares

    @property
    def least_mm(self) -> float:
        """Of a tag's cell, and of the gap."""
        cells = len(marker_cells(self.dictionary, self.first_id, self.border_bits))
        return min(self.tag_mm / cells, self.tag_mm * self.spacing)

    @property
    def words(self) -> str:
        """With its tags."""
        return f"AprilGrid of {self.tags[0]} x {self.tags[1]} tags of {self.tag_mm:g} mm from {self.dictionary}"

    @property
    def order(self) -> str:
        """Of tags and of their corners."""
        ids, side = self.marker_ids, "upper" if self.from_top else "lower"
        return (
            f"tags {ids[0]} to {ids[-1]} row by row from the {side} left; of each its corners from the lower left, "
            "counter-clockwise"
        )

    @property
    def kalibr_fields(self) -> Mapping[str, str | int | float | bool]:
        """In metres; Kalibr finds only tags as it prints them."""
        as_printed = AprilGrid(self.tags, self.tag_mm, self.spacing, corner_squares=self.corner_squares)
        counts = {"tagCols": self.tags[0], "tagRows": self.tags[1]}
        sizes = {"tagSize": round(self.tag_mm / 1000, 12), "tagSpacing": self.spacing}
        return {"target_type": "aprilgrid", **counts, **sizes} if self == as_printed else {}

    @property
    def polygons_mm(self) -> tuple[Array, ...]:
        """What is black of the tags, and the small squares between their corners."""
        found = []
        for number, corner in zip(self.marker_ids, self.position_mm[::4], strict=True):
            cells = marker_cells(self.dictionary, number, self.border_bits)
            found += marker_mm(cells[::-1, ::-1] if self.is_turned else cells, corner, self.tag_mm)
        if self.corner_squares:
            gap = self.tag_mm * self.spacing
            first = -np.array(self._tags_mm) / 2 - gap
            at = first + self.pitch_mm * lattice(self.tags[0] + 1, self.tags[1] + 1)
            found += [rectangle_mm(x, y, gap, gap) for x, y in at.tolist()]
        return tuple(found)


MARKS = AprilGrid
