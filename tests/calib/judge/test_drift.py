"""Whether cameras are as their file says: rates of false alarms and of finds, and causes that are not made up."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from calib.core.types import Observations, RigObservations, keep_views
from calib.judge.drift import DriftTest, drift_test
from calib.judge.reference import Reference, of_one_camera, reference_of
from tests.support import drift_scenes, rig_views, solver_scenes
from tests.support.drift_scenes import CAMERA, photos_of, scaled

POINTS = solver_scenes.board()


@cache
def reference() -> Reference:
    """Of a camera solved from 20 photos, by its covariance alone."""
    return replace(reference_of(drift_scenes.solved(POINTS, np.random.default_rng(1))), photos=None)


def checked(seen: Observations, known: Reference | None = None) -> DriftTest:
    found = drift_test(known or reference(), of_one_camera(seen), is_exact=True)
    assert found is not None
    return found


def both(first: Observations, second: Observations) -> Observations:
    """The photos of two cameras, as if one had taken them."""
    view = np.concatenate([first.view, second.view + first.view_count])
    names = (*first.view_names, *(f"other-{name}" for name in second.view_names))
    parts = {
        name: np.concatenate([getattr(first, name), getattr(second, name)])
        for name in ("point", "center_px", "cov_px2")
    }
    return replace(first, view=view, view_names=names, **parts)


def test_probabilities_are_even_if_nothing_changed() -> None:
    """Of cameras that are off their file as its covariance says, one in a hundred has a p below .01."""
    rng, known = np.random.default_rng(2), reference()
    assert known.rig.covariance is not None
    params = len(CAMERA.params)
    values = []
    for _ in range(40):
        true = rng.multivariate_normal(known.rig.cameras[0].params, known.rig.covariance[:params, :params])
        values.append(checked(photos_of(replace(CAMERA, params=true), POINTS, 3, rng)).p)
    assert 0.36 < np.mean(values) < 0.64  # 3 sigma
    assert 0.19 < np.std(values) < 0.37
    assert np.sum(np.array(values) < 0.05) < 8


def test_a_focal_length_that_changed_by_a_thousandth_is_found_and_told() -> None:
    """From three photos at .05 px; its number is right by its own sigma, and it is among the causes."""
    found = checked(photos_of(scaled(CAMERA, 1.001), POINTS, 3, np.random.default_rng(3)))
    focal = found.of("camera", "focal length")
    assert found.is_changed
    assert focal is not None
    assert abs(focal.amount[0] - 1e-3) < 3 * focal.sigma[0]
    assert "focal length" in {one.what for one in found.causes}
    assert focal.visible < 1e-3


def test_one_photo_straight_on_tells_of_no_focal_length() -> None:
    """Focal length and distance look alike: what would be seen is larger than what matters."""
    rng = np.random.default_rng(4)
    pose = solver_scenes.pose_from((0.0, 0.0, 400.0))
    seen = solver_scenes.observe(CAMERA, POINTS, pose, rng, noise_px=0.05)
    focal = checked(seen).of("camera", "focal length")
    assert focal is not None
    assert focal.visible > 5e-3


def test_the_photo_of_another_camera_is_named_and_not_counted() -> None:
    """One of four that contradicts the others is no drift; one of three leaves two, or no cause that explains all."""
    rng = np.random.default_rng(5)
    good, other = photos_of(CAMERA, POINTS, 3, rng), photos_of(scaled(CAMERA, 1.01), POINTS, 1, rng)
    found = checked(both(good, other))
    assert [one.frame for one in found.left_out] == ["other-view0.png"]
    assert not found.is_changed
    assert not checked(both(keep_views(good, np.array([True, False, True])), other)).causes


def test_marks_that_stand_alone_are_outliers() -> None:
    """A few marks named wrongly raise no alarm."""
    seen = photos_of(CAMERA, POINTS, 3, np.random.default_rng(6))
    center = seen.center_px.copy()
    center[[5, 120, 200]] += 7.0
    assert not checked(replace(seen, center_px=center)).is_changed


def test_a_file_without_standard_deviations_is_not_exact() -> None:
    """The same photos are less surely against it."""
    bare = Reference(replace(reference().rig, covariance=None))
    seen = photos_of(scaled(CAMERA, 1.001), POINTS, 3, np.random.default_rng(7))
    found = checked(seen, bare)
    assert found.is_changed
    assert "focal length" in {one.what for one in found.causes}


@cache
def ring() -> tuple[rig_views.RigScene, Reference]:
    scene = rig_views.ring(frames=13, seed=8)
    return scene, reference_of(drift_scenes.solved_rig(scene, 10, np.random.default_rng(8)))


def rig_checked(scene: rig_views.RigScene, known: Reference) -> DriftTest:
    seen: RigObservations = drift_scenes.frames_of(scene, slice(10, 13), np.random.default_rng(9))
    found = drift_test(replace(known, photos=None), seen, is_exact=True)
    assert found is not None
    return found


@pytest.mark.parametrize("turn_deg", [(0.05, 0.0, 0.0), (0.0, 0.05, 0.0), (0.0, 0.0, 0.05)])
def test_the_camera_of_a_rig_that_turned_is_told(turn_deg: tuple[float, float, float]) -> None:
    """By .05 degrees about its own centre, from three frames; no other camera is suspected where there are four."""
    scene, known = ring()
    found = rig_checked(drift_scenes.moved_camera(scene, turn_deg), known)
    turn = found.of("left", "turn")
    assert found.is_changed
    assert {one.camera for one in found.causes} == {"left"}
    assert turn is not None
    assert turn in found.causes
    assert np.abs(np.degrees(turn.amount) - turn_deg).max() < 4 * np.degrees(turn.sigma.max())


def test_a_rig_that_did_not_change_is_as_it_was() -> None:
    """And of two cameras either may have turned."""
    assert not rig_checked(*ring()).is_changed
    scene = rig_views.stereo_pair(frames=13, seed=10)
    known = reference_of(drift_scenes.solved_rig(scene, 10, np.random.default_rng(10)))
    found = rig_checked(drift_scenes.moved_camera(scene, (0.0, 0.0, 0.05)), known)
    assert {(one.camera, one.what) for one in found.causes} >= {("left", "turn"), ("right", "turn")}
