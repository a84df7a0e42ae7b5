"""Poses for a known camera: the numbers, their stated accuracy, and the command `calib pose`."""

import json
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from calib.app.pose import TargetPoses
from calib.app.pose import pose as pose_command
from calib.cameras.camera import Camera, camera_to_json
from calib.core.se3 import exp_rotation, transform
from calib.core.types import Detections
from calib.observe.observations import known_points
from calib.observe.photos import PhotoFile, PhotoResult, Search
from calib.observe.target_poses import (
    CSV_COLUMNS,
    NOT_SOLVED,
    TOO_FEW,
    PhotoWithoutPose,
    PoseResult,
    poses_to_csv,
    target_poses,
)
from calib.renderer.poses import load_poses
from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.page.blocks import Table
from designer.target import TargetGeometry, target_to_json
from tests.support.calibrations import board, camera, icosahedron, poses_around, seen_by
from tests.support.command_line import rows_of_csv

CAMERA = camera()
BOARD, ICO = board(), icosahedron()
SIGMA_PX = 0.05


def photos_from(
    target: TargetGeometry, poses: Array, rng: np.random.Generator, sigma_px: float = SIGMA_PX
) -> list[Detections]:
    """Detections in photos from given poses, with noise."""
    seen = seen_by(CAMERA, known_points(target), poses)
    center = seen.center_px + rng.normal(0, 1, seen.center_px.shape) * sigma_px
    return [
        Detections(
            f"{view}.png", CAMERA.image_size, target.layout_id, target.geometry_id, seen.point[rows],
            target.center_mm[seen.point[rows]], center[rows],
            np.tile(sigma_px**2 * np.eye(2), (len(rows), 1, 1)), np.tile([0, 0, 30.0, 20.0, 0.3], (len(rows), 1)), (),
        )
        for view, rows in ((view, np.flatnonzero(seen.view == view)) for view in range(len(poses)))
    ]  # fmt: skip


def centre(pose: Array) -> Array:
    """Where the camera is in the target's frame."""
    centre: Array = -np.swapaxes(pose[..., :3, :3], -1, -2) @ pose[..., :3, 3:]
    return centre[..., 0]


@pytest.mark.parametrize("target", [BOARD, ICO], ids=["board", "icosahedron"])
def test_without_noise_the_poses_are_the_truth(target: TargetGeometry) -> None:
    """All poses come back, with the camera's place and distance in the target's frame."""
    rng = np.random.default_rng(0)
    truth = poses_around(12, rng, distance_mm=300.0)
    found = target_poses(photos_from(target, truth, rng, 0.0), target, CAMERA, weighted=False).poses
    assert [one.image for one in found] == [f"{view}.png" for view in range(12)]
    for one, pose in zip(found, truth, strict=True):
        assert one.cam_from_target == pytest.approx(pose, abs=1e-7)
        assert one.camera_mm == pytest.approx(centre(pose), abs=1e-6)
        assert one.distance_mm == pytest.approx(np.linalg.norm(pose[:3, 3]))
        assert transform(one.cam_from_target, one.camera_mm) == pytest.approx(np.zeros(3), abs=1e-9)
        assert one.rms_px < 1e-6


