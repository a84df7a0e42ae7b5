"""Pieces that sit in each other's places: told once of all photos, or not at all."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from calib.core.types import Detections, FaceRecord
from calib.observe.dataset import read_detections, write_detections
from calib.observe.observations import misplaced_pieces, observations_from_detections
from tests.calib.observe.test_dataset import ICO, seen


def photos(face: int, codes: list[int | None]) -> list[Detections]:
    """Photos of a face that shows the codes of others, or None: its own."""
    rng, other = np.random.default_rng(1), FaceRecord(1, (), 0, 7, 7, ())
    return [
        replace(
            seen(f"{number}.png", 20, rng),
            remarks=(),
            faces=(FaceRecord(face, () if code else ("dot",), 4, 7, 7, (), carries=code), other),
        )
        for number, code in enumerate(codes)
    ]


def test_most_photos_decide() -> None:
    """Another's code in most photos, and in two at the least, is told with the counts; a misreading is not."""
    (line,) = misplaced_pieces(photos(7, [12, 12, None, 12]))
    assert line.startswith("face 7 carries the code of face 12 in 3 of 4 photos: ")
    (line,) = misplaced_pieces(photos(7, [7, 7]))
    assert line.startswith("face 7 lies turned on its place in 2 of 2 photos: ")
    for codes in ([12], [None, None, 12, 12], [12, 9, 5], [None, None]):
        assert misplaced_pieces(photos(7, codes)) == ()


def test_it_is_told_of_photos_and_of_their_file_alike(tmp_path: Path) -> None:
    """What is solved from photos, or from the table of them, carries the line; without the records there is none."""
    found, path = photos(7, [12, 12, 12]), tmp_path / "detections.csv"
    (line,) = misplaced_pieces(found)
    assert line in observations_from_detections(found, ICO).remarks
    write_detections(path, found, ICO)
    read = read_detections(path, ICO, target_path=Path("ico.target.json"))
    assert line in observations_from_detections(read, ICO).remarks
    path.with_suffix(".records.json").unlink()
    read = read_detections(path, ICO, target_path=Path("ico.target.json"))
    assert line not in observations_from_detections(read, ICO).remarks
