"""Photos of flat boards, sampled 24 x 24 times where an edge crosses a pixel: what corners are measured against."""

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.core import homography
from designer.base.arrays import Array, Flags
from designer.marks.chessboard import Chessboard

FINE, PARTS = 24, 4
"""Samples a side of a pixel; its parts a side, which are blurred: a lens blurs before pixels sum the light up. Sums
that are blurred make edges along rows or columns uneven, by 2 % of the contrast: .02 px."""
Dark = Callable[[Array], Flags]
"""Where in its plane a board is dark: mm, x right, y up.  # (..., 2) -> (...)"""


def checkered(board: Chessboard) -> Dark:
    """A chessboard on white."""

    def dark(at_mm: Array) -> Flags:
        place = at_mm * np.array([1.0, -1.0]) / board.square_mm + np.array(board.squares) / 2
        inside = ((place >= 0) & (place < np.array(board.squares))).all(axis=-1)
        return np.asarray(inside & ((np.floor(place).sum(axis=-1) % 2 == 0) != board.light_first))

    return dark


@dataclass(frozen=True, eq=False)
class BoardPhoto:
    """A photo of a board, where its plane is seen at (N, 2) pixels, and a camera's straight pixels if it has a lens."""

    size: tuple[int, int]  # width, height
    px_from_mm: Array  # (3, 3) to straight pixels
    straight: Callable[[Array], Array] | None = None  # from pixels; None: they are straight

    def seen_at(self, at_mm: Array) -> Array:
        """Straight pixels of points."""
        return homography.apply(self.px_from_mm, at_mm)

    def plane_mm(self, pixel: Array) -> Array:
        """What pixels see; nan where that is behind the camera."""
        straight = pixel if self.straight is None else self.straight(pixel)
        inverse = np.linalg.inv(self.px_from_mm)
        at = np.concatenate([straight, np.ones((*straight.shape[:-1], 1))], axis=-1) @ inverse.T
        sign = np.sign(inverse[2] @ np.append(self.seen_at(np.zeros(2)), 1.0))
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(sign * at[..., 2:] > 0, at[..., :2] / at[..., 2:], np.nan)

    def light(self, dark: Dark, blur_px: float = 0.0) -> Array:
        """The share of each pixel that is light, after a lens with a Gaussian blur.  # (H, W)"""
        width, height = self.size
        corner = np.stack(np.meshgrid(np.arange(2 * width + 1), np.arange(2 * height + 1)), axis=-1) / 2 - 0.5
        coarse = dark(self.plane_mm(corner))
        parts = np.stack(
            [coarse[i : i + 2 * height - 1 : 2, j : j + 2 * width - 1 : 2] for i in range(3) for j in range(3)]
        )
        share = np.repeat(np.repeat(1.0 - parts[4].astype(np.float64), PARTS, axis=0), PARTS, axis=1)
        by_pixel = share.reshape(height, PARTS, width, PARTS)
        v, u = np.nonzero(parts.any(axis=0) != parts.all(axis=0))
        step = (np.arange(FINE) + 0.5) / FINE - 0.5
        fine = np.stack(np.meshgrid(step, step), axis=-1).reshape(-1, 2)
        side = FINE // PARTS
        for first in range(0, len(u), 4096):
            rows = slice(first, first + 4096)
            at = np.column_stack([u[rows], v[rows]])[:, None] + fine
            sampled = dark(self.plane_mm(at)).reshape(-1, PARTS, side, PARTS, side)
            by_pixel[v[rows], :, u[rows], :] = 1.0 - sampled.mean(axis=(2, 4))
        if blur_px:
            share = cv2.GaussianBlur(share, (0, 0), PARTS * blur_px)
        return np.asarray(share.reshape(height, PARTS, width, PARTS).mean(axis=(1, 3)))

    def levels(
        self,
        dark: Dark,
        rng: np.random.Generator,
        *,
        blur_px: float = 0.7,
        black: float = 40.0,
        white: float = 200.0,
        noise: float = 3.2,
    ) -> NDArray[np.uint8]:
        """The photo in bytes."""
        seen = black + (white - black) * self.light(dark, blur_px)
        return np.asarray((seen + rng.normal(0, noise, seen.shape)).round().clip(0, 255), dtype=np.uint8)


def facing(
    size: tuple[int, int],
    step_px: float,
    step_mm: float,
    *,
    tilt_deg: float = 0.0,
    roll_deg: float = 0.0,
    axis_deg: float = 0.0,
    focal_px: float = 1000.0,
    shift_px: tuple[float, float] = (0.0, 0.0),
) -> BoardPhoto:
    """A board before a pinhole, its middle squares about `step_px` wide, tilted about an axis in its plane."""
    roll, axis, tilt = np.radians([roll_deg, axis_deg, tilt_deg])
    turn = cv2.Rodrigues(tilt * np.array([np.cos(axis), np.sin(axis), 0.0]))[0]
    turn = cv2.Rodrigues(np.array([0.0, 0.0, roll]))[0] @ turn @ np.diag([1.0, -1.0, -1.0])
    distance = focal_px * step_mm / step_px
    pose = np.column_stack([turn[:, 0], turn[:, 1], [0.0, 0.0, distance]])
    middle = 0.5 * (np.array(size) - 1) + np.array(shift_px)
    camera = np.array([[focal_px, 0, middle[0]], [0, focal_px, middle[1]], [0, 0, 1]])
    return BoardPhoto(size, camera @ pose)


@dataclass(frozen=True, eq=False)
class FisheyePhoto(BoardPhoto):
    """By an equidistant fisheye whose focal length is .27 of the photo's height; `px_from_mm` is to the camera's mm."""

    def seen_at(self, at_mm: Array) -> Array:
        """Pixels of points."""
        at = np.concatenate([at_mm, np.ones((len(at_mm), 1))], axis=1) @ self.px_from_mm.T
        off = np.linalg.norm(at[:, :2], axis=1, keepdims=True)
        return np.asarray(0.27 * self.size[1] * np.arctan2(off, at[:, 2:]) / off * at[:, :2] + self._middle)

    def plane_mm(self, pixel: Array) -> Array:
        """What pixels see; nan where that is behind the camera."""
        slope = (pixel - self._middle) / (0.27 * self.size[1])
        angle = np.linalg.norm(slope, axis=-1, keepdims=True)
        ray = np.concatenate([slope * np.sinc(angle / np.pi), np.cos(angle)], axis=-1)
        at = ray @ np.linalg.inv(self.px_from_mm).T
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(at[..., 2:] > 0, at[..., :2] / at[..., 2:], np.nan)

    @property
    def _middle(self) -> Array:
        return 0.5 * (np.array(self.size) - 1.0)


def seen_from_the_side(
    size: tuple[int, int], away_deg: float, rng: np.random.Generator, distance_mm: float = 240.0
) -> FisheyePhoto:
    """A board whose middle is so far off a fisheye's axis, turned towards the camera to about .25."""
    away, around = np.radians(away_deg), rng.uniform(0, 2 * np.pi)
    way = np.array([np.sin(away) * np.cos(around), np.sin(away) * np.sin(around), np.cos(away)])
    normal = rng.normal(0, 0.25, 3) - way
    x = np.cross(normal, rng.normal(size=3))
    y = np.cross(normal, x)
    return FisheyePhoto(size, np.column_stack([x / np.linalg.norm(x), y / np.linalg.norm(y), distance_mm * way]))