@pytest.mark.parametrize("target", [BOARD, ICO], ids=["board", "icosahedron"])
@pytest.mark.parametrize("weighted", [False, True])
def test_stated_deviations_are_those_of_many_photos(target: TargetGeometry, weighted: bool) -> None:
    """Place, distance and rotation scatter over repeated photos from one pose as is stated, within a tenth."""
    rng = np.random.default_rng(1)
    pose = poses_around(3, rng, distance_mm=300.0)[2]
    found = target_poses(photos_from(target, np.tile(pose, (800, 1, 1)), rng), target, CAMERA, weighted=weighted).poses
    assert len(found) == 800
    place = np.array([one.camera_mm for one in found])
    distance = np.array([one.distance_mm for one in found])
    turned = np.array([one.cam_from_target[:3, :3] for one in found]) @ pose[:3, :3].T
    vector = 0.5 * np.stack([turned[:, 2, 1] - turned[:, 1, 2], turned[:, 0, 2] - turned[:, 2, 0],
                             turned[:, 1, 0] - turned[:, 0, 1]], axis=1)  # fmt: skip
    assert place.std(axis=0) == pytest.approx(found[0].camera_sigma_mm, rel=0.1)
    assert distance.std() == pytest.approx(found[0].distance_sigma_mm, rel=0.1)
    worst = np.sqrt(np.linalg.eigvalsh(np.cov(vector.T))[-1])
    assert worst == pytest.approx(found[0].rotation_sigma_rad, rel=0.1)
    assert np.mean([one.rms_px for one in found]) == pytest.approx(np.sqrt(2) * SIGMA_PX, rel=0.1)


def _partly_noisy(photo: Detections, rng: np.random.Generator) -> Detections:
    """A third of the centres ten times as noisy, and stated so."""
    bad = rng.random(len(photo.ring)) < 1 / 3
    return replace(
        photo,
        center_px=photo.center_px + bad[:, None] * rng.normal(0, 10 * SIGMA_PX, photo.center_px.shape),
        cov_px2=photo.cov_px2 * np.where(bad, 101.0, 1.0)[:, None, None],
    )


def test_surer_centres_count_for_more_if_asked() -> None:
    """With a third of the centres ten times as noisy, and stated so, weights bring the pose nearer."""
    rng = np.random.default_rng(2)
    truth = poses_around(60, rng, distance_mm=300.0)
    noisy = [_partly_noisy(photo, rng) for photo in photos_from(BOARD, truth, rng)]
    off = [
        np.mean([np.linalg.norm(one.camera_mm - centre(pose)) for one, pose in zip(found, truth, strict=True)])
        for found in (target_poses(noisy, BOARD, CAMERA, weighted=weighted).poses for weighted in (False, True))
    ]
    assert off[1] < 0.5 * off[0]


def test_files_hold_the_poses_to_the_last_bit(tmp_path: Path) -> None:
    """JSON and CSV give back matrices and covariances; the renderer takes the JSON's poses."""
    rng = np.random.default_rng(3)
    poses = target_poses(photos_from(ICO, poses_around(4, rng), rng), ICO, CAMERA, weighted=False).poses
    path = tmp_path / "poses.json"
    PoseResult(ICO, CAMERA, Search(ICO, (), (), 0, 1.0), poses, (PhotoWithoutPose("lost.png", "too few rings"),)).save(
        path
    )
    document = json.loads(path.read_bytes())
    assert document["geometry_id"] == ICO.geometry_id
    assert document["failed"] == [{"file": "lost.png", "reason": "too few rings"}]
    assert np.array_equal(load_poses(path), [one.cam_from_target for one in poses])
    (tmp_path / "poses.csv").write_bytes(poses_to_csv(poses))
    rows = rows_of_csv(tmp_path / "poses.csv")
    assert tuple(rows[0]) == CSV_COLUMNS
    for row, one in zip(rows, poses, strict=True):
        assert (row["image"], int(row["rings"])) == (one.image, one.rings)
        vector = np.array([float(row[f"r{axis}_rad"]) for axis in "xyz"])
        assert exp_rotation(vector) == pytest.approx(one.cam_from_target[:3, :3], abs=1e-12)
        assert [float(row[f"t{axis}_mm"]) for axis in "xyz"] == one.cam_from_target[:3, 3].tolist()
        assert float(row["c25"]) == one.covariance[2, 5]
        assert [float(row[f"s{axis}_mm"]) for axis in "xyz"] == one.camera_sigma_mm.tolist()


