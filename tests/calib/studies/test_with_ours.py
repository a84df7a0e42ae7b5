"""What a target of ours would have told, beside another maker's board."""

from dataclasses import replace

import numpy as np
import pytest

from calib.cameras.camera import Camera
from calib.core.se3 import look_at
from calib.solver.problem import SolveOptions
from calib.solver.solve import solve
from calib.studies.tolerance.seen import CONTRAST_TO_NOISE, views_of
from calib.studies.with_ours import with_ours
from designer.kinds.sizing import size_job
from designer.kinds.spec_file import parse_spec
from designer.marks.chessboard import Chessboard
from designer.target import target_of_marks

CAMERA = Camera("opencv", np.array([2500.0, 2500.0, 1224.0, 1024.0, -0.1, 0.02, 0, 0, 0]), (2448, 2048))
BOARD = target_of_marks([Chessboard((11, 8), 20.0)], np.eye(4)[None], 10.0)
OURS = size_job(parse_spec({"kind": "ico", "edge": "115mm"}, "")).job.target.lay_out()


def poses(count: int = 14) -> np.ndarray:
    """Towards a board from a cap around its normal, rolled."""
    rng = np.random.default_rng(3)
    side, tilt, roll = rng.uniform(-np.pi, np.pi, count), rng.uniform(0.05, 0.35, count), rng.uniform(-3, 3, count)
    way = np.stack([np.sin(tilt) * np.cos(side), np.sin(tilt) * np.sin(side), np.cos(tilt)], axis=1)
    return np.array([look_at(450 * w, np.zeros(3), r) for w, r in zip(way, roll, strict=True)])


def test_what_is_said_is_what_solving_both_tells() -> None:
    """Of simulated observations of both, with the noise that is predicted, the focal lengths are as sure as it says."""
    rng, sigma_px, solved = np.random.default_rng(0), [], []
    for target in (BOARD, OURS):
        _, seen = views_of(target, CAMERA, poses(), CONTRAST_TO_NOISE)
        assert seen.cov_px2 is not None
        noise = (np.linalg.cholesky(seen.cov_px2) @ rng.standard_normal((len(seen.point), 2, 1)))[..., 0]
        found = solve(replace(seen, center_px=seen.center_px + noise), "opencv", SolveOptions(weighted=True))
        sigma_px.append(float(np.sqrt(found.param_covariance[0, 0])) / found.scale)
        solved.append(found)
    told = with_ours(solved[0], BOARD)
    assert told is not None
    assert told.edge_mm == 115
    assert [told.board_px, told.ours_px] == pytest.approx(sigma_px, rel=0.15)
    assert "times as surely" in told.words


def test_nothing_is_said_where_it_cannot_be_told() -> None:
    """Of our own target, of a board too small for one of ours, and from where ours would not be read, not a word."""
    _, seen = views_of(BOARD, CAMERA, poses(), CONTRAST_TO_NOISE)
    found = solve(seen, "opencv", SolveOptions(weighted=True))
    assert with_ours(found, OURS) is None
    assert with_ours(found, target_of_marks([Chessboard((11, 8), 5.0)], np.eye(4)[None])) is None
    far = found.cam_from_target.copy()
    far[:, 2, 3] *= 4
    assert with_ours(replace(found, cam_from_target=far), BOARD) is None
    assert with_ours(replace(found, status="stopped"), BOARD) is None
