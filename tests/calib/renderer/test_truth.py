"""The truth of rendered photos: what `calib render` writes is read, and anything else is refused in one line."""

import json
from pathlib import Path

import numpy as np
import pytest

from calib.core.se3 import exp_rotation, invert, log_rotation, make_pose, rigid_fault
from calib.renderer.job import RenderJob, truth_text
from calib.renderer.options import RenderOptions
from calib.renderer.poses import PoseGrid, fibonacci_cap, grid_poses, load_poses
from calib.renderer.quantities import length_range
from calib.renderer.truth import TRUTH, Truth
from designer.base.errors import InputError
from tests.support.calibrations import board, camera, poses_around

TARGET, CAMERA = board(5, 4), camera()
POSES = poses_around(3, np.random.default_rng(1))
TEXT = truth_text(RenderJob(TARGET, CAMERA, POSES, RenderOptions(blur_px=0.7), seed=3))


def truth_of(path: Path, text: str) -> Truth:
    """The truth in a text."""
    path.write_text(text)
    return TRUTH.read(path)


def test_what_render_writes_is_read(tmp_path: Path) -> None:
    """Camera, geometry and poses of `calib render` come back bit for bit."""
    truth = truth_of(tmp_path / "truth.json", TEXT)
    assert truth.files == ("view_0000.png", "view_0001.png", "view_0002.png")
    assert truth.geometry_id == TARGET.geometry_id
    assert truth.poses_of(truth.files).tobytes() == POSES.tobytes()
    assert (truth.camera.model, truth.camera.image_size) == (CAMERA.model, CAMERA.image_size)
    assert truth.camera.params.tobytes() == CAMERA.params.tobytes()


def test_views_are_matched_by_file_name(tmp_path: Path) -> None:
    """Order and number may differ; a view that the truth does not hold has nan."""
    truth = truth_of(tmp_path / "truth.json", TEXT)
    poses = truth.poses_of(("view_0002.png", "other.png", "view_0000.png"))
    assert np.array_equal(poses[[0, 2]], POSES[[2, 0]])
    assert np.isnan(poses[1]).all()


def altered(**changes: object) -> str:
    """The text with other fields, the first view's among them."""
    document = json.loads(TEXT)
    for key, value in changes.items():
        where = document["views"][1] if key in ("file", "cam_from_target") else document
        where[key] = value
    return json.dumps(document)


@pytest.mark.parametrize(
    ("text", "rule"),
    [
        ("[]", "not the truth of rendered photos"),
        (altered(camera=None), "camera: not a camera file"),
        (altered(camera={"format": "ringsolid.camera", "version": 1}), "camera: "),
        (altered(views=[]), "views has 0 items; it must be 1 to 100000"),
        (altered(file="view_0000.png"), "views name 'view_0000.png' twice"),
        (altered(cam_from_target=np.diag([1, -1, 1, 1]).tolist()), "has no rotation in it"),
    ],
)
def test_anything_else_is_refused(text: str, rule: str, tmp_path: Path) -> None:
    """By the view and the rule."""
    with pytest.raises(InputError, match=rule):
        truth_of(tmp_path / "truth.json", text)


def test_rotations_of_any_angle_are_rigid() -> None:
    """Products of many rotations, rounded as they are, are motions; a thousandth of stretch is none, and is named."""
    rng = np.random.default_rng(2)
    turn = np.linalg.multi_dot([exp_rotation(rng.normal(size=3)) for _ in range(50)])
    poses = make_pose(np.stack([turn] * 3), rng.normal(0, 500, (3, 3)))
    assert rigid_fault(poses) is None
    poses[2, :3, :3] *= 1.001
    assert rigid_fault(poses) == (2, "has no rotation in it")


def test_photos_that_were_not_rendered_are_real(tmp_path: Path) -> None:
    """A photo beside rendered ones, that their truth does not name, is no photo of an exact target."""
    (tmp_path / "truth.json").write_text(altered())
    truth = TRUTH.read(tmp_path / "truth.json")
    assert truth.rendered_id(truth.files) == truth.geometry_id
    assert truth.rendered_id([*truth.files, "mine.png"]) == ""


def grid(**changes: object) -> PoseGrid:
    """300 views of a hemisphere at 400 mm."""
    values: dict[str, object] = {
        "views": 300, "half_angle_rad": np.pi / 2, "distance_mm": (400.0, 400.0), "random_roll": False,
        "aim_offset_mm": 0.0,
    }  # fmt: skip
    return PoseGrid(**{**values, **changes})  # type: ignore[arg-type]


@pytest.mark.parametrize("half_angle", [0.3, np.pi / 2, np.pi])
def test_grid_is_even(half_angle: float) -> None:
    """Points lie in the cap, and each has its nearest neighbour at about the distance of an even spread."""
    points = fibonacci_cap(400, half_angle)
    assert np.allclose(np.linalg.norm(points, axis=1), 1)
    assert np.arccos(points[:, 2]).max() <= half_angle
    gap = np.arccos(np.clip(points @ points.T - 2 * np.eye(400), -1, 1)).min(axis=1)
    even = np.sqrt(2 * np.pi * (1 - np.cos(half_angle)) / 400)
    assert gap.min() > 0.7 * even
    assert gap.max() < 1.2 * even