def test_photos_without_a_pose_are_sorted_by_the_reason() -> None:
    """Too few rings, rings on a line and rings that no pose fits are told apart; all others have a pose."""
    rng = np.random.default_rng(6)
    seen = photos_from(BOARD, poses_around(4, rng), rng)
    row = np.flatnonzero(BOARD.ring_index[seen[1].ring, 1] == 0)
    for photo, rows in ((0, slice(3)), (1, row)):
        seen[photo] = seen[photo].keep(rows)
    seen[2] = replace(seen[2], center_px=np.tile([600.0, 450.0], (len(seen[2].ring), 1)))
    found = target_poses(seen, BOARD, CAMERA, weighted=False)
    too_few = (PhotoWithoutPose("0.png", TOO_FEW), PhotoWithoutPose("1.png", TOO_FEW))
    assert found.failed == (*too_few, PhotoWithoutPose("2.png", NOT_SOLVED))
    assert [one.image for one in found.poses] == ["3.png"]
    none = target_poses(seen[:2], BOARD, CAMERA, weighted=False)
    assert (none.poses, none.failed) == ((), too_few)


TRUTH = poses_around(3, np.random.default_rng(4), distance_mm=300.0)
SEEN = photos_from(BOARD, TRUTH, np.random.default_rng(5))


