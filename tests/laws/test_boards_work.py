"""Every kind of other makers' marks goes the whole way: rendered, found, named, solved, and told without a ring."""

import re

import numpy as np
import pytest

import calib
from calib.cameras.camera import Camera
from calib.core.se3 import look_at
from calib.renderer import RenderOptions, render_view
from calib.renderer.scene import scene_from_target
from designer.base.arrays import Array
from designer.marks.aprilgrid import AprilGrid
from designer.marks.charuco import Charuco
from designer.marks.chessboard import Chessboard
from designer.marks.circles import Circles
from designer.marks.face_marks import MARKS, FaceMarks
from designer.target import target_of_marks

CAMERA = Camera("opencv", np.array([700.0, 702.0, 321.0, 243.0, -0.2, 0.05, 0, 0, 0]), (640, 480))
BOARDS: dict[str, FaceMarks] = {
    "chessboard": Chessboard((9, 6), 20.0),
    "charuco": Charuco((8, 6), 24.0, 18.0, "DICT_4X4_50"),
    "aprilgrid": AprilGrid((4, 3), 36.0),
    "circles": Circles((4, 9), 40.0, 13.0, asymmetric=True),
}


def poses() -> list[Array]:
    """From several sides, distances and rolls, aimed beside the middle."""
    rng = np.random.default_rng(1)
    places = rng.uniform([-150, -120, 260], [150, 120, 330], (9, 3))
    return [look_at(place, rng.uniform(-30, 30, 3), float(rng.uniform(-0.6, 0.6))) for place in places]


def test_all_kinds_are_tried() -> None:
    """A kind that is added is walked through, too."""
    assert set(BOARDS) == set(MARKS)


@pytest.mark.parametrize("kind", BOARDS)
def test_a_board_is_rendered_found_and_solved(kind: str) -> None:
    """Names are true, places as sure as stated, the camera within its uncertainty, and nothing is called a ring."""
    pytest.importorskip(f"calib.detector.marks.{kind}")
    target = target_of_marks([BOARDS[kind]], np.eye(4)[None], 12.0)
    scene, options = scene_from_target(target), RenderOptions(blur_px=0.7, contrast_to_noise=60)
    views = [render_view(scene, CAMERA, pose, options, np.random.default_rng(row)) for row, pose in enumerate(poses())]
    run = calib.run(target, images=[view.image for view in views], model="opencv", truth=None)
    seen = run.best.calibration.observations
    assert seen.view_count >= 8
    square = []
    for view, name in enumerate(seen.view_names):
        rows = seen.view == view
        true = views[int(name.split("-")[1]) - 1].center_px[seen.point[rows]]
        assert seen.cov_px2 is not None
        off = seen.center_px[rows] - true
        square.append(np.einsum("ni,nij,nj->n", off, np.linalg.inv(seen.cov_px2[rows]), off) / 2)
    assert 0.5 < np.concatenate(square).mean() < 2
    sigma = np.sqrt(np.diagonal(run.best.calibration.param_covariance)[:4])
    assert (np.abs(run.best.calibration.camera.params - CAMERA.params)[:4] < 5 * sigma + 0.1).all()
    assert sigma[0] < 1
    assert not re.search(r"\b[Rr]ings?\b", repr(run.words()))
