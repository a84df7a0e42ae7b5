"""Where a coupon's plane lies in each picture of it, and how far the print's axes are stretched and leaning.

The print is x = (I + E) X of the design X, with E = (size + stretch / 2, skew / 2; skew / 2, size - stretch / 2). A
photo shows x through a pinhole with one radial term, a scan by a similarity that is itself a little off. One plane in
one photo gives eight numbers, and pose (6), focal length, stretch and skew are nine (Zhang, PAMI 22, 2000): what is
known of the camera beforehand takes part as Gaussian priors, and what is not known is in the covariance.

What one photo cannot tell, at a tilt of t from the camera's axis: a focal length f that is wrong by df stretches the
print by t^2 df / f, a principal point wrong by c by t c / f. At 4 deg what is assumed of a camera that states its focal
length (below) is 0.03 % and 0.06 %; at 20 deg it is 0.6 % and 0.3 %, and no number in the photo is left to tell it.
Photos with the coupon turned between them do, as the print turns with it and the camera does not; lengths along both
axes and both diagonals do as well, whatever the photo.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from calib.core.linear_algebra import rms_length
from calib.core.se3 import exp_rotation
from designer.base.arrays import Array, Rows
from designer.target import TargetGeometry

SIZE, STRETCH, SKEW = range(3)
PRINT_SIGMA = (0.02, 0.02, 0.02)
"""Of size, stretch and skew (rad) before anything was seen: wider than any print, so that nothing is undetermined."""
STATED_FOCAL, GUESSED_FOCAL = 0.05, 0.35
"""Standard deviation of the focal length's logarithm: stated in the file, or guessed. A file rounds it to whole mm of
film (2 % of 26), knows of no crop, and not that a lens focused near stands further out, by its magnification: at 20
px/mm and pixels of 0.002 mm by 4 %."""
USUAL_FOCAL = 0.7
"""Over the picture's diagonal: of a phone's main camera, 26-30 mm in terms of film (43.3 mm across). Assumption."""
CENTRE_SIGMA = 0.006
"""Of the principal point, over the diagonal; an assumption, which a cropped photo breaks."""
CROPPED_SIGMA = 0.15
"""Likewise of a photo that was cropped: anywhere near."""
CAMERA_ASPECTS = (1, 5 / 4, 4 / 3, 3 / 2, 16 / 9, 2, 19.5 / 9, 20 / 9, 21 / 9)
"""Of pictures as cameras take them, the longer side over the shorter; a picture of none of these was cropped."""
ASPECT_SLACK = 0.01
RADIAL_SIGMA = 0.12
"""Of the radial term; an assumption: phones straighten their photos to about 1 % at the corners, but webcams and raw
photos have -0.1 and more. The rings tell it, so that a wide prior costs nothing."""
SCAN_SIGMA = (1e-3, 1e-3, 3e-4)
"""Of a flatbed's stated resolution, of its two axes against each other, and of their angle (rad). An assumption: no
maker states them; a calibrated ruler in a scan tells them."""
CENTRE_FLOOR_PX = 0.01
ROUNDS = 3


@dataclass(frozen=True, eq=False)
class Sighting:
    """The rings of one picture."""

    image_size: tuple[int, int]  # width, height in px
    ring: Rows  # (N,) rows of the target
    center_px: Array  # (N, 2)
    cov_px2: Array  # (N, 2, 2)
    focal_px: float | None = None  # as the file states it
    dpi: float | None = None  # of a scan; None: a photo

    @property
    def diagonal_px(self) -> float:
        """Of the picture."""
        return math.hypot(*self.image_size)

    @property
    def middle_px(self) -> Array:
        """Of the picture."""
        return (np.array(self.image_size) - 1) / 2

    @property
    def is_cropped(self) -> bool:
        """Whether it is a photo of a shape that no camera takes, so that the lens's middle may be anywhere."""
        aspect = max(self.image_size) / min(self.image_size)
        return self.dpi is None and all(abs(aspect / usual - 1) > ASPECT_SLACK for usual in CAMERA_ASPECTS)


@dataclass(frozen=True, eq=False)
class Placed:
    """Where the design lies in one picture: `placed.pixel(place_mm)`, `placed.design(pixel)`."""

    matrix: Array  # (3, 3) image plane from design plane, both straight
    focal_px: Array  # (2,)
    centre_px: Array  # (2,)
    radial: float

    @property
    def tilt_rad(self) -> float:
        """Between the coupon's normal and the camera's axis."""
        normal = np.cross(*self.matrix[:, :2].T)
        return math.atan2(math.hypot(normal[0], normal[1]), abs(normal[2]))

    def pixel(self, place_mm: Array) -> Array:
        """Pixels of places on the design.  # (..., 2)"""
        flat = place_mm @ self.matrix[:, :2].T + self.matrix[:, 2]
        straight = flat[..., :2] / flat[..., 2:]
        bent = straight * (1 + self.radial * (straight**2).sum(axis=-1, keepdims=True))
        pixel: Array = bent * self.focal_px + self.centre_px
        return pixel

    def design(self, pixel: Array) -> Array:
        """Places on the design at pixels.  # (..., 2)"""
        bent = (pixel - self.centre_px) / self.focal_px
        straight = bent
        for _ in range(ROUNDS if self.radial else 0):  # a term of a few percent: each round takes it down a hundredfold
            straight = bent / (1 + self.radial * (straight**2).sum(axis=-1, keepdims=True))
        inverse = np.linalg.inv(self.matrix)
        flat = straight @ inverse[:, :2].T + inverse[:, 2]
        place: Array = flat[..., :2] / flat[..., 2:]
        return place