def found(
    pixels: NDArray[np.generic], target: TargetGeometry, *, name: str, camera: Camera | None = None
) -> Detections:
    """A detector that tells by the grey level which photo it is: 0 none, 1 three rings, 2 breaks, 10 k: the k-th."""
    assert camera is not None
    assert camera.params.tolist() == CAMERA.params.tolist()
    level = int(pixels[0, 0])
    if level == 2:
        raise RuntimeError("grey")
    one = SEEN[max(0, level // 10 - 1)]
    keep = slice(0 if level == 0 else 3 if level == 1 else None)
    return Detections(
        name, CAMERA.image_size, target.layout_id, target.geometry_id, one.ring[keep],
        one.position_mm[keep], one.center_px[keep], one.cov_px2[keep],
        one.ellipse_px[keep], (), ("no grid of rings was found",) if level == 0 else (),
    )  # fmt: skip


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder to work in, with target, camera and two photos of the target."""
    monkeypatch.chdir(tmp_path)
    Path("board.target.json").write_text(target_to_json(BOARD))
    Path("camera.json").write_text(camera_to_json(CAMERA))
    Path("photos").mkdir()
    photo("photos/a.png", 10)
    photo("photos/b.png", 20)
    return tmp_path


def photo(path: str, level: int, size: tuple[int, int] = CAMERA.image_size) -> None:
    """An even photo."""
    cv2.imwrite(path, np.full(size[::-1], level, np.uint8))


def run(*photos: str, out: str | None = None, overlay: str | None = None, camera: str = "camera.json") -> int:
    """The exit code of the command with the detector above."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("calib.detector.pipeline.detect", found)
        code: int = pose_command.as_command()(
            target=Path("board.target.json"), camera=Path(camera), photos=photos, weighted=False, jobs="2",
            out=None if out is None else Path(out), overlay=None if overlay is None else Path(overlay),
        ).exit_code  # fmt: skip
        return code


def column(said: str, image: str) -> Sequence[str]:
    """The cells of an image's line."""
    (line,) = (line for line in said.splitlines() if line.startswith(image))
    return line.split()


def test_the_table_tells_where_the_camera_was(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Place and distance stand in the table with as many digits as are known, beside their deviations."""
    assert run("photos", out="poses.csv") == 0
    said = capsys.readouterr().out
    cells = column(said, "b.png")
    assert cells[1] == str(len(SEEN[1].ring))
    place, sigma = np.array(cells[3:6], dtype=float), float(cells[6])
    assert (np.abs(place - centre(TRUTH[1])) < 5 * sigma + 0.01).all()
    assert float(cells[7]) == pytest.approx(np.linalg.norm(TRUTH[1, :3, 3]), abs=0.1)
    assert all(len(cell.rstrip("0").replace("0.", "").lstrip("0")) <= 2 for cell in (cells[6], *cells[8:]))
    assert said.startswith("good: 2 of 2 photos give a pose")
    assert len(Path("poses.csv").read_text().splitlines()) == 4 + 1 + 2


def test_photos_without_a_pose_are_named_with_the_reason(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Nothing found, too few rings, a broken search, no file: a reason each, in the file too."""
    for name, level in (("c", 0), ("d", 1), ("e", 2)):
        photo(f"photos/{name}.png", level)
    assert run("photos", "missing.png", out="poses.json") == 0
    said = capsys.readouterr().out
    assert re.search(r"c\.png +0 +no grid of rings was found", said)
    assert re.search(r"d\.png +3 +too few points for a pose", said)
    assert "No pose: photos/e.png: the search failed: RuntimeError: grey" in said
    assert "2 of 6 photos give a pose" in said
    document = json.loads(Path("poses.json").read_text())
    assert [view["file"] for view in document["views"]] == ["a.png", "b.png"]
    assert {one["file"] for one in document["failed"]} == {"c.png", "d.png", "e.png", "missing.png"}


def test_places_that_do_not_suit_are_refused(folder: Path) -> None:
    """Files of other kinds, a file for a folder, a camera that is none; nothing is written."""
    Path("notes.json").write_text("{}")
    before = sorted(folder.rglob("*"))
    for options, rule in (
        ({"out": "poses.txt"}, r"a \.json or a \.csv file"),
        ({"overlay": "notes.json"}, "is a file, not a folder"),
        ({"camera": "notes.json"}, r"notes\.json: not a camera file"),
    ):
        with pytest.raises(InputError, match=rule):
            run("photos", **options)
    assert sorted(folder.rglob("*")) == before


def test_overlays_show_the_axes_where_they_are(folder: Path) -> None:
    """Each photo with a pose gets a picture with axes at the target's origin."""
    photo("photos/c.png", 0)
    assert run("photos", overlay="photos") == 0
    names = {path.name for path in Path("photos").iterdir()}
    assert {one for one in names if "overlay" in one} == {"a.pose.overlay.jpg", "b.pose.overlay.jpg"}
    picture = cv2.imread("photos/a.pose.overlay.jpg")
    assert picture is not None
    drawn = picture.max(axis=2).astype(int) - picture.min(axis=2)
    header = picture.shape[0] - CAMERA.image_size[1]
    origin = CAMERA.params[:2] * TRUTH[0, :2, 3] / TRUTH[0, 2, 3] + CAMERA.params[2:4]
    u, v = np.rint(origin).astype(int)
    assert drawn[header + v - 6 : header + v + 7, u - 6 : u + 7].max() > 60


def test_no_empty_folder_is_left(folder: Path) -> None:
    """Where the poses cannot be written, or there is no pose, the folder for pictures is not made either."""
    Path("file").write_text("x")
    with pytest.raises(InputError, match="cannot be written"):
        run("photos", overlay="o", out="file/poses.json")
    photo("none.png", 0)
    assert run("none.png", overlay="o") == 1
    assert not Path("o").exists()
    Path("mine").mkdir()
    assert run("none.png", overlay="mine") == 1
    assert Path("mine").is_dir()


def test_what_the_deviations_leave_out_is_told(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """They are of the centres alone, so the camera is taken for exact, and rings that it cannot show are counted."""
    assert run("photos") == 0
    said = capsys.readouterr().out
    assert "Standard deviations hold if the camera file is exact and errors of the points are independent" in said
    seen = SEEN[0]
    one = target_poses([seen], BOARD, CAMERA, weighted=False).poses[0]
    search = Search(BOARD, (PhotoResult(PhotoFile(Path(seen.image), seen.image), seen),), (), 0, 1.0)
    for lost, said in ((0, ""), (3, "3 more points lie where the camera knows no light")):
        found = PoseResult(BOARD, CAMERA, search, (replace(one, rings=one.rings - lost),), ())
        (photos,) = (one for one in TargetPoses(found, "t", "c", None).page().sections if one.title == "Photos")
        (table,) = (block for block in photos.blocks if isinstance(block, Table))
        assert table.rows[0][-1].text == said
