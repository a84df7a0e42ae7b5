"""Photos of several cameras are joined to frames, or refused in a line; so are tables of what they saw."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib.core.types import RigObservations
from calib.observe.observations import known_points
from calib.observe.rig_observations import read_rig_sightings, rig_sightings_to_csv
from calib.observe.rig_photos import (
    RigPhoto,
    RigPhotos,
    is_sightings,
    joined_by_name,
    photos_by_pattern,
    photos_in_folders,
    read_photo_table,
    read_stamps,
    with_stamps,
)
from calib.observe.rig_search import joined_by_time, stamped_by_name
from designer.base.errors import InputError
from tests.support.calibrations import icosahedron
from tests.support.rig_views import ring, stereo_pair


def made(folder: Path, *names: str) -> Path:
    """A folder with empty files, whose names are all that counts here."""
    for name in names:
        place = folder / name
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_bytes(b"")
    return folder


def frames_of(found: RigPhotos) -> dict[str, list[str]]:
    """The cameras and files of each frame."""
    return {
        frame: [f"{one.camera}:{one.path.name}" for one in found.photos if one.frame == frame]
        for frame in found.frame_names
    }


@pytest.mark.parametrize(
    ("left", "right", "frames"),
    [
        (("1.png", "2.png", "10.png"), ("2.jpg", "10.jpg"), ["1", "2", "10"]),
        (("left_1.png", "left_2.png"), ("RIGHT-1.png", "RIGHT-3.png"), ["1", "2", "3"]),
        (("IMG_0007.png", "IMG_0008.png"), ("DSC7.png", "DSC9.png"), ["7", "8", "9"]),
        (("a_2026_0007.png", "a_2026_0008.png"), ("b_7.png", "b_8.png"), ["7", "8"]),
    ],
)
def test_names_join(tmp_path: Path, left: tuple[str, ...], right: tuple[str, ...], frames: list[str]) -> None:
    """By the whole name, less the camera's, or by its numbers; frames in the order of their numbers."""
    made(tmp_path / "left", *left)
    made(tmp_path / "right", *right)
    found = joined_by_name(photos_in_folders([str(tmp_path / "left"), str(tmp_path / "right")]))
    assert list(found.frame_names) == frames
    assert found.camera_names == ("left", "right")
    assert frames_of(joined_by_name(photos_in_folders([str(tmp_path)]))) == frames_of(found)


def test_cameras_are_named_where_their_paths_differ(tmp_path: Path) -> None:
    """`cam0/data` and `cam1/data` are cam0 and cam1; one folder twice is refused."""
    made(tmp_path, "cam0/data/1.png", "cam1/data/1.png")
    places = [str(tmp_path / "cam0/data"), str(tmp_path / "cam1/data")]
    assert joined_by_name(photos_in_folders(places)).camera_names == ("cam0", "cam1")
    with pytest.raises(InputError, match="is given twice"):
        photos_in_folders([places[0], f"{places[0]}/../data"])


def test_a_pattern_tells_camera_and_frame(tmp_path: Path) -> None:
    """Of names or of paths; what is named otherwise is counted."""
    made(tmp_path, "cam1_007.png", "cam2_007.png", "cam2_008.png", "notes.png", "a/7.png", "b/7.png")
    found = photos_by_pattern([str(tmp_path)], "{camera}_{frame}.png")
    assert frames_of(found) == {"007": ["cam1:cam1_007.png", "cam2:cam2_007.png"], "008": ["cam2:cam2_008.png"]}
    assert "1 images are not named as" in found.remarks[0]
    assert photos_by_pattern([str(tmp_path)], "{camera}/{frame}.*").camera_names == ("a", "b")
    for pattern, said in (("{camera}.png", "must hold {frame} once"), ("x{camera}_{frame}.png", "no image in")):
        with pytest.raises(InputError, match=said):
            photos_by_pattern([str(tmp_path)], pattern)


