"""Undistorted photos are what a pinhole would have taken, for any camera model."""

import re

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import calib
from calib.cameras import pictures, project, rays
from calib.cameras.camera import Camera, LearnedMap
from calib.cameras.field_of_view import field_of_view
from calib.cameras.picture_of import picture_of
from calib.cameras.undistortion import TAPS, Pixels, pinhole_of, resample, source_places, undistort
from calib.core.se3 import transform
from calib.detector.pipeline import detect
from designer.base.arrays import Array
from designer.base.errors import InputError
from tests.support.calibrations import board
from tests.support.sightings import sighting, view_from

SIZE = (320, 240)
FOCAL = (190.0, 191.0, 158.3, 121.7)
LENSES = {
    "barrel": Camera("opencv", np.array([*FOCAL, -0.30, 0.10, 0.0006, -0.0004, -0.012]), SIZE),
    "cushion": Camera("opencv", np.array([*FOCAL, 0.08, 0.01, 0.001, -0.002, 0.0]), SIZE),
    "backward": Camera("luhmann", np.array([*FOCAL, 0.2, 0.05, 0.0, 0.0006, -0.0004]), SIZE),
    "none": Camera("pinhole", np.array(FOCAL), SIZE),
}
lenses = pytest.mark.parametrize("lens", LENSES.values(), ids=LENSES.keys())


def smooth(seed: int = 0, channels: int = 3, kind: type[np.generic] = np.uint16) -> Pixels:
    """A random picture without fine detail."""
    noise = np.random.default_rng(seed).random((SIZE[1], SIZE[0], channels))
    picture = cv2.GaussianBlur(noise, (0, 0), 6).reshape(noise.shape)
    low, high = picture.min(), picture.max()
    top = np.iinfo(kind).max  # type: ignore[type-var]
    return np.rint((picture - low) / (high - low) * top).astype(kind)  # type: ignore[return-value]


def matrix(camera: Camera) -> Array:
    """OpenCV's camera matrix."""
    fx, fy, cx, cy = camera.params[:4]
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])


@lenses
def test_a_pixel_shows_what_its_ray_meets(lens: Camera) -> None:
    """Light of one direction falls on a pixel of the photo and on one of the pinhole's, whatever the model."""
    pinhole = pinhole_of(lens, focal_px=150.0)
    place = source_places(lens, pinhole, 0, SIZE[1])
    inside = np.isfinite(place).all(axis=-1)
    v, u = np.nonzero(inside)
    back = project(pinhole, rays(lens, place[inside]))
    assert np.abs(back - np.column_stack([u, v])).max() < 1e-7


@lenses
def test_alpha_is_wide_without_black_or_shows_all(lens: Camera) -> None:
    """0: no pixel is black, and a wider view would have some; 1: the whole photo, and a narrower view would cut it."""
    picture = smooth(2, 1, np.uint8)[:, :, 0]
    full, wide = pinhole_of(lens, alpha=0), pinhole_of(lens, alpha=1)
    assert undistort(picture, lens, full).share_filled == 1
    wider = pinhole_of(lens, focal_px=0.995 * full.params[0])
    assert undistort(picture, lens, wider).share_filled < 1
    u, v = np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1]))
    shown = project(wide, rays(lens, np.stack([u, v], axis=-1).astype(float))).reshape(-1, 2)
    last = np.array(SIZE) - 1
    assert shown.min() > -1e-6
    assert (shown <= last + 1e-6).all()
    assert min(shown.min(), (last - shown).min()) < 1e-3
    half = pinhole_of(lens, alpha=0.5)
    assert half.params[0] == pytest.approx((full.params[0] + wide.params[0]) / 2)
    for one in (full, wide, half):
        assert one.model == "pinhole"
        assert one.image_size == SIZE
        assert np.array_equal(one.params[2:], lens.params[2:4])
        assert one.params[1] / one.params[0] == pytest.approx(lens.params[1] / lens.params[0])


def test_a_lens_that_sees_too_much_is_refused() -> None:
    """Light from the side would need a picture without end."""
    fisheye = Camera("luhmann", np.array([100.0, 100.0, 159.5, 119.5, -9.0, -9.0, 0.0, 0.0, 0.0]), SIZE)
    with pytest.raises(InputError, match=r"alpha 1 needs a focal length of .* px"):
        pinhole_of(fisheye, alpha=1)


