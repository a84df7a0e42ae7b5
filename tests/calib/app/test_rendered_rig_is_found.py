"""What `calib render --rig` makes is what `calib rig` reads: the rig it finds is the one that was rendered."""

from pathlib import Path

import numpy as np

from calib.app.render import render_rig
from calib.app.rig import rig
from calib.cameras.camera import Camera
from calib.cameras.rig import Rig
from calib.core.se3 import exp_rotation, make_pose
from calib.renderer.options import RenderOptions
from designer.kinds.layout import lay_out
from tests.support.designs import small_board

LENS = Camera("pinhole", np.array([520.0, 520, 239.5, 179.5]), (480, 360))
TRUE = Rig(
    ("a", "b"),
    (LENS, LENS),
    make_pose(exp_rotation(np.array([[0, 0, 0], [0, 0.2, 0]])), np.array([[0.0, 0, 0], [-60, 0, 10]])),
)


def test_a_rendered_rig_is_found_again(tmp_path: Path) -> None:
    """Folders, frames and truth fit: the second camera's place is that of the truth, within its sigmas."""
    board = lay_out(small_board().job.target)
    photos = render_rig(
        board, TRUE, frames=6, distance_mm=(150, 220), options=RenderOptions(blur_px=0.6, contrast_to_noise=50)
    )
    photos.save(tmp_path / "photos")
    found = rig(board, [tmp_path / "photos"], model="pinhole", jobs=1)
    assert found.rig.names == TRUE.names
    rows = found.rig.pose_rows(1)
    covariance = found.calibration.covariance[rows, rows]
    error = found.rig.cam_from_rig[1][:3, 3] - TRUE.cam_from_rig[1][:3, 3]
    assert np.linalg.norm(error) < 0.5
    assert error @ np.linalg.solve(covariance[3:, 3:], error) < 30
    assert found.calibration.observations.shared[0, 1] >= 3
