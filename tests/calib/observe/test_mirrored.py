"""Mirrored points are recognised through any lens, and nothing else is taken for mirrored."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calib.cameras.camera import Camera
from calib.core.se3 import look_at
from calib.core.types import KnownPoints, Observations
from calib.observe.mirrored import facing, handedness, mirrored_views
from calib.observe.observations import known_points
from designer.base.errors import InputError
from tests.support.calibrations import board, camera, icosahedron, poses_around, seen_by

BOARD, ICO = known_points(board()), known_points(icosahedron())
BARREL = Camera("opencv", np.array([620, 620, 508.2, 391.7, -0.30, 0.10, 0.0006, -0.0004, -0.012]), (1024, 768))
CUSHION = Camera("luhmann", np.array([620, 620, 508.2, 391.7, 0.15, -0.02, 0, 0.0006, -0.0004]), (1024, 768))
LENSES = (camera("pinhole"), BARREL, CUSHION)


def views(points: KnownPoints, lens: Camera, count: int, *, seed: int = 0, distance_mm: float = 150.0) -> Observations:
    """Sightings with a little noise; those of a near board reach into the corners of the image."""
    rng = np.random.default_rng(seed)
    seen = seen_by(lens, points, poses_around(count, rng, distance_mm=distance_mm))
    return replace(seen, center_px=seen.center_px + rng.normal(0, 0.1, seen.center_px.shape))


def flipped(seen: Observations, which: list[int]) -> Observations:
    """The sightings with some photos flipped left to right."""
    center = seen.center_px.copy()
    rows = np.isin(seen.view, which)
    center[rows, 0] = seen.image_size[0] - 1 - center[rows, 0]
    return replace(seen, center_px=center)


def mirrored_points(points: KnownPoints) -> KnownPoints:
    """Points whose z axis was taken the wrong way round."""
    return replace(points, position_mm=points.position_mm * np.array([1.0, 1.0, -1.0]))


@pytest.mark.parametrize("lens", LENSES, ids=lambda lens: lens.model)
@pytest.mark.parametrize("points", [BOARD, ICO], ids=["board", "icosahedron"])
def test_a_face_seen_from_its_front_says_so(points: KnownPoints, lens: Camera) -> None:
    """Triangles run as in the plane in every true view and the other way in every flipped one, whatever the lens."""
    seen = views(points, lens, 20)
    assert facing(seen).min() > 0.9
    assert facing(flipped(seen, list(range(20)))).max() < -0.9


@settings(max_examples=40, deadline=None, derandomize=True)
@given(seed=st.integers(0, 10**6), tilt=st.floats(0, 1.2), roll=st.floats(-3.2, 3.2))
def test_the_sign_holds_for_any_pose(seed: int, tilt: float, roll: float) -> None:
    """Near, far, tilted or rolled: a board that is seen is seen from its front."""
    rng = np.random.default_rng(seed)
    turn = rng.uniform(0, 6.28)
    direction = np.array([np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), np.cos(tilt)])
    pose = look_at(rng.uniform(60, 900) * direction, rng.normal(0, 10, 3), roll)
    seen = seen_by(BARREL, BOARD, pose[None])
    if len(seen.view) >= 6:
        assert facing(seen)[0] == 1


@pytest.mark.parametrize("points", [BOARD, ICO], ids=["board", "icosahedron"])
def test_flipped_photos_among_others_are_told(points: KnownPoints) -> None:
    """With known fronts exactly the flipped photos are mirrored, even if they are the majority; all are an error."""
    seen = views(points, BARREL, 9)
    for which in ([], [2], [0, 1, 3, 4, 5, 7]):
        told = mirrored_views(flipped(seen, which), has_fronts=True, origin="d.csv")
        assert np.flatnonzero(told).tolist() == which
    with pytest.raises(InputError, match=r"^d\.csv: the points are mirrored: .*flip"):
        mirrored_views(flipped(seen, list(range(9))), has_fronts=True, origin="d.csv")


def test_wrong_names_do_not_look_like_a_mirror() -> None:
    """A view with a fifth of its points confused is not mirrored; one with all of them confused tells nothing."""
    seen = views(ICO, BARREL, 6)
    rng = np.random.default_rng(1)
    for share in (0.2, 1.0):
        point = seen.point.copy()
        for view in range(6):
            rows = np.flatnonzero(seen.view == view)
            some = rng.choice(rows, int(share * len(rows)), replace=False)
            point[some] = rng.permutation(point[some])
        assert not mirrored_views(replace(seen, point=point), has_fronts=True, origin="x").any()


def test_a_plane_of_unknown_front_needs_the_majority() -> None:
    """From behind or numbered in a mirror, a plane gives the same camera; only views that differ from most are told."""
    plane = replace(BOARD, plane=np.array([[0.0, 0.0, 1.0, 0.0]]))
    seen = views(plane, BARREL, 6)
    for some, others in (([], []), (list(range(6)), []), ([1], [1]), ([0, 2, 3, 4], [1, 5])):
        told = mirrored_views(flipped(seen, some), has_fronts=False, origin="x")
        assert np.flatnonzero(told).tolist() == others
    with pytest.raises(InputError, match="half of the views"):
        mirrored_views(flipped(seen, [0, 1, 2]), has_fronts=False, origin="x")


def corner_of_a_room() -> KnownPoints:
    """Three walls seen from inside, as calibration corners are built; no face column, so no planes."""
    grid = np.stack(np.meshgrid(np.arange(7), np.arange(7)), axis=-1).reshape(-1, 2) * 15.0 + 10
    zero = np.zeros(len(grid))
    walls = [
        np.column_stack([*grid.T, zero]),
        np.column_stack([zero, *grid.T]),
        np.column_stack([grid[:, 0], zero, grid[:, 1]]),
    ]
    return KnownPoints(np.concatenate(walls) - 50.0, np.full(3 * len(grid), -1), np.array([[0.0, 0.0, 1.0, 0.0]]))


@pytest.mark.parametrize("lens", LENSES, ids=lambda lens: lens.model)
@pytest.mark.parametrize("solid", ["icosahedron", "corner"])
def test_points_in_space_tell_their_handedness(solid: str, lens: Camera) -> None:
    """Solids from outside and rooms from inside are right-handed, their mirror images are not, whatever the lens."""
    rng = np.random.default_rng(3)
    if solid == "corner":
        points, distance = corner_of_a_room(), 260.0
        eye = distance * np.array([1.0, 1.0, 1.0]) / np.sqrt(3) + rng.normal(0, 25, (12, 3))
        seen = seen_by(lens, points, look_at(eye, rng.normal(0, 8, (12, 3)), rng.uniform(-3, 3, 12)))
    else:
        points = ICO
        seen = seen_by(lens, points, poses_around(12, rng, half_angle_rad=3.0, distance_mm=200.0))
    seen = replace(seen, center_px=seen.center_px + rng.normal(0, 0.2, seen.center_px.shape))
    assert handedness(seen).min() > 8
    wrong = replace(seen, points=mirrored_points(points))
    assert handedness(wrong).max() < -8
    told = mirrored_views(flipped(seen, [4, 9]), has_fronts=False, origin="x")
    assert np.flatnonzero(told).tolist() == [4, 9]
    with pytest.raises(InputError, match="right-handed"):
        mirrored_views(wrong, has_fronts=False, origin="x")


def test_what_cannot_be_told_is_not_mirrored() -> None:
    """Nearly parallel light, few points, or points in one plane of a solid: no verdict."""
    narrow = Camera("pinhole", np.array([200_000.0, 200_000.0, 499.5, 399.5]), (1000, 800))
    rng = np.random.default_rng(5)
    far = seen_by(narrow, ICO, poses_around(8, rng, distance_mm=60_000.0))
    far = replace(far, center_px=far.center_px + rng.normal(0, 0.5, far.center_px.shape))
    near = views(ICO, BARREL, 4)
    first = np.concatenate([np.flatnonzero(near.view == view)[:9] for view in range(4)])
    few = replace(near, view=near.view[first], point=near.point[first], center_px=near.center_px[first])
    face = ICO.face[near.point]
    one_face = face == np.array([np.bincount(face[near.view == view]).argmax() for view in range(4)])[near.view]
    flat = replace(near, view=near.view[one_face], point=near.point[one_face], center_px=near.center_px[one_face])
    points = replace(ICO, plane=np.zeros((0, 4)), face=np.full(len(ICO.face), -1))
    for seen in (replace(one, points=points) for one in (far, few, flat)):
        assert not mirrored_views(seen, has_fronts=False, origin="x").any()
        wrong = replace(seen, points=mirrored_points(seen.points))
        assert not mirrored_views(wrong, has_fronts=False, origin="x").any()
