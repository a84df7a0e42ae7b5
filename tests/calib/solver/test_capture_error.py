"""What is alike in all photos: named with its size where they show it, stated where they do not, and else nothing."""

from dataclasses import replace

import numpy as np
import pytest

from calib.cameras import project
from calib.core.types import Observations
from calib.solver.capture_error import capture_of, moved_px, with_capture_error
from calib.solver.problem import SolveOptions
from calib.solver.solve import solve
from designer.base.errors import InputError
from tests.support.solver_scenes import CAMERAS, SIZE, board, icosahedron, noisy, observe, poses_around, times_stated

TRUE = CAMERAS["opencv"]
NOISE_PX = 0.02
POSES = poses_around(20, np.random.default_rng(3))
KINDS = {
    "a target that moves along the camera's x while the shutter rolls": (0, 0.5),
    "a target that moves along its own y while the shutter rolls": (4, 0.5),
    "a focal length that changes with the distance": (6, 0.6),
    "a focal length that changes with time": (7, 0.6),
    "centres that are off along the tilt": (8, 0.3),
    "centres that are off as the middles of discs' outlines are": (9, 0.2),
}


def _faulty(kind: int, amount: float, seed: int) -> Observations:
    """Sightings with so much of a fault, made of the true camera and poses, not of the tested columns."""
    rng = np.random.default_rng(seed)
    points = icosahedron(edge_mm=120.0) if kind >= 8 else board()
    seen = observe(TRUE, points, POSES, np.random.default_rng(0))
    pose = POSES[seen.view]
    place = np.einsum("mij,mj->mi", pose[:, :3, :3], points.position_mm[seen.point]) + pose[:, :3, 3]
    distance = np.bincount(seen.view, np.linalg.norm(place, axis=1)) / np.bincount(seen.view)
    off = distance - distance.mean()
    late = ((seen.center_px[:, 1] + 0.5) / SIZE[1] - 0.5) * amount * distance.mean() / TRUE.params[0]
    course = {6: off / np.abs(off).max(), 7: np.linspace(-1, 1, len(POSES))}.get(kind, np.zeros(len(POSES)))
    shown = [
        project(
            replace(TRUE, params=TRUE.params * ([1 + 1e-3 * amount * share] * 2 + [1] * 7)), place[seen.view == view]
        )
        for view, share in enumerate(course)
    ]
    pixel = np.concatenate(shown)
    if kind < 6:
        pixel = project(TRUE, place + late[:, None] * (np.eye(3)[kind] if kind < 3 else pose[:, :3, kind - 3]))
    if kind >= 8:
        normal = np.einsum("mij,mj->mi", pose[:, :3, :3], points.plane[points.face[seen.point], :3])
        ray = place / np.linalg.norm(place, axis=1, keepdims=True)
        along = ray - (ray * normal).sum(axis=1, keepdims=True) * normal
        if kind == 9:  # the mean of an outline's image, so large that it is off by the amount
            radius = np.sqrt(4 * amount / TRUE.params[0]) * distance.mean()
            side = along / np.linalg.norm(along, axis=1, keepdims=True)
            turns = np.linspace(0, 2 * np.pi, 12, endpoint=False)
            edges = [radius * (np.cos(turn) * side + np.sin(turn) * np.cross(normal, side)) for turn in turns]
            pixel = np.mean([project(TRUE, place + edge) for edge in edges], axis=0)
        else:
            ahead = project(TRUE, place + 1e-3 * along) - pixel
            ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
            pixel = pixel + amount * ahead * np.linalg.norm(along, axis=1, keepdims=True)
    return noisy(replace(seen, center_px=pixel), NOISE_PX, rng)


@pytest.mark.parametrize("name", KINDS)
def test_what_is_alike_in_all_photos_is_named_and_stated(name: str) -> None:
    """One fault, one name, its size within four deviations; the camera's error is what is stated, not the noise."""
    kind, amount = KINDS[name]
    one = with_capture_error(solve(_faulty(kind, amount, 1), "opencv", SolveOptions()))
    assert one.capture_error is not None
    (effect,) = one.capture_error.effects
    assert effect.name == name
    assert effect.explains
    assert abs(abs(effect.amount) - amount) < 4 * effect.sigma + 0.03 * amount
    assert times_stated(one, TRUE, one.param_covariance) > 1.5
    assert 0.2 < times_stated(one, TRUE, one.stated_covariance) < 2


def test_where_nothing_is_alike_nothing_is_named_and_little_is_added() -> None:
    """Noise alone names nothing, and the camera at rest is hardly less sure than by the noise."""
    for seed in range(2):
        one = with_capture_error(solve(_faulty(0, 0.0, seed), "opencv", SolveOptions()))
        assert one.capture_error is not None
        assert one.capture_error.effects == ()
        ratio = np.diagonal(one.stated_covariance) / np.diagonal(one.param_covariance)
        assert ratio.max() < 3


def test_what_the_way_of_capture_lets_expect_is_stated_where_photos_cannot_show_it() -> None:
    """Of photos from one distance, a target that moves is as uncertain as was expected; one at rest is not."""
    eye = POSES[:6].copy()
    seen = noisy(observe(TRUE, board(), eye, np.random.default_rng(0)), NOISE_PX, np.random.default_rng(1))
    one = solve(seen, "opencv", SolveOptions())
    sigma = [
        float(np.sqrt(np.diagonal(with_capture_error(one, capture_of(way)).stated_covariance)[1]))
        for way in ("still", "handheld", "moving")
    ]
    assert sigma[0] < sigma[1] < sigma[2]
    told = with_capture_error(one).capture_error
    assert told is not None
    assert (told.capture, told.because) == ("still", "assumed")


def test_a_way_of_capture_that_there_is_not_is_refused() -> None:
    """The refusal names the value and what may stand there."""
    with pytest.raises(InputError, match=r"--capture 'handhold'.*handheld"):
        capture_of("handhold")


def test_columns_are_told_in_their_units() -> None:
    """Motion is a pixel from the first row to the last at the middle distance; a thousandth of focal length is that."""
    one = solve(_faulty(0, 0.0, 0), "opencv", SolveOptions())
    moved = moved_px(one)
    row = one.observations.center_px[:, 1] / SIZE[1] - 0.5
    assert np.polyfit(row, moved[:, 0, 0], 1)[0] == pytest.approx(1.0, abs=0.1)
    apart = one.observations.center_px - one.camera.params[2:4]
    at_end = one.observations.view == len(POSES) - 1
    np.testing.assert_allclose(moved[at_end, :, 7], 1e-3 * apart[at_end], atol=0.1)


def test_points_on_no_known_plane_have_no_tilt() -> None:
    """They are looked at for motion and focus all the same."""
    one = solve(_faulty(0, 0.5, 0), "opencv", SolveOptions())
    points = one.observations.points
    loose = replace(points, face=np.full_like(points.face, -1), plane=np.zeros((0, 4)))
    told = with_capture_error(replace(one, observations=replace(one.observations, points=loose))).capture_error
    assert told is not None
    assert [effect.name for effect in told.effects] == [next(iter(KINDS))]
