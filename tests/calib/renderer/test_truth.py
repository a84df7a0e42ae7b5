"""The truth of rendered photos: what `calib render` writes is read, and anything else is refused in one line."""

import json
from pathlib import Path

import numpy as np
import pytest

from calib.core.se3 import exp_rotation, make_pose, rigid_fault
from calib.renderer.job import RenderJob, truth_text
from calib.renderer.options import RenderOptions
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


MATRIX = POSES[1].tolist()


@pytest.mark.parametrize(
    ("text", "rule"),
    [
        ("", "not valid JSON"),
        ("[1", "not valid JSON"),
        ("[]", "not the truth of rendered photos"),
        ("[" * 100_000, "nested too deep"),
        ('{"format": "ringsolid.camera", "version": 1}', "not the truth of rendered photos"),
        (altered(version=2), "version 2; this program reads version 1"),
        (altered(version=True), "version True"),
        (altered(geometry_id=5), "geometry_id 5: must be text"),
        (altered(camera=None), "camera: not a camera file"),
        (altered(camera={"format": "ringsolid.camera", "version": 1}), "camera: "),
        (altered(views={}), "views must be a list"),
        (altered(views=[]), "views has 0 items; it must be 1 to 100000"),
        (altered(views=[1]), "views.0 1: must be an object with keys"),
        (altered(file=7), "views.1.file 7: must be text"),
        (altered(file="view_0000.png"), "views name 'view_0000.png' twice"),
        (altered(cam_from_target=None), "views.1.cam_from_target None: must be 4 rows of 4 numbers"),
        (altered(cam_from_target=[*MATRIX[:3], [0, 0, 1]]), "views.1.cam_from_target must be 4 rows of 4 numbers"),
        (
            altered(cam_from_target=[*MATRIX[:3], [0, 0, False, 1]]),
            "views.1.cam_from_target.3.2 False: must be a finite number",
        ),
        (altered(cam_from_target=[*MATRIX[:3], [0, 0, 10**400, 1]]), "views.1.cam_from_target: a number is too long"),
        (
            altered(cam_from_target=[*MATRIX[:3], [0, 0, float("nan"), 1]]),
            "views.1.cam_from_target.3.2 nan: must be a finite number",
        ),
        (altered(cam_from_target=np.diag([1, -1, 1, 1]).tolist()), "has no rotation in it"),
    ],
)
def test_anything_else_is_refused(text: str, rule: str, tmp_path: Path) -> None:
    """One line that names the file, the view and the rule."""
    path = tmp_path / "truth.json"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        TRUTH.read(path)
    message = str(caught.value)
    assert message.startswith(str(path))
    assert rule in message
    assert "\n" not in message
    assert len(message) < 400


def test_a_file_that_is_not_there_is_refused(tmp_path: Path) -> None:
    """By its name."""
    with pytest.raises(InputError, match=r"truth\.json: cannot be read"):
        TRUTH.read(tmp_path / "truth.json")
    with pytest.raises(InputError, match="not a regular file"):
        TRUTH.read(tmp_path)


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
