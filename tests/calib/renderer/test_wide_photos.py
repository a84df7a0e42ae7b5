"""Photos of lenses that see the side and what is behind: rings where others' formulas have them, light where it is."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

import calib
from calib.cameras import project, rays
from calib.cameras.camera import Camera, camera_from_mapping, camera_to_json
from calib.core.se3 import look_at, make_pose, rotation_between, transform
from calib.renderer import RenderOptions, render_view
from calib.renderer.light import FADE_RAD
from calib.renderer.poses import directions_over_image
from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.base.files import parse_json
from tests.support.render_oracle import SILHOUETTE, board, ico, render_slowly

SIDE = 200
LENS = np.array([0.012, -0.006, 0.0008, -0.0001])
FIELD_RAD = np.radians(210)


def fisheye(field_rad: float | None = FIELD_RAD) -> Camera:
    """A lens of 210 degrees, whose image circle touches the frame on one side."""
    return Camera("fisheye", np.array([50.0, 50.0, 97.3, 104.4, *LENS]), (SIDE, SIDE), field_rad=field_rad)


def aside(angle_deg: float, azimuth_deg: float = 30, away_mm: float = 60.0, tilt_deg: float = 20) -> Array:
    """A pose whose target stands so far off the axis."""
    angle, azimuth, tilt = np.radians([angle_deg, azimuth_deg, tilt_deg])
    direction = np.array([np.sin(angle) * np.cos(azimuth), np.sin(angle) * np.sin(azimuth), np.cos(angle)])
    eye = away_mm * np.array([np.sin(tilt), 0, np.cos(tilt)])
    turn = rotation_between(np.array([0.0, 0.0, 1.0]), direction)
    return make_pose(turn, np.zeros(3)) @ look_at(eye, np.zeros(3), 0.4)


def kannala_brandt(point: Array, matrix: Array) -> Array:
    """Pixels (..., 2) of points by the formula of the paper, written out."""
    theta = np.arctan2(np.hypot(point[..., 0], point[..., 1]), point[..., 2])
    radius = theta * (1 + sum(k * theta ** (2 * n + 2) for n, k in enumerate(LENS)))
    azimuth = np.arctan2(point[..., 1], point[..., 0])
    return matrix[[0, 1], [0, 1]] * radius[..., None] * np.stack([np.cos(azimuth), np.sin(azimuth)], -1) + matrix[:2, 2]


def outline_moments(outer_px: Array, inner_px: Array) -> Array:
    """Area and centroid of an annulus between two polygons (N, 2), by Green's theorem."""
    sums = np.zeros(3)
    for polygon, sign in ((outer_px, 1.0), (inner_px, -1.0)):
        x, y = (polygon - outer_px[0]).T
        x2, y2 = np.roll(x, -1), np.roll(y, -1)
        cross = x * y2 - x2 * y
        part = np.array([cross.sum() / 2, ((x + x2) * cross).sum() / 6, ((y + y2) * cross).sum() / 6])
        sums += sign * np.sign(part[0]) * part
    return np.array([abs(sums[0]), *(outer_px[0] + sums[1:] / sums[0])])


@pytest.mark.parametrize("angle_deg", [0, 60, 80, 95])
def test_rings_are_where_the_formula_has_them(angle_deg: float) -> None:
    """Ink and centroid of each ring's picture, whatever its angle off the axis, against OpenCV's fisheye in front."""
    target, where, matrix = board(3), aside(angle_deg), np.diag([250.0, 250.0, 1.0])
    matrix[:2, 2] = SIDE / 2 - kannala_brandt(where[:3, 3], matrix)  # so that the frame is around the board
    cam = Camera("fisheye", np.array([250.0, 250.0, *matrix[:2, 2], *LENS]), (SIDE, SIDE), field_rad=1.1 * FIELD_RAD)
    view = render_view(target, cam, where, RenderOptions(bits=32, black=0, white=1), np.random.default_rng(0))
    assert view.clean.all()
    angle = np.linspace(0, 2 * np.pi, 720, endpoint=False)
    circle = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    v, u = np.mgrid[:SIDE, :SIDE]
    for row in range(target.ring_count):
        center = target.center_mm[row]
        radii = target.radius_outer_mm[row], target.radius_inner_mm[row]
        rims = [transform(where, center + radius * circle) for radius in radii]
        outer, inner = (kannala_brandt(rim, matrix) for rim in rims)
        if angle_deg <= 60:
            theirs = cv2.fisheye.projectPoints(rims[0][None], np.zeros(3), np.zeros(3), matrix, LENS)[0][0]
            assert np.abs(theirs - outer).max() < 1e-9
        area, *place = outline_moments(outer, inner)
        own = np.zeros((SIDE, SIDE), np.uint8)
        cv2.fillPoly(own, [np.rint(outer).astype(np.int32)], (1,))
        is_own = cv2.dilate(own, np.ones((3, 3))) > 0
        ink = (1 - view.image)[is_own].astype(float)
        assert ink.sum() == pytest.approx(area, rel=1e-3)
        for values, expected in ((u, place[0]), (v, place[1])):
            assert (ink * values[is_own]).sum() / ink.sum() == pytest.approx(expected, abs=2e-3)


