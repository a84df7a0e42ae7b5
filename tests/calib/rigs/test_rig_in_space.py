"""Rigs that minimise distances in space: as single cameras do, near the solution in the image, and honest about it."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from typing import NoReturn

import numpy as np
import pytest

import calib
from calib.core.se3 import steps_between
from calib.core.types import Observations, RigObservations
from calib.rigs.problem import CameraChoice, RigOptions
from calib.rigs.solve import solve_rig
from calib.solver.accuracy import UndeterminedError
from calib.solver.problem import SolveOptions
from calib.solver.solve import solve
from designer.base.arrays import Array
from designer.base.errors import InputError
from tests.support.rig_views import RigScene, camera_in_hand, stereo_pair
from tests.support.solver_scenes import board

PAIR = [CameraChoice("opencv")] * 2


@cache
def scene() -> RigScene:
    """Two cameras and a target."""
    return stereo_pair(frames=10)


def rig_of_one(seen: Observations) -> RigObservations:
    """One camera as a rig: a frame a view."""
    return RigObservations(("left",), seen.view_names, (seen,), (np.arange(seen.view_count),), None)


def sigmas(covariance: Array) -> Array:
    """Standard deviations of the last two axes."""
    return np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1))


@pytest.mark.parametrize("minimise", ["image", "ray", "intersection-by-range"])
def test_a_rig_of_one_camera_is_that_camera(minimise: str) -> None:
    """The same minimum, whichever distances are minimised, and the same statement of how sure it is."""
    seen = scene().observations.sightings[0]
    single = solve(seen, "opencv", SolveOptions(minimise=minimise))
    rig = solve_rig(rig_of_one(seen), PAIR[:1], RigOptions(minimise=minimise))
    squares = [float((one**2).sum()) for one in (single.residual_px, rig.residual_px[0])]
    assert squares[1] == pytest.approx(squares[0], rel=1e-9)
    off = np.abs(rig.cameras[0].params - single.camera.params) / sigmas(single.param_covariance)
    moved = np.abs(steps_between(single.cam_from_target, rig.rig_from_target)) / sigmas(single.pose_covariance)
    assert max(off.max(), moved.max()) < 1e-4
    unit = np.outer(*[sigmas(single.param_covariance)] * 2)
    np.testing.assert_allclose(rig.covariance[:9, :9] / unit, single.param_covariance / unit, atol=1e-4)
    np.testing.assert_allclose(sigmas(rig.frame_covariance), sigmas(single.pose_covariance), rtol=1e-4)
    pose = sigmas(single.pose_covariance)
    of_poses = pose[:, :, None] * pose[:, None]
    np.testing.assert_allclose(rig.pose_covariance[0] / of_poses, single.pose_covariance / of_poses, atol=1e-4)
    assert rig.scale[0] == pytest.approx(single.scale, rel=1e-6)
    assert rig.remarks == single.remarks


def test_distances_from_rays_give_the_rig_of_the_image_within_its_sigmas_and_state_the_difference() -> None:
    """`V + D D'` of the whole rig: the joint covariance is that of the image and the step, no more and no less."""
    image, ray = (solve_rig(scene().observations, PAIR, RigOptions(minimise=cost)) for cost in ("image", "ray"))
    rows = ray.rig.pose_rows(1)
    step = steps_between(image.cam_from_rig, ray.cam_from_rig)[1]
    assert 1e-3 < np.sqrt(step @ np.linalg.solve(image.covariance[rows, rows], step) / 6) < 0.5
    off = steps_between(ray.cam_from_rig, scene().cam_from_rig)[1]
    assert off @ np.linalg.solve(ray.covariance[rows, rows], off) < 20  # chi square of 6: 0.3 %
    lens = ray.cameras[1].params - image.cameras[1].params
    whole = np.concatenate([ray.cameras[0].params - image.cameras[0].params, np.zeros(6), lens, step])
    np.testing.assert_allclose(ray.covariance - image.covariance, np.outer(whole, whole), atol=1e-9)
    np.testing.assert_allclose(ray.scale, image.scale, rtol=0.01)  # of residuals in the image, as always
    assert "cameras stand up to 0.0" in ray.remarks[0]


def test_a_robots_camera_is_where_distances_in_the_image_put_it() -> None:
    """With the robot's noise and the target's size weighed against distances in mm."""
    observations, carrier, _ = camera_in_hand(np.random.default_rng(2).uniform(-0.5, 0.5, (14, 3)))
    image, ray = (
        solve_rig(observations, [CameraChoice("opencv")], RigOptions(carrier=carrier, minimise=cost))
        for cost in ("image", "ray")
    )
    assert ray.status == "converged"
    moved = steps_between(image.cam_from_rig, ray.cam_from_rig)[0] / sigmas(image.covariance[9:, 9:])
    assert 1e-6 < np.abs(moved).max() < 1.0
    assert abs(ray.carrier.size - image.carrier.size) < image.carrier.size_sigma <= ray.carrier.size_sigma


def test_what_cannot_be_minimised_is_refused_before_any_work_is_done() -> None:
    """A word that is no cost, in Python as on the screen; and planes of points that lie on none."""
    with pytest.raises(InputError, match=r"^minimise 'rays' is unknown; did you mean 'ray'"):
        calib.rig(scene().observations, minimise="rays")
    with pytest.raises(InputError, match=r"^minimise 'rays'"):
        calib.turntable(None, table="none.csv", minimise="rays")
    loose = [
        replace(one, points=replace(one.points, face=np.full_like(one.points.face, -1)))
        for one in scene().observations.sightings
    ]
    with pytest.raises(InputError, match="lie on no known plane; take ray"):
        solve_rig(replace(scene().observations, sightings=tuple(loose)), PAIR, RigOptions(minimise="intersection"))


def test_lenses_that_run_away_are_refused() -> None:
    """Six photos of twelve corners hardly tell a focal length; over a longer range all angles are smaller."""
    seen = stereo_pair(board(4, 3, 20.0), frames=6, noise_px=0.5).observations
    assert solve_rig(seen, PAIR).status == "converged"
    with pytest.raises(UndeterminedError, match="takes the focal length of left from 1212 px in the image to"):
        solve_rig(seen, PAIR, RigOptions(minimise="ray-by-range"))


def test_halves_and_the_record_know_what_was_minimised(monkeypatch: pytest.MonkeyPatch) -> None:
    """What solves a rig again later solves the same."""
    asked: list[str] = []

    def solved(seen: RigObservations, choices: Sequence[CameraChoice], options: RigOptions) -> NoReturn:
        del seen, choices
        asked.append(options.minimise)
        raise InputError("no halves here")

    monkeypatch.setattr("calib.judge.joint_halves.solve_rig", solved)
    found = calib.rig(scene().observations, model="opencv", minimise="ray", loss="huber")
    assert set(asked) == {"ray"}
    assert (found.run.provenance.options.minimise, found.run.provenance.options.loss) == ("ray", "huber")
