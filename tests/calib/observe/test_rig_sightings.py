"""Tables of what several cameras saw: read back as written, in any order, and refused in a line."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib.core.types import RigObservations
from calib.observe.observations import known_points
from calib.observe.rig_sightings import read_rig_sightings, rig_sightings_to_csv
from designer.base.errors import InputError
from tests.support.calibrations import icosahedron
from tests.support.rig_views import ring, stereo_pair

ICO = icosahedron()
HEAD = "# camera left 640 x 480\n# camera right 1280 x 720\ncamera,frame,u,v,X,Y,Z\n"
CORNERS = ((0, 0), (20, 0), (0, 20), (20, 20), (40, 10))


def timed(seen: RigObservations) -> RigObservations:
    """With time stamps a tenth of a second apart."""
    return replace(seen, time_s=tuple(0.1 * frames for frames in seen.frame))


def rows(camera: str, frame: str, shift: float = 0.0) -> str:
    """Five points as a camera sees them."""
    return "".join(f"{camera},{frame},{100 + 3 * x + shift},{90 - 3 * y},{x},{y},0\n" for x, y in CORNERS)


def write(place: Path, text: str) -> Path:
    place.write_text(text)
    return place


@pytest.mark.parametrize("target", [None, ICO])
def test_what_is_written_reads_back(tmp_path: Path, target: object) -> None:
    """Cameras, sizes, frames, times, pixels, covariances and points, with the target's file or without."""
    wrote = timed(ring(known_points(ICO), frames=5).observations)
    path = tmp_path / "sightings.csv"
    path.write_bytes(rig_sightings_to_csv(wrote))
    read = read_rig_sightings(path, ICO if target else None)
    assert (read.camera_names, read.frame_names) == (wrote.camera_names, wrote.frame_names)
    assert read.time_s is not None
    assert wrote.time_s is not None
    for camera, (old, new) in enumerate(zip(wrote.sightings, read.sightings, strict=True)):
        np.testing.assert_array_equal(read.frame[camera], wrote.frame[camera])
        np.testing.assert_array_equal(read.time_s[camera], wrote.time_s[camera])
        assert old.image_size == new.image_size
        position = new.points.position_mm[new.point]
        as_before = np.lexsort((*old.points.position_mm[old.point].T, old.view))
        as_now = np.lexsort((*position.T, new.view))
        np.testing.assert_array_equal(new.center_px[as_now], old.center_px[as_before])
        np.testing.assert_array_equal(position[as_now], old.points.position_mm[old.point][as_before])
        assert old.cov_px2 is not None
        assert new.cov_px2 is not None
        np.testing.assert_array_equal(new.cov_px2[as_now], old.cov_px2[as_before])
    if target:
        assert read.points.geometry_id == ICO.geometry_id


def test_what_the_points_are_is_read_and_written(tmp_path: Path) -> None:
    """Circles stay circles, points of which nobody spoke are asked about again, and what photos showed are points."""
    wrote = stereo_pair(frames=4).observations
    for circle_mm, kept_mm in ((None, 0.0), (np.nan, np.nan), (13.0, 13.0), (0.0, 0.0)):
        own = None if circle_mm is None else np.full(len(wrote.points.face), circle_mm)
        points = replace(wrote.points, circle_mm=own)
        told = replace(wrote, sightings=tuple(replace(one, points=points) for one in wrote.sightings))
        path = write(tmp_path / "a.csv", rig_sightings_to_csv(told).decode())
        read = read_rig_sightings(path).points.circle_mm
        assert read is not None
        np.testing.assert_array_equal(np.unique(read), [kept_mm])
        if np.isnan(kept_mm):
            said = read_rig_sightings(path, points="circle", diameter_mm=7.0).points.circle_mm
            np.testing.assert_array_equal(np.unique(said), [7.0])
        else:
            with pytest.raises(InputError, match="leave --points out"):
                read_rig_sightings(path, points="corner")


def test_the_order_of_lines_does_not_count(tmp_path: Path) -> None:
    """Lines in any order are the same sightings."""
    text = rig_sightings_to_csv(stereo_pair(frames=4).observations).decode().splitlines()
    head, body = text[:5], text[5:]
    np.random.default_rng(0).shuffle(body)
    one = read_rig_sightings(write(tmp_path / "a.csv", "\n".join(text)))
    other = read_rig_sightings(write(tmp_path / "b.csv", "\n".join(head + body)))
    assert one.frame_names == other.frame_names
    for a, b in zip(one.sightings, other.sightings, strict=True):
        np.testing.assert_array_equal(a.center_px, b.center_px)
        np.testing.assert_array_equal(a.point, b.point)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("# camera left 640 x 480\n" + HEAD + rows("left", "1"), "camera 'left' a second time"),
        (HEAD + rows("left", "1") + rows("middle", "1"), "line 9: the image size of its camera is not known"),
        (HEAD + rows("left", "1"), "one camera, 'left'; a rig has two or more"),
        (HEAD + rows("left", "1") + rows("right", "1"), "show the same pictures"),
        (HEAD.replace("left", "../left"), "holds no sightings"),
        (HEAD.replace("left", "../left") + rows("../left", "1") + rows("right", "1", 9), "no name for a camera"),
        (HEAD.replace("left", "Right") + rows("Right", "1") + rows("right", "1", 9), "'Right' and 'right'"),
        (HEAD + rows("left", "1") + "left,1,9,9,0,0,0\n", "line 9: the same point of the same image a second time"),
        (HEAD + rows("left", "1") + rows("right", "1", 5000), "right: 1: a point at u 5"),
    ],
)
def test_what_cannot_be_is_refused_in_a_line(tmp_path: Path, text: str, said: str) -> None:
    """With the file, the value and the rule."""
    text = text.replace("1280 x 720", "640 x 480") if "same pictures" in said else text
    path = write(tmp_path / "sightings.csv", text)
    with pytest.raises(InputError) as caught:
        read_rig_sightings(path)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_camera_that_sees_a_board_mirrored_is_said(tmp_path: Path) -> None:
    """One of three whose photos were flipped: alone it gives a camera as good as any."""
    pair = stereo_pair().observations
    assert not any("mirrored" in line for line in _read(tmp_path, pair).remarks)
    right = pair.sightings[1]
    mirrored_px = np.array([right.image_size[0] - 1, 0]) + right.center_px * np.array([-1, 1])
    third = replace(right, center_px=mirrored_px)
    three = RigObservations(("a", "b", "c"), pair.frame_names, (*pair.sightings, third), (*pair.frame, pair.frame[1]))
    assert any(line.startswith("c sees the target mirrored") for line in _read(tmp_path, three).remarks)


def _read(folder: Path, seen: RigObservations) -> RigObservations:
    path = folder / "sightings.csv"
    path.write_bytes(rig_sightings_to_csv(seen))
    return read_rig_sightings(path)
