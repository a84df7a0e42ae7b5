"""Photos and scans of a coupon as it might have been printed, drawn from its outlines: nothing here measures.

Ink is grown as outlines (radii of ellipses, sides of lines), the light of each pixel is summed over points within it,
blurred in linear light (a part of it as they are drawn), and only then given a tone curve, sharpened, and made noisy.
"""

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from designer.base.arrays import Array
from designer.kinds.coupon import COUPON
from designer.target import TargetGeometry

ACROSS = 3
"""Points along a pixel's side at which light is taken."""
MOST_SOFT_PX, SOFT_PX = 1.2, 0.8
"""Standard deviation of the blur up to which outlines are drawn with all of it, else with the second and the rest is
added to the pixels: a lens blurs before pixels sample, and sharp outlines leave steps in them that no lens leaves."""
WHITE, BLACK, TABLE = 0.72, 0.03, 0.3


@dataclass(frozen=True)
class Printed:
    """What a printer did, along the target's axes."""

    bleed_mm: tuple[float, float] = (0.0, 0.0)  # along x and y, of black into white
    white_bleed_mm: tuple[float, float] = (0.0, 0.0)  # more of it at lines of white
    strain: tuple[float, float, float] = (0.0, 0.0, 0.0)  # xx, yy, xy

    @property
    def print_from_design(self) -> Array:
        """As a matrix.  # (2, 2)"""
        xx, yy, xy = self.strain
        return np.array([[1 + xx, xy], [xy, 1 + yy]])


@dataclass(frozen=True)
class Taken:
    """How a photo was taken."""

    size: tuple[int, int] = (2000, 1500)
    focal_px: float = 1700.0
    centre_px: tuple[float, float] = (0.0, 0.0)  # off the middle
    radial: float = 0.0  # of x (1 + k r^2)
    tilt_rad: float = 0.3
    tilt_to_rad: float = 0.7
    roll_rad: float = 0.0
    distance_mm: float = 80.0
    blur_px: float = 1.0
    defocus_px: float = 0.0  # radius of a disc, a blur that is no bell
    gamma: float = 2.2
    contrast: float = 0.0  # of an S-curve after the gamma
    sharpening: float = 0.0
    sharpening_px: float = 1.5
    noise: float = 1.5  # grey levels of 255
    gradient: float = 0.3  # of light across the picture
    veil: float = 0.0  # light from everywhere
    light: float = 1.0
    scan_dpi: float | None = None  # a scan instead of a photo
    scan_strain: tuple[float, float] = (0.0, 0.0)  # its own error along the columns beyond the rows', and its lean
    jpeg: int | None = None  # quality


def pose_of(taken: Taken) -> tuple[Array, Array]:
    """Rotation and shift into the camera's frame: facing the camera, then rolled and tilted."""
    cos, sin = np.cos(taken.roll_rad), np.sin(taken.roll_rad)
    roll = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1.0]])
    axis = np.array([np.cos(taken.tilt_to_rad), np.sin(taken.tilt_to_rad), 0.0]) * taken.tilt_rad
    tilt, _ = cv2.Rodrigues(axis)
    return tilt @ np.diag([1.0, -1.0, -1.0]) @ roll, np.array([1.5, -1.0, taken.distance_mm])


def design_of(pixel: Array, printed: Printed, taken: Taken) -> Array:
    """Places on the design at pixels.  # (..., 2) -> (..., 2)"""
    width, height = taken.size
    middle = np.array([(width - 1) / 2, (height - 1) / 2])
    if taken.scan_dpi is not None:
        per_mm = taken.scan_dpi / 25.4
        more, lean = taken.scan_strain
        turned = (pixel - middle) / per_mm @ np.linalg.inv(np.array([[1.0, 0.0], [lean, 1 + more]])) * [1, -1]
        cos, sin = np.cos(taken.roll_rad), np.sin(taken.roll_rad)
        flat = turned @ np.array([[cos, -sin], [sin, cos]])
    else:
        bent = (pixel - middle - taken.centre_px) / taken.focal_px
        straight = bent
        for _ in range(10 if taken.radial else 0):  # each takes what is left down by twenty and more
            straight = bent / (1 + taken.radial * (straight[..., :1] ** 2 + straight[..., 1:] ** 2))
        ray = np.concatenate([straight, np.ones_like(straight[..., :1])], axis=-1)
        rotation, shift = pose_of(taken)
        origin, toward = -rotation.T @ shift, ray @ rotation
        flat = origin[:2] - origin[2] * toward[..., :2] / toward[..., 2:]
    design: Array = flat @ np.linalg.inv(printed.print_from_design).T
    return design


def soft_px(taken: Taken) -> float:
    """The blur that outlines are drawn with."""
    return taken.blur_px if taken.blur_px <= MOST_SOFT_PX else SOFT_PX