def test_regions_without_data_are_black_up_to_the_last_pixel() -> None:
    """White stays white up to the edge of the photo, and all beyond is black: nothing between."""
    lens = LENSES["barrel"]
    white = np.full((SIZE[1], SIZE[0]), 255, np.uint8)
    done = undistort(white, lens, pinhole_of(lens, alpha=1))
    assert set(np.unique(done.pixels)) == {0, 255}
    place = source_places(lens, pinhole_of(lens, alpha=1), 0, SIZE[1])
    with np.errstate(invalid="ignore"):
        inside = ((place >= -0.5) & (place <= np.array(SIZE) - 0.5)).all(axis=-1)
    assert np.array_equal(done.pixels == 255, inside)
    assert done.share_filled == inside.mean()


def test_what_a_learned_lens_does_not_know_is_black() -> None:
    """A map that was learned in the middle of the image leaves the rest black, and alpha 0 avoids it."""
    u, v = np.meshgrid(np.linspace(40, 280, 16), np.linspace(30, 210, 12))
    knot = np.column_stack([u.ravel(), v.ravel()])
    nothing = LearnedMap(knot, np.zeros_like(knot), np.full(len(knot), 1e-6), np.eye(3), 40.0, 0.05)
    lens = Camera("virtual", np.array(FOCAL), SIZE, nothing)
    photo = np.maximum(smooth(4, 1, np.uint8)[:, :, 0], 1)
    v, u = np.mgrid[: SIZE[1], : SIZE[0]]
    known = np.isfinite(rays(lens, np.stack([u, v], axis=-1).astype(float))[..., 0])
    assert 0.5 < known.mean() < 0.9
    assert np.array_equal(undistort(photo, lens, pinhole_of(lens)).pixels, np.where(known, photo, 0))
    assert undistort(photo, lens, pinhole_of(lens, alpha=0)).share_filled == 1