@dataclass(frozen=True, eq=False)
class PlacedPictures:
    """All pictures, solved together."""

    placed: tuple[Placed, ...]
    print_numbers: Array  # (3,) size, stretch, skew (rad)
    covariance: Array  # (3, 3)
    rms_px: tuple[float, ...]  # of the rings' centres, of each picture


@dataclass(frozen=True)
class KnownLength:
    """A distance between two rings that was measured."""

    first: int
    second: int
    value_mm: float
    sigma_mm: float


def print_matrix(numbers: Array) -> Array:
    """The print from the design.  # (2, 2)"""
    size, stretch, skew = numbers
    return np.array([[1 + size + stretch / 2, skew / 2], [skew / 2, 1 + size - stretch / 2]])


@dataclass(frozen=True, eq=False)
class _Photo:
    """A photo's unknowns: a turn and a shift from where it starts; those of its camera are shared."""

    seen: Sighting
    camera: int  # which of the cameras took it
    start: Array  # (4, 4) cam_from_target

    def placed(self, own: Array, camera: Array, shape: Array) -> Placed:
        focal = _first_focal(self.seen) * math.exp(camera[0])
        rotation = exp_rotation(own[:3]) @ self.start[:3, :3]
        shift = self.start[:3, 3] * (1 + np.array([0, 0, own[5]])) + np.array([own[3], own[4], 0]) * self.start[2, 3]
        matrix = np.column_stack([rotation[:, :2] @ shape, shift])
        centre = self.seen.middle_px + camera[1:3] * self.seen.diagonal_px
        return Placed(matrix, np.array([focal, focal]), centre, float(camera[3]))


@dataclass(frozen=True, eq=False)
class _Scan:
    """A scan's unknowns: its turn and shift from where it starts, and what its axes are off."""

    seen: Sighting
    start: Array  # (2, 3) pixels from mm: turn, and shift
    camera: int = -1

    def placed(self, own: Array, camera: Array, shape: Array) -> Placed:
        scale, stretch, lean = own[3:]
        cos, sin = math.cos(own[0]), math.sin(own[0])
        off = np.array([[1 + scale + stretch / 2, lean / 2], [lean / 2, 1 + scale - stretch / 2]])
        turn = off @ np.array([[cos, -sin], [sin, cos]]) @ self.start[:, :2] @ shape
        shift = self.start[:, 2] + own[1:3] * self.seen.diagonal_px
        matrix = np.vstack([np.column_stack([turn, shift - self.seen.middle_px]), [0.0, 0.0, 1.0]])
        return Placed(matrix, np.ones(2), self.seen.middle_px, 0.0)


_Picture = _Photo | _Scan


def place(target: TargetGeometry, sightings: Sequence[Sighting], lengths: Sequence[KnownLength] = ()) -> PlacedPictures:
    """Solve pictures of one print together: `place(target, [sighting])`.

    Args:
        target: as designed, one face.
        sightings: of its rings.
        lengths: that were measured; with none, and no scan, the size stays as its prior has it.
    """
    cameras = list(dict.fromkeys(_camera_key(one) for one in sightings if one.dpi is None))
    return _solved(target, [_nearest(target, one, cameras) for one in sightings], cameras, lengths)


def _camera_key(seen: Sighting) -> tuple[tuple[int, int], float | None]:
    """Photos of one size with one stated focal length are of one camera."""
    return seen.image_size, seen.focal_px


def _first_focal(seen: Sighting) -> float:
    return seen.focal_px or USUAL_FOCAL * seen.diagonal_px


def _nearest(target: TargetGeometry, seen: Sighting, cameras: list[tuple[tuple[int, int], float | None]]) -> _Picture:
    """Where to start: of the two poses that a plane seen from afar may have, the one that fits alone."""
    place_mm = target.center_in_face_mm[seen.ring, :2]
    if seen.dpi is not None:
        return _Scan(seen, _first_similarity(place_mm, seen))
    focal, middle = _first_focal(seen), seen.middle_px
    matrix = np.array([[focal, 0, middle[0]], [0, focal, middle[1]], [0, 0, 1.0]])
    _, turns, shifts, _ = cv2.solvePnPGeneric(
        target.center_in_face_mm[seen.ring], seen.center_px, matrix, None, flags=cv2.SOLVEPNP_IPPE
    )
    tried = []
    for turn, shift in zip(turns, shifts, strict=True):
        start = np.eye(4)
        start[:3, :3], start[:3, 3] = exp_rotation(np.ravel(turn)), np.ravel(shift)
        photo = _Photo(seen, cameras.index(_camera_key(seen)), start)
        alone = _solved(target, [_Photo(seen, 0, start)], [_camera_key(seen)], ())
        tried.append((alone.rms_px[0], photo))
    return min(tried, key=lambda pair: pair[0])[1]