@pytest.mark.parametrize(
    ("names", "pattern", "cameras"),
    [
        ("left01 left02 left03 right01 right02 right03", "{camera}{frame}.*", ("left", "right")),
        (
            f"{' '.join(f'{c}{k:02}' for c in ('left', 'right') for k in range(8))} extra",
            "{camera}{frame}.*",
            ("left", "right"),
        ),
        ("01L 02L 03L 01R 02R 03R", "{frame}{camera}.*", ("L", "R")),
        ("cam1_007 cam2_007 cam1_008 cam2_008 cam1_009 cam2_009", "{camera}_{frame}.*", ("cam1", "cam2")),
        ("7-a 8-a 9-a 7-b 8-b 9-b", "{frame}-{camera}.*", ("a", "b")),
        ("img_l_1 img_l_2 img_l_3 img_r_1 img_r_2 img_r_3", "*_{camera}_{frame}.*", ("l", "r")),
    ],
)
def test_one_folder_for_all_cameras_is_told_its_pattern(
    tmp_path: Path, names: str, pattern: str, cameras: tuple[str, str]
) -> None:
    """The pattern that the names have is proposed with its cameras, and joins them."""
    made(tmp_path, *(f"{name}.jpg" for name in names.split()))
    with pytest.raises(InputError, match=re.escape(f"--pattern '{pattern}', by which they are of '{cameras[0]}'")):
        photos_in_folders([str(tmp_path)])
    found = photos_by_pattern([str(tmp_path)], pattern)
    assert found.camera_names == cameras
    assert all(len(of_frame) == 2 for of_frame in frames_of(found).values())


def test_one_folder_of_one_camera_is_told_no_pattern(tmp_path: Path) -> None:
    """Names that tell no cameras get an example only."""
    made(tmp_path, "IMG_0001.jpg", "IMG_0002.jpg", "IMG_0003.jpg")
    with pytest.raises(InputError, match=re.escape("or --pattern '{camera}_{frame}.png'")):
        photos_in_folders([str(tmp_path)])


def test_frames_that_match_nothing_are_told_by_name(tmp_path: Path) -> None:
    """With the names that were seen."""
    made(tmp_path, "left/a.png", "left/b.png", "right/c.png")
    with pytest.raises(InputError, match=r"no frame is of two cameras: left has 'a', 'b'; right has 'c'; name the"):
        joined_by_name(photos_in_folders([str(tmp_path)]))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("camera,file\nleft,left/1.png\n", "neither a column frame nor time_s"),
        ("camera,frame,file\nleft,1,left/1.png\nleft,1,left/2.png\nright,1,right/1.png\n", "has 2 photos of frame '1'"),
        (
            "camera,frame,file\nleft,1,left/1.png\nright,1,left/1.png\n",
            "is given twice, for cameras 'left' and 'right'",
        ),
        ("camera,frame,file\nleft,1,\n", "line 2: file must not be empty"),
        ("camera,frame,file\nleft,1,a\0b\n", "line 2"),
    ],
)
def test_a_table_that_cannot_be_is_refused(tmp_path: Path, text: str, said: str) -> None:
    """In a line with the file's name or the photo's."""
    from calib.observe.rig_photos import framed

    path = tmp_path / "files.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=said):
        framed(read_photo_table(path))


def test_a_table_names_files_from_its_folder(tmp_path: Path) -> None:
    """And says what it is: of files, or of sightings."""
    made(tmp_path, "left/1.png", "right/x.png")
    (tmp_path / "files.csv").write_text(
        "# mine\nframe,file,camera,time_s\n1,left/1.png,left,4.5\n1,right/x.png,right,4.6\n"
    )
    photos = read_photo_table(tmp_path / "files.csv")
    assert photos[1] == RigPhoto("right", tmp_path / "right/x.png", "1", 4.6)
    (tmp_path / "stamps.csv").write_text("camera,file,time_s\nleft,1.png,1.5\nright,right/x.png,1.75\n")
    stamped = with_stamps(photos, read_stamps(tmp_path / "stamps.csv", photos))
    assert [one.time_s for one in stamped] == [1.5, 1.75]
    (tmp_path / "stamps.csv").write_text("camera,file,time_s\nleft,1.png,1.5\n")
    with pytest.raises(InputError, match=r"no time stamp for 'x.png'"):
        with_stamps(photos, read_stamps(tmp_path / "stamps.csv", photos))
    (tmp_path / "seen.csv").write_text("camera,frame,u,v,X,Y,Z\n")
    assert is_sightings(tmp_path / "seen.csv")
    assert not is_sightings(tmp_path / "files.csv")


