"""Names of ChArUco and AprilGrid corners in photos with clutter and covers, beside OpenCV's own.

`python -m tests.benchmarks.bench_boards [PHOTOS]`, 200 of each kind by default. Recall is of corners in plain view;
a name is wrong where it stands more than 1.5 px from its place, or where the photo does not show the board at all.
"""

import sys
import time
from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np

from calib.detector.boards import detect_boards
from designer.marks.aprilgrid import AprilGrid
from designer.marks.charuco import Charuco
from designer.marks.face_marks import FaceMarks
from designer.target import target_of_marks
from tests.support.cluttered_boards import Array, BoardPhoto, Pixels, dictionary, opencv_board, photo_of, random_pose

Named = tuple[Array, Array]
"""Rows of the board's points, and where they were found."""
BOARDS: dict[str, tuple[FaceMarks, ...]] = {
    "charuco": (
        Charuco((9, 7), 20.0, 15.0, "DICT_5X5_100"),
        Charuco((5, 7), 20.0, 14.0, "DICT_4X4_50"),
        Charuco((14, 9), 20.0, 15.5, "DICT_5X5_250"),
        Charuco((8, 6), 20.0, 15.0, "DICT_6X6_250", first_id=40),
    ),
    "aprilgrid": (
        AprilGrid((6, 6), 20.0),
        AprilGrid((7, 5), 20.0, 0.25, first_id=10, border_bits=1, corner_squares=False),
        AprilGrid((5, 4), 20.0, 0.3),
    ),
}
CLUTTER: tuple[FaceMarks, ...] = (
    Charuco((6, 5), 20.0, 15.0, "DICT_5X5_100"),
    Charuco((9, 7), 20.0, 15.0, "DICT_4X4_50"),
    AprilGrid((3, 3), 20.0),
    Charuco((7, 10), 20.0, 15.0, "DICT_6X6_250"),
)


@dataclass
class Tally:
    """What one detector made of the photos."""

    visible: int = 0
    found: int = 0
    wrong: int = 0
    photos: int = 0
    seconds: float = 0.0

    def add(self, photo: BoardPhoto, find: Callable[[Pixels], Named], is_there: bool) -> tuple[int, int]:
        """Count one photo; returns how many were wrong and found."""
        start = time.process_time()
        rows, at = find(photo.pixels)
        self.seconds += time.process_time() - start
        near = np.linalg.norm(at - photo.point_px[rows.astype(int)], axis=1) < 1.5
        wrong = int((~near).sum()) if is_there else len(rows)
        found = int((near & photo.is_visible[rows.astype(int)]).sum())
        self.photos += 1
        self.visible, self.found, self.wrong = (
            self.visible + int(photo.is_visible.sum()),
            self.found + found,
            self.wrong + wrong,
        )
        return wrong, found

    def words(self) -> str:
        """A line."""
        return (
            f"recall {self.found / max(self.visible, 1):.4f} of {self.visible}, wrong {self.wrong}, "
            f"{1e3 * self.seconds / max(self.photos, 1):.0f} ms a photo"
        )


def ours(marks: FaceMarks) -> Callable[[Pixels], Named]:
    """Named and measured."""
    target = target_of_marks([marks], np.eye(4)[None])

    def find(pixels: Pixels) -> Named:
        found = detect_boards(pixels, target, name="photo")
        return found.ring.astype(float), found.center_px

    return find


def opencv(marks: FaceMarks) -> Callable[[Pixels], Named]:
    """CharucoDetector, or ArucoDetector with refined corners."""
    parameters = cv2.aruco.DetectorParameters()
    if isinstance(marks, Charuco):
        charuco = cv2.aruco.CharucoDetector(opencv_board(marks), cv2.aruco.CharucoParameters(), parameters)

        def find(pixels: Pixels) -> Named:
            corner, number, _, _ = charuco.detectBoard(pixels)
            if corner is None or number is None or not len(number):
                return np.zeros(0), np.zeros((0, 2))
            return np.asarray(number, float).reshape(-1), np.asarray(corner, float).reshape(-1, 2)

        return find
    assert isinstance(marks, AprilGrid)
    parameters.markerBorderBits = marks.border_bits
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    aruco = cv2.aruco.ArucoDetector(dictionary(marks.dictionary), parameters)

    def find_tags(pixels: Pixels) -> Named:
        corners, numbers, _ = aruco.detectMarkers(pixels)
        if numbers is None:
            return np.zeros(0), np.zeros((0, 2))
        number = np.asarray(numbers).reshape(-1) - marks.first_id
        own = (number >= 0) & (number < marks.tags[0] * marks.tags[1])
        at = np.array(corners, float).reshape(-1, 4, 2)[own]
        row = 4 * number[own][:, None] + np.array([1, 0, 3, 2])
        return row.reshape(-1).astype(float), at.reshape(-1, 2)

    return find_tags


def main(photos: int, first: int = 0) -> None:
    """Both detectors in the same photos."""
    for kind, boards in BOARDS.items():
        us, them = Tally(), Tally()
        for number in range(first, first + photos):
            rng = np.random.default_rng(number)
            marks = boards[number % len(boards)]
            others = tuple(CLUTTER[k] for k in rng.permutation(len(CLUTTER))[: rng.integers(3)])
            is_there = rng.random() > 0.08
            photo = photo_of(
                marks, random_pose(rng), rng, clutter=others, covers=int(rng.integers(5)), is_there=is_there,
                blur_px=float(rng.uniform(0.4, 1.6)), noise=float(rng.uniform(0.5, 6)),
            )  # fmt: skip
            wrong, found = us.add(photo, ours(marks), is_there)
            _, theirs = them.add(photo, opencv(marks), is_there)
            if wrong or theirs > found + 8:
                print(f"  {kind} {number}: {wrong} wrong, {found} of {photo.is_visible.sum()}, OpenCV {theirs}")
        print(f"{kind}: ours {us.words()}\n{kind}: OpenCV {them.words()}", flush=True)


if __name__ == "__main__":
    main(*(int(word) for word in sys.argv[1:] or ["200"]))