def _first_similarity(place_mm: Array, seen: Sighting) -> Array:
    """Pixels from mm by least squares, a turn times the stated resolution, and a shift.  # (2, 3)"""
    per_mm = (seen.dpi or 0.0) / 25.4
    middle_px, middle_mm = seen.center_px.mean(axis=0), place_mm.mean(axis=0)
    left, _, right = np.linalg.svd((seen.center_px - middle_px).T @ (place_mm - middle_mm))
    turn = per_mm * left @ right
    return np.column_stack([turn, middle_px - turn @ middle_mm])


def _solved(
    target: TargetGeometry,
    pictures: Sequence[_Picture],
    cameras: Sequence[tuple[tuple[int, int], float | None]],
    lengths: Sequence[KnownLength],
) -> PlacedPictures:
    """Least squares with priors; rings are given as much error of their own as their residuals show."""
    from scipy.optimize import least_squares

    place_mm = target.center_in_face_mm[:, :2]
    prior_sigma = _prior_sigma(pictures, cameras)
    has_prior = np.isfinite(prior_sigma)

    def placed(numbers: Array) -> list[Placed]:
        shape, shared = print_matrix(numbers[:3]), numbers[3 : 3 + 4 * len(cameras)].reshape(-1, 4)
        shared = np.concatenate([shared, np.zeros((1, 4))])  # a scan has no camera
        own = numbers[3 + 4 * len(cameras) :].reshape(len(pictures), 6)
        return [one.placed(part, shared[one.camera], shape) for one, part in zip(pictures, own, strict=True)]

    def residuals(numbers: Array, weights: list[Array]) -> Array:
        parts = [
            np.einsum("nij,nj->ni", weight, where.pixel(place_mm[one.seen.ring]) - one.seen.center_px).ravel()
            for one, where, weight in zip(pictures, placed(numbers), weights, strict=True)
        ]
        shape = print_matrix(numbers[:3])
        told = [
            (np.linalg.norm(shape @ (place_mm[one.first] - place_mm[one.second])) - one.value_mm) / one.sigma_mm
            for one in lengths
        ]
        return np.concatenate([*parts, np.array(told), (numbers / prior_sigma)[has_prior]])

    numbers, jitter = np.zeros(len(prior_sigma)), [CENTRE_FLOOR_PX] * len(pictures)
    for _ in range(ROUNDS):
        weights = [_weights(one.seen.cov_px2, own) for one, own in zip(pictures, jitter, strict=True)]
        fit = least_squares(residuals, numbers, args=(weights,), method="lm" if numbers.size < 60 else "trf")
        numbers = fit.x
        off = [
            where.pixel(place_mm[one.seen.ring]) - one.seen.center_px
            for one, where in zip(pictures, placed(numbers), strict=True)
        ]
        share = [max(1 - 8 / (2 * len(one)), 0.2) for one in off]
        jitter = [max(math.sqrt((one**2).mean() / part), CENTRE_FLOOR_PX) for one, part in zip(off, share, strict=True)]
    covariance = np.linalg.inv(fit.jac.T @ fit.jac)[:3, :3]
    rms = tuple(map(rms_length, off))
    return PlacedPictures(tuple(placed(numbers)), numbers[:3], covariance, rms)


def _weights(cov_px2: Array, jitter_px: float) -> Array:
    """Inverse roots of covariances.  # (N, 2, 2)"""
    value, vector = np.linalg.eigh(cov_px2 + jitter_px**2 * np.eye(2))
    weights: Array = vector / np.sqrt(value)[:, None] @ vector.transpose(0, 2, 1)
    return weights


def _prior_sigma(pictures: Sequence[_Picture], cameras: Sequence[tuple[tuple[int, int], float | None]]) -> Array:
    """Standard deviations of all unknowns before anything was seen; infinite: none."""
    sigma: list[float] = [*PRINT_SIGMA]
    cropped = {one.camera for one in pictures if one.seen.is_cropped}
    for number, (_, stated) in enumerate(cameras):
        centre = CROPPED_SIGMA if number in cropped else CENTRE_SIGMA
        sigma += [GUESSED_FOCAL if stated is None else STATED_FOCAL, centre, centre, RADIAL_SIGMA]
    for one in pictures:
        sigma += [math.inf] * 6 if isinstance(one, _Photo) else [math.inf] * 3 + list(SCAN_SIGMA)
    return np.array(sigma)