def _ink(place: Array, soft_mm: Array, target: TargetGeometry, printed: Printed) -> Array:
    """How much ink there is at places on the design, 0 to 1.

    Args:
        place: (N, 2).
        soft_mm: (N, 2, 2) the blur, which is round in the picture: to x and y on the design, along columns and rows.
        target: the design.
        printed: what became of it.
    """
    ink = np.zeros(len(place))
    along = np.array(printed.bleed_mm)
    cell = np.clip(np.round(place / COUPON.pitch_mm).astype(int) + COUPON.columns // 2, 0, COUPON.columns - 1)
    nearest = cell[:, 0] + COUPON.columns * cell[:, 1]  # rings are in order, row by row
    offset = place - target.center_mm[nearest, :2]
    for row in range(target.ring_count):
        mine = nearest == row
        for radius, way in ((target.radius_outer_mm[row], 1.0), (target.radius_inner_mm[row], -1.0)):
            if radius > 0:
                axes = radius + way * along
                scaled = np.hypot(*(offset[mine] / axes).T)
                steep = offset[mine] / axes**2 / np.maximum(scaled, 1e-9)[:, None]
                soft = np.hypot(*np.einsum("ni,nij->jn", steep, soft_mm[mine]))
                ink[mine] += way * ndtr((1 - scaled) / np.maximum(soft, 1e-9))
    return np.maximum(ink, _lines(place, soft_mm, printed))


def _lines(place: Array, soft_mm: Array, printed: Printed) -> Array:
    """The same of the lines."""
    ink, soft = np.zeros(len(place)), np.hypot(soft_mm[:, :, 0], soft_mm[:, :, 1])
    for bar in COUPON.marks_mm:
        low, high = bar.min(axis=0), bar.max(axis=0)
        grown = np.array(printed.bleed_mm)
        if np.isclose((high - low).min(), 1.8):  # of the black between white lines
            grown = grown + printed.white_bleed_mm
        middle, half = (low + high) / 2, (high - low) / 2
        near = np.flatnonzero(np.abs(place[:, 0] - middle[0]) < half[0] + 1)
        near = near[np.abs(place[near, 1] - middle[1]) < half[1] + 1]
        outside = (np.abs(place[near] - middle) - half - grown) / soft[near]
        ink[near] = np.maximum(ink[near], ndtr(-np.maximum(*outside.T)))
    return ink


def reflected(printed: Printed, taken: Taken, target: TargetGeometry) -> Array:
    """Linear light of each pixel, before the lens's blur.  # (H, W)"""
    width, height = taken.size
    light = np.zeros(height * width)
    u, v = (axis.ravel().astype(float) for axis in np.meshgrid(np.arange(width), np.arange(height)))
    side_mm = COUPON.size_mm[0] / 2
    rough = design_of(np.stack([u, v], axis=1), printed, taken)
    furthest = np.maximum(*np.abs(rough).T)
    light[:] = np.where(furthest < side_mm, WHITE, TABLE)
    (rows,) = np.nonzero(furthest < 26)
    by_v, by_u = np.gradient(rough.reshape(height, width, 2), axis=(0, 1))
    soft_mm = soft_px(taken) * np.stack([by_u, by_v], axis=-1).reshape(-1, 2, 2)
    ink = _ink(rough[rows], soft_mm[rows], target, printed)
    is_edge = (ink > 1e-6) & (ink < 1 - 1e-6)  # elsewhere all points of a pixel are alike
    edge, total = rows[is_edge], np.zeros(int(is_edge.sum()))
    for i in range(ACROSS):
        for j in range(ACROSS):
            at = np.stack([u[edge] + (i + 0.5) / ACROSS - 0.5, v[edge] + (j + 0.5) / ACROSS - 0.5], axis=1)
            total += _ink(design_of(at, printed, taken), soft_mm[edge], target, printed)
    ink[is_edge] = total / ACROSS**2
    light[rows] = WHITE + (BLACK - WHITE) * ink
    slope = 1 + taken.gradient * ((u / width - 0.5) * 0.8 + (v / height - 0.5) * 0.6)
    return (light * slope * taken.light).reshape(height, width)


def coupon_photo(printed: Printed, taken: Taken, rng: np.random.Generator) -> NDArray[np.uint8]:
    """A photo, or a scan if `taken` says so."""
    return developed(reflected(printed, taken, COUPON.lay_out()), taken, rng)


def developed(light: Array, taken: Taken, rng: np.random.Generator) -> NDArray[np.uint8]:
    """Linear light through lens, tone curve, sharpening and noise."""
    if taken.defocus_px:
        reach = int(np.ceil(taken.defocus_px)) + 1
        y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1]
        disc = np.clip(taken.defocus_px + 0.5 - np.hypot(x, y), 0, 1)
        light = cv2.filter2D(light, -1, disc / disc.sum())
    if taken.blur_px > soft_px(taken):
        light = cv2.GaussianBlur(light, (0, 0), np.sqrt(taken.blur_px**2 - soft_px(taken) ** 2))
    tone = np.clip(light + taken.veil, 0, None) ** (1 / taken.gamma)
    tone = tone + taken.contrast * (3 * tone**2 - 2 * tone**3 - tone)
    if taken.sharpening:
        tone = tone + taken.sharpening * (tone - cv2.GaussianBlur(tone, (0, 0), taken.sharpening_px))
    levels = 255 * tone + rng.normal(0, taken.noise, tone.shape)
    photo = np.clip(np.round(levels), 0, 255).astype(np.uint8)
    if taken.jpeg is None:
        return photo
    return cv2.imdecode(cv2.imencode(".jpg", photo, [cv2.IMWRITE_JPEG_QUALITY, taken.jpeg])[1], cv2.IMREAD_GRAYSCALE)


def scan_of(dpi: float, **changes: float) -> Taken:
    """A flatbed's scan of the coupon alone."""
    side = round(66 / 25.4 * dpi)
    return replace(
        Taken(size=(side, side), scan_dpi=dpi, gradient=0.0, blur_px=0.8, tilt_rad=0.0, noise=1.0), **changes
    )