def shots(period_s: float = 0.1, count: int = 20, late_s: float = 0.004, seed: int = 0) -> list[RigPhoto]:
    """Three cameras that take a photo every so often; the second misses some, the third runs late."""
    rng = np.random.default_rng(seed)
    photos = []
    for camera, shift_s in (("a", 0.0), ("b", 0.001), ("c", late_s)):
        for n in range(count):
            if camera != "b" or n % 3:
                stamp = 100 + n * period_s + shift_s + rng.uniform(0, 1e-3)
                photos.append(RigPhoto(camera, Path(f"{camera}/{n:03d}.png"), time_s=stamp))
    return photos


def test_time_stamps_join_what_was_taken_at_once() -> None:
    """Each photo once, with its own moment, and how far apart they lie is said; the order of photos does not count."""
    photos = shots()
    found = joined_by_time(photos, 0.02)
    assert len(found.frame_names) == 20
    for frame in found.frame_names:
        assert len({one.path.name for one in found.photos if one.frame == frame}) == 1
    assert sum(len(names) == 2 for names in frames_of(found).values()) == 7
    assert found.remarks[0].startswith("joined by time stamps: 20 frames of two cameras or more, their photos")
    other = joined_by_time(photos[::-1], 0.02)
    assert {name: sorted(files) for name, files in frames_of(other).items()} == frames_of(found)
    assert (other.camera_names, found.camera_names) == (("c", "b", "a"), ("a", "b", "c"))


def test_photos_that_lie_too_far_apart_stay_alone() -> None:
    """A camera beyond the tolerance joins nothing; when none joins, the clocks are told; a doubtful tolerance, too."""
    found = joined_by_time(shots(late_s=0.04), 0.02)
    assert "27 of 53 photos have none of another camera within 20 ms" in found.remarks
    with pytest.raises(InputError, match=r"within 0.001 ms of each other: a from 100.001 to 101.9"):
        joined_by_time(shots(), 1e-6)
    assert any("may be chance" in line for line in joined_by_time(shots(), 0.06).remarks)


def test_paths_of_windows_name_files_of_folders(tmp_path: Path) -> None:
    """A backslash parts folders as a slash does."""
    (tmp_path / "files.csv").write_text("camera,frame,file\nleft,1,left\\1.png\nright,1,right/1.png\n")
    assert [one.path for one in read_photo_table(tmp_path / "files.csv")] == [
        tmp_path / "left/1.png",
        tmp_path / "right/1.png",
    ]


def test_names_that_are_time_stamps_join_photos_of_two_clocks() -> None:
    """Nanoseconds in 19 digits are seconds; names that cameras have alike, or of other kinds, are names."""
    stamps = {"left": (1700000000000000000, 1700000001000000000), "right": (1700000000004000000, 1700000001002000000)}
    photos = tuple(RigPhoto(name, Path(f"{name}/{stamp}.png"), "") for name, own in stamps.items() for stamp in own)
    assert [one.time_s for one in stamped_by_name(photos)] == pytest.approx([0.0, 1.0, 0.004, 1.002], abs=1e-9)
    named = (*photos[:2], *(RigPhoto("right", Path(f"right/{one.path.name}"), "") for one in photos[:2]))
    assert [one.time_s for one in stamped_by_name(named)] == [None] * 4


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
    for camera, (old, new) in enumerate(zip(wrote.sightings, read.sightings, strict=True)):
        np.testing.assert_array_equal(read.frame[camera], wrote.frame[camera])
        np.testing.assert_array_equal(read.time_s[camera], wrote.time_s[camera])
        assert old.image_size == new.image_size
        position = new.points.position_mm[new.point]
        as_before = np.lexsort((*old.points.position_mm[old.point].T, old.view))
        as_now = np.lexsort((*position.T, new.view))
        np.testing.assert_array_equal(new.center_px[as_now], old.center_px[as_before])
        np.testing.assert_array_equal(position[as_now], old.points.position_mm[old.point][as_before])
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
