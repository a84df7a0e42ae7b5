"""Exact pictures of single rings in a plane, with the parameters of the detector's model that describe them."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.detector.ring_model import BLUR, DARKNESS, E00, M0, PARAMETERS, RATIO, WHITE
from tests.benchmarks.synthetic import Array, Box, conic_of_circle, ellipse_coverage, plane_view

CELL = 4
"""Light is drawn and blurred on so many cells a pixel each way."""
WHITE_LEVEL, INK_LEVEL = 200.0, 40.0
LIMIT = 1.5
"""There is nothing but white around a ring."""


@dataclass(frozen=True)
class Ring:
    """A ring (ratio 0: a dot) in a tilted plane, and the light on it."""

    radius_px: float = 15.0  # of the outer circle, were it not tilted
    ratio: float = 0.45
    tilt_rad: float = 0.0
    axis_rad: float = 0.0
    focal_px: float = 1000.0
    blur_px: float = 0.7
    offset_px: tuple[float, float] = (0.0, 0.0)  # of the projected centre from the middle of its picture
    light: tuple[float, float] = (0.0, 0.0)  # relative change of the lamp's light per px
    veil: tuple[float, float] = (0.0, 0.0)  # change per px of light that is added, in shares of white

    @property
    def side_px(self) -> int:
        """How large a square picture must be to hold it, with white around."""
        return 2 * int(1.6 * self.radius_px + 6) + 1

    def plane(self, corner: tuple[int, int] = (0, 0)) -> Array:
        """`pixel_from_plane` in radii, if its picture's first pixel is at `corner`.  # (3, 3)"""
        middle = np.array(corner) + self.side_px // 2 + np.array(self.offset_px)
        return plane_view(self.focal_px, self.tilt_rad, self.axis_rad, self.focal_px / self.radius_px, middle)

    def picture(self) -> Array:
        """Grey levels without noise: light falls on paper and ink, is blurred, and summed up by square pixels."""
        side = self.side_px
        box = Box(0, 0, side, side)
        ink = ellipse_coverage(conic_of_circle(self.plane(), np.zeros(2), 1.0), box, CELL, 8 * CELL)
        if self.ratio > 0:
            ink = ink - ellipse_coverage(conic_of_circle(self.plane(), np.zeros(2), self.ratio), box, CELL, 8 * CELL)
        ink = ink.reshape(side * CELL, 8, side * CELL).mean(axis=1)
        place = (np.arange(side * CELL) + 0.5) / CELL - 0.5 - side // 2
        lamp = 1 + self.light[0] * place + self.light[1] * place[:, None]
        light = lamp * (WHITE_LEVEL - (WHITE_LEVEL - INK_LEVEL) * ink)
        light += WHITE_LEVEL * (self.veil[0] * place + self.veil[1] * place[:, None])
        half = int(np.ceil(6 * self.blur_px * CELL))
        # The plane of light goes on beyond the picture: reflected, not repeated, it keeps its slope.
        light = np.pad(light, half, mode="reflect", reflect_type="odd")
        light = cv2.GaussianBlur(light, (2 * half + 1, 2 * half + 1), self.blur_px * CELL)[half:-half, half:-half]
        return np.asarray(light.reshape(side, CELL, side, CELL).mean(axis=(1, 3)), dtype=np.float64)

    def parameters(self, corner: tuple[int, int] = (0, 0)) -> Array:
        """The model's parameters, as the picture has them.  # (PARAMETERS,)"""
        return parameters_of(self.plane(corner), self.ratio, self.blur_px)


def parameters_of(pixel_from_plane: Array, ratio: float, blur_px: float) -> Array:
    """The model of the unit circle of a plane: u = c + A X / (1 + w X) inverted.  # (3, 3) -> (PARAMETERS,)"""
    view = pixel_from_plane / pixel_from_plane[2, 2]
    center, w = view[:2, 2], view[2, :2]
    back = np.linalg.inv(view[:2, :2] - np.outer(center, w))
    gram = back.T @ back
    p = np.zeros(PARAMETERS)
    p[:2] = center
    p[E00 : E00 + 3] = triangle_of(gram)
    p[M0 : M0 + 2] = back.T @ w
    p[RATIO] = ratio
    p[BLUR] = np.hypot(blur_px, np.sqrt(1 / 12))
    p[WHITE], p[DARKNESS] = WHITE_LEVEL, 1 - INK_LEVEL / WHITE_LEVEL
    return p


def triangle_of(gram: Array) -> Array:
    """The lower triangle E with a positive diagonal and E'E = gram, as E00, E10, E11.  # (2, 2) -> (3,)"""
    e11 = np.sqrt(gram[1, 1])
    e10 = gram[0, 1] / e11
    return np.array([np.sqrt(gram[0, 0] - e10**2), e10, e11])


@dataclass(frozen=True, eq=False)
class Mosaic:
    """N rings of one size, each in a square of its own."""

    image: NDArray[np.float32]
    params: Array  # (N, PARAMETERS)

    @property
    def center_px(self) -> Array:
        """Projected centres.  # (N, 2)"""
        return self.params[:, :2]


def mosaic(rings: list[Ring], columns: int = 10) -> Mosaic:
    """Pictures of rings side by side."""
    side = max(ring.side_px for ring in rings)
    lines = -(-len(rings) // columns)
    image = np.full((lines * side, columns * side), WHITE_LEVEL, dtype=np.float32)
    params = []
    for n, ring in enumerate(rings):
        left, top = side * (n % columns), side * (n // columns)
        image[top : top + ring.side_px, left : left + ring.side_px] = ring.picture()
        params.append(ring.parameters((left, top)))
    return Mosaic(image, np.array(params))


def random_rings(count: int, rng: np.random.Generator, **fixed: float) -> list[Ring]:
    """Rings of one radius at random places within a pixel, turned about random axes."""
    return [
        Ring(**fixed, axis_rad=rng.uniform(0, 2 * np.pi), offset_px=(rng.uniform(-0.5, 0.5), rng.uniform(-0.5, 0.5)))
        for _ in range(count)
    ]


def disturbed(params: Array, rng: np.random.Generator) -> Array:
    """Starting values such as ellipses of borders give them: a tenth of a pixel off, no vanishing line.  # (N, P)"""
    start = params.copy()
    start[:, :2] += rng.normal(0, 0.1, (len(start), 2))
    start[:, 2:5] *= 1 + rng.normal(0, 0.01, (len(start), 3))
    start[:, 5:7] = 0.0
    start[:, RATIO] *= 1.05
    start[:, BLUR] *= 1.2
    start[:, WHITE] *= 0.98
    return start