@pytest.mark.parametrize(
    ("name", "where"),
    [
        ("a solid at the side", aside(88, away_mm=140.0)),
        ("a solid whose far half is in the dark", aside(112, -60, 130.0)),
        ("a board straight behind that reaches around", aside(178, away_mm=4.0, tilt_deg=3)),
        ("a board that fills all of the image", aside(10, away_mm=0.05, tilt_deg=0)),
    ],
)
def test_plain_numpy_agrees(name: str, where: Array) -> None:
    """An independent renderer of rays sees the same silhouettes, and the circle's rim is all that differs."""
    target, cam = ico() if "solid" in name else board(4), fisheye()
    slow = render_slowly(target, cam, where, (0.9, 1.0, 0.0), 2, np.random.default_rng(1))
    image = render_view(target, cam, where, SILHOUETTE, np.random.default_rng(0)).image
    v, u = np.mgrid[:SIDE, :SIDE]
    ray = rays(cam, np.stack([u, v], axis=-1))
    is_lit = ray[..., 2] > np.cos(FIELD_RAD / 2 - FADE_RAD)
    assert (slow[is_lit] > 0.85).mean() > 0.03
    differs = np.abs(image - slow) > 0.3  # of edges, where four rays say little
    assert differs[is_lit].mean() < 0.01
    assert not image[np.isnan(ray[..., 2])].any()


def test_no_light_beyond_the_image_circle() -> None:
    """Beyond the field the photo is dark, inside as without it; rings that reach its rim are not clean."""
    target, where = ico(), aside(100, away_mm=160.0)
    lit, whole = (
        render_view(target, fisheye(field), where, RenderOptions(bits=32), np.random.default_rng(0))
        for field in (FIELD_RAD, None)
    )
    u, v = np.meshgrid(np.arange(SIDE), np.arange(SIDE))
    angle = np.arccos(rays(fisheye(None), np.stack([u, v], axis=-1))[..., 2])
    assert (lit.image[~(angle < FIELD_RAD / 2)] == 0).all()
    inside = angle < FIELD_RAD / 2 - FADE_RAD
    assert np.array_equal(lit.image[inside], whole.image[inside])
    assert lit.visible.sum() < whole.visible.sum()
    point = transform(where, target.center_mm)
    off_axis = np.arccos(point[:, 2] / np.linalg.norm(point, axis=1))
    assert (off_axis[lit.visible] <= FIELD_RAD / 2).all()
    assert lit.clean.any()
    assert (off_axis[lit.clean] < FIELD_RAD / 2 - FADE_RAD).all()


def test_the_field_is_kept_in_files_and_ends_the_image() -> None:
    """`field_rad` reads back; at its rim rays and pixels end together."""
    cam = fisheye()
    back = camera_from_mapping(parse_json(camera_to_json(cam), "c.json", "a camera file"), "c.json")  # type: ignore[arg-type]
    assert back.field_rad == cam.field_rad
    edge = FIELD_RAD / 2 + np.array([-1e-6, 1e-6])
    point = 7 * np.stack([np.sin(edge), 0 * edge, np.cos(edge)], axis=1)
    assert np.isfinite(project(cam, point)).all(axis=1).tolist() == [True, False]
    pixel = project(replace(cam, field_rad=None), point)
    assert np.isfinite(rays(cam, pixel)).all(axis=1).tolist() == [True, False]
    with pytest.raises(InputError, match="field_rad"):
        camera_from_mapping({**cam.to_json(), "field_rad": 7.0}, "c.json")  # type: ignore[dict-item]


def test_defocus_of_wide_lenses_goes_by_range() -> None:
    """At the distance of best focus a target is sharp whatever its angle off the axis."""
    options = RenderOptions(bits=32, aperture_mm=20.0, focus_mm=60.0)
    for angle_deg in (0, 90):
        where = aside(angle_deg, tilt_deg=0)
        image, plain = (
            render_view(board(3), fisheye(), where, one, np.random.default_rng(0)).image
            for one in (options, RenderOptions(bits=32))
        )
        assert np.abs(image - plain).max() < 0.25 * (plain.max() - plain.min())


def test_targets_stand_all_over_the_image() -> None:
    """Without poses, wide lenses see the target anywhere in the circle; others straight ahead, as ever."""
    photos = calib.render(ico(), fisheye(), views=400)
    direction = photos.cam_from_target[:, :3, 3] / np.linalg.norm(photos.cam_from_target[:, :3, 3], axis=1)[:, None]
    angle = np.degrees(np.arccos(direction[:, 2]))
    assert angle.max() < 105
    share = (angle > 60).mean()  # 1 - (r(60) / r(105))^2 of the circle, which the frame cuts a little
    assert 0.55 < share < 0.75
    near = calib.render(ico(), fisheye(), views=50, aside_rad=0.5).cam_from_target[:, :3, 3]
    assert (near[:, 2] >= np.cos(0.5) * np.linalg.norm(near, axis=1) - 1e-9).all()
    assert np.allclose(calib.render(ico(), views=5).cam_from_target[:, :3, 3], [0, 0, 400])
    with pytest.raises(InputError, match="--aside"):
        directions_over_image(Camera("pinhole", np.array([9.0, 9, 900, 9]), (9, 9)), 5, 0.1, np.random.default_rng(0))