def test_cameras_look_at_the_origin_from_the_distance() -> None:
    """The origin is on every camera's axis, at the distance asked for, and above the horizon of a hemisphere."""
    poses = grid_poses(grid(), np.random.default_rng(0))
    assert np.allclose(poses[:, :3, 3], [0, 0, 400])
    assert (invert(poses)[:, 2, 3] > 0).all()


def test_distances_fill_their_range() -> None:
    """A range of distances is filled from end to end."""
    poses = grid_poses(grid(distance_mm=(250.0, 800.0)), np.random.default_rng(0))
    distance = np.linalg.norm(poses[:, :3, 3], axis=1)
    assert 250 <= distance.min() < 260
    assert 790 < distance.max() <= 800


def test_roll_and_aim_are_random_on_request() -> None:
    """Roll leaves the camera's place alone; an offset aim moves the origin off the axis, by no more than asked."""
    plain, rolled = (
        grid_poses(grid(), np.random.default_rng(0)),
        grid_poses(grid(random_roll=True), np.random.default_rng(0)),
    )
    assert np.allclose(invert(plain)[:, :3, 3], invert(rolled)[:, :3, 3])
    turn = log_rotation(rolled[:, :3, :3] @ plain[:, :3, :3].transpose(0, 2, 1))
    assert np.abs(turn[:, :2]).max() < 1e-6
    assert turn[:, 2].std() > 1.5  # even over a whole turn: 1.81
    aside = np.linalg.norm(grid_poses(grid(aim_offset_mm=50.0), np.random.default_rng(0))[:, :2, 3], axis=1)
    assert 20 < aside.max() <= 50


def test_poses_from_files_agree(tmp_path: Path) -> None:
    """The same poses come out of a list of matrices, a truth.json and a CSV of rotation vectors."""
    vector = np.random.default_rng(0).uniform(-1, 1, (5, 6)) * [1, 1, 1, 50, 50, 300]
    poses = make_pose(exp_rotation(vector[:, :3]), vector[:, 3:])
    (tmp_path / "a.json").write_text(json.dumps(poses.tolist()))
    (tmp_path / "b.json").write_text(json.dumps({"views": [{"cam_from_target": pose.tolist()} for pose in poses]}))
    lines = [",".join(map(repr, row)) for row in vector.tolist()]
    (tmp_path / "c.csv").write_text("# by hand\nrx_rad,ry_rad,rz_rad,tx_mm,ty_mm,tz_mm\n" + "\n".join(lines) + "\n")
    for name in ("a.json", "b.json", "c.csv"):
        assert np.allclose(load_poses(tmp_path / name), poses, atol=1e-12)


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("p.json", "[]", "shape"),
        ("p.json", "{}", "no poses"),
        ("p.json", '[["a"]]', "matrices of numbers"),
        ("p.json", json.dumps([np.diag([1.0, 1, -1, 1]).tolist()]), "pose 0"),
        ("p.json", json.dumps([np.eye(4).tolist(), np.full((4, 4), np.nan).tolist()]), "pose 1"),
        ("p.csv", "rx_rad,ry_rad,rz_rad,tx_mm,ty_mm,tz_mm\n0,0,0,0,0,9\n0,1e308,1e308,4,5,6\n", "line 3: turns by"),
        ("p.csv", "rx_rad,ry_rad,rz_rad,tx_mm,ty_mm,tz_mm\n0,0,0,0,0,1e308\n", "pose 0 .* away"),
        ("p.json", json.dumps([np.diag([1e200, 1e-200, 1, 1]).tolist()]), "pose 0 .* no rotation"),
        ("p.json", f"[[[1{'0' * 400}]]]", "matrices of numbers"),
        ("p.json", '{"views": [3]}', "poses are a list of 4 x 4 matrices"),
    ],
)
def test_bad_pose_files_end_in_one_line(name: str, text: str, message: str, tmp_path: Path) -> None:
    """What is wrong with a file of poses is said in one line that names it."""
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=message) as caught:
        load_poses(tmp_path / name)
    assert name in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "expected"),
    [("400mm", (400, 400)), ("250mm..800mm", (250, 800)), ("25..80cm", (250, 800)), ("0.4m..500", (400, 500))],
)
def test_ranges_of_length(text: str, expected: tuple[float, float]) -> None:
    """One length or two; a unit at the end holds for a first number that has none."""
    assert length_range("--distance", text, 1, 1e4) == expected


@pytest.mark.parametrize("text", ["", "..", "5mm..", "800..250", "1..2..3", "nanmm", "400deg", "-4"])
def test_bad_ranges_are_refused(text: str) -> None:
    """What is no range of lengths is refused by the option's name."""
    with pytest.raises(InputError, match=r"^--distance "):
        length_range("--distance", text, 1, 1e4)