def test_progress_and_strips_change_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """The strips in memory may be of any size, and the progress ends at 1."""
    lens, picture = LENSES["backward"], smooth(3)
    pinhole = pinhole_of(lens)
    whole = undistort(picture, lens, pinhole)
    monkeypatch.setattr("calib.cameras.undistortion.STRIP_PIXELS", 7 * SIZE[0])
    told: list[float] = []
    strips = undistort(picture, lens, pinhole, progress=told.append)
    assert np.array_equal(strips.pixels, whole.pixels)
    assert strips.share_filled == whole.share_filled
    assert told == sorted(told)
    assert len(told) == -(-SIZE[1] // 7)
    assert told[-1] == 1
    with pytest.raises(ValueError, match="size"):
        undistort(picture[:-1], lens, pinhole)


WIDE = {
    "fisheye": Camera("fisheye", np.array([96.0, 97.0, 160.2, 118.9, 0.02, -0.006, 0.001, 0.0]), SIZE),
    "two spheres": Camera("ds", np.array([80.0, 80.4, 160.2, 118.9, -0.25, 0.57]), SIZE),
    "mirror": Camera("omni", np.array([210.0, 210.0, 160.2, 118.9, 1.4]), SIZE),
}
each_wide = pytest.mark.parametrize("lens", WIDE.values(), ids=WIDE.keys())
each_picture = pytest.mark.parametrize("to", pictures())


OF_OPENCV = {"barrel": LENSES["barrel"], "cushion": LENSES["cushion"], "fisheye": WIDE["fisheye"]}
each_of_opencv = pytest.mark.parametrize("camera", OF_OPENCV.values(), ids=OF_OPENCV.keys())


@each_of_opencv
@pytest.mark.parametrize("alpha", [None, 0.0, 0.7])
def test_the_map_is_that_of_opencv(camera: Camera, alpha: float | None) -> None:
    """For OpenCV's models the places in the photo are those of initUndistortRectifyMap, to its single precision."""
    if camera.model == "fisheye" and alpha:
        return  # it sees too much for that
    pinhole = pinhole_of(camera, alpha=alpha)
    maps = cv2.fisheye.initUndistortRectifyMap if camera.model == "fisheye" else cv2.initUndistortRectifyMap
    u, v = maps(matrix(camera), camera.params[4:], np.eye(3), matrix(pinhole), SIZE, cv2.CV_32FC1)
    place = source_places(camera, pinhole, 0, SIZE[1])
    assert np.abs(place - np.stack([u, v], axis=-1)).max() < 1e-4
    assert np.array_equal(source_places(camera, pinhole, 60, 90), place[60:90])


@each_of_opencv
@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
def test_the_picture_is_that_of_opencv(camera: Camera, kind: type[np.generic]) -> None:
    """A smooth picture is the same as OpenCV makes it, within what its rounding of places to 1/32 px does."""
    picture, pinhole = smooth(1, 3, kind), pinhole_of(camera)
    ours = undistort(picture, camera, pinhole)
    k, d, new = matrix(camera), camera.params[4:], matrix(pinhole)
    is_fisheye = camera.model == "fisheye"
    theirs = cv2.fisheye.undistortImage(picture, k, d, None, new, SIZE) if is_fisheye else cv2.undistort(picture, k, d)
    slope = np.abs(np.diff(picture.astype(float), axis=1)).max()
    inside = cv2.erode((theirs.min(axis=2) > 0).astype(np.uint8), np.ones((5, 5))).astype(bool)
    assert ours.pixels.dtype == picture.dtype
    assert np.abs(ours.pixels.astype(float) - theirs)[inside].max() < 0.06 * slope + 1
    assert ours.share_filled > 0.7


@each_picture
def test_the_equation_that_is_told_is_that_of_the_picture(to: str) -> None:
    """Pixels are where the words put them."""
    camera, point = Camera(to, np.array([90.0, 80.0, 33.0, 44.0]), (100, 100)), np.array([0.3, -0.4, 0.5])
    names = {"atan2": np.arctan2, "sqrt": np.sqrt, **dict(zip(("fx", "fy", "cx", "cy"), camera.params, strict=True)),
             **dict(zip("XYZ", point, strict=True))}  # fmt: skip
    text = pictures()[to].equation.replace("^", "**")
    for value, part in zip(camera.project(point), re.split(r", (?=v)", text), strict=True):
        formula = re.sub(r"\b(f[xy]) ", r"\1 * ", part.split(" = ")[1])
        assert eval(formula, {}, names) == pytest.approx(value, rel=1e-12)  # noqa: S307 -- a text of our own


@each_wide
@each_picture
def test_the_middle_is_as_large_as_in_the_photo(lens: Camera, to: str) -> None:
    """On the axis a pixel of the new picture is one of the photo's, whatever the focal parameter of the model is."""
    new = picture_of(lens, to)
    axis = project(new, np.array([0.0, 0.0, 1.0]))
    places = project(lens, rays(new, axis + np.array([[0.0, 0.0], [0.01, 0.0]])))
    assert np.diff(places, axis=0)[0] == pytest.approx([0.01, 0.0], abs=1e-6)


@each_wide
def test_pictures_by_angles_hold_what_the_photo_shows(lens: Camera) -> None:
    """All of it has a place in longitude and latitude but near the poles; a smaller field is as wide as asked."""
    u, v = np.meshgrid(np.linspace(0, SIZE[0] - 1, 60), np.linspace(0, SIZE[1] - 1, 50))
    ray = rays(lens, np.stack([u, v], axis=-1).reshape(-1, 2))
    ray = ray[np.isfinite(ray[:, 2]) & (np.hypot(ray[:, 0], ray[:, 2]) > 0.8)]
    new = picture_of(lens, "equirectangular")
    place = project(new, ray)
    assert ((place >= -1.5) & (place <= np.array(new.image_size) + 0.5)).all()
    narrow = picture_of(lens, "cylinder", field_rad=2.0)
    assert field_of_view(narrow).across_rad == pytest.approx(2.0, abs=1.5 / narrow.params[0])
    square = picture_of(lens, field_rad=2.0)
    assert field_of_view(square).across_rad == pytest.approx(2.0, abs=1.5 / square.params[0])
    with pytest.raises(InputError, match=r"alpha: the photos show light \d+ degrees off the axis"):
        pinhole_of(lens, alpha=1)


@each_picture
def test_a_turned_picture_is_what_opencv_resamples(to: str) -> None:
    """The places that are told are for cv2.remap, also to the side; the middle of a pinhole is where it looks."""
    lens, picture = WIDE["fisheye"], smooth(5, 1, np.uint8)[..., 0]
    made = calib.Undistorter(lens, to=to, field_rad=1.2, yaw_rad=0.8, pitch_rad=0.3)
    ours = made.undistort(picture).pixels
    place = made.source_px.astype(np.float32)
    theirs = cv2.remap(picture, place[..., 0], place[..., 1], cv2.INTER_CUBIC)
    inside = ((place > 3) & (place < np.array(SIZE) - 4)).all(axis=-1)
    assert inside.mean() > 0.2
    slope = np.abs(np.diff(picture.astype(float), axis=1)).max()
    assert np.abs(ours.astype(float) - theirs)[inside].max() < 0.06 * slope + 1
    ahead = made.cam_from_new @ np.array([0.0, 0.0, 1.0])
    assert ahead == pytest.approx([np.sin(0.8) * np.cos(0.3), -np.sin(0.3), np.cos(0.8) * np.cos(0.3)])


def slow_value(picture: Array, u: float, v: float) -> Array:
    """Grey levels at a place by Keys' kernel, from its piecewise formula."""

    def kernel(s: float) -> float:
        d = abs(s)
        parts = ((4 / 3, -7 / 3, 0, 1), (-7 / 12, 3, -59 / 12, 15 / 6), (1 / 12, -2 / 3, 21 / 12, -3 / 2))
        return float(np.polyval(parts[int(d)], d)) if d < 3 else 0.0

    height, width, _ = picture.shape
    total = np.zeros(picture.shape[2])
    for row in range(int(np.floor(v)) - 2, int(np.floor(v)) - 2 + TAPS):
        for column in range(int(np.floor(u)) - 2, int(np.floor(u)) - 2 + TAPS):
            level = picture[min(max(row, 0), height - 1), min(max(column, 0), width - 1)]
            total += kernel(u - column) * kernel(v - row) * level
    return total


@settings(max_examples=40, deadline=None, derandomize=True)
@given(seed=st.integers(0, 10**6), channels=st.integers(1, 4))
def test_resampling_is_keys_kernel(seed: int, channels: int) -> None:
    """The kernel agrees with its formula, at the border too, rounded and cut to the range."""
    rng = np.random.default_rng(seed)
    picture = rng.integers(0, 256, (9, 11, channels), dtype=np.uint8)
    place = np.stack([rng.uniform(-0.5, 10.5, (2, 8)), rng.uniform(-0.5, 8.5, (2, 8))], axis=-1)
    place[0, 0], place[1, 7] = (-0.51, 3.0), (np.nan, 3.0)
    result = np.full((2, 8, channels), 77, np.uint8)
    assert resample(picture, place, result) == 14
    for i, j in np.ndindex(2, 8):
        outside = (i, j) in ((0, 0), (1, 7))
        expected = np.zeros(channels) if outside else np.clip(slow_value(picture.astype(float), *place[i, j]), 0, 255)
        assert np.abs(result[i, j] - expected).max() <= 0.5 + 1e-9


def test_resampling_moves_nothing() -> None:
    """Parabolas and cubics come out exactly; OpenCV's remap would move an edge by up to 0.04 px."""
    u, v = np.meshgrid(np.arange(60.0), np.arange(50.0))
    for shift in (0.01, 0.25, 0.5):
        place = np.stack([u + shift, v - shift], axis=-1)[5:-5, 5:-5]
        curve = lambda a, b: 20_000 + 0.4 * (a - 30) ** 3 - 9 * (b - 20) ** 2 + 0.1 * (a - 30) * (b - 25) ** 2  # noqa: E731
        source = np.rint(curve(u, v)).astype(np.uint16)
        result = np.empty(place.shape[:2], np.uint16)
        resample(source, place, result)
        assert (
            np.abs(result - curve(place[..., 0], place[..., 1])).max() < 1.6
        )  # two roundings, amplified by the kernel


def test_rings_are_found_where_the_pinhole_puts_them() -> None:
    """A rendered photo through strong barrel distortion: in the undistorted photo all centres are where they belong."""
    target = board(6, 5)
    lens = Camera("opencv", np.array([500, 500, 318.2, 242.7, -0.30, 0.10, 0.0006, -0.0004, -0.012]), (640, 480))
    pose = view_from((30, -40, 95), (5, 0, 0))
    photo, _ = sighting(target, lens, pose, np.random.default_rng(0))
    pinhole = pinhole_of(lens)
    seen = detect(undistort(photo, lens, pinhole).pixels, target, name="x", camera=pinhole)
    expected = project(pinhole, transform(pose, target.center_mm[seen.ring]))
    bent = project(lens, transform(pose, target.center_mm[seen.ring]))
    assert len(seen.ring) >= 25
    assert np.linalg.norm(expected - bent, axis=1).max() > 5
    assert np.sqrt(((seen.center_px - expected) ** 2).sum(axis=1).mean()) < 0.02
