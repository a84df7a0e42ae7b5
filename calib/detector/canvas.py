"""Drawing on a photo with sub-pixel places, text that is readable, and a memory of what is already taken."""

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from designer.base.arrays import Array

Colour = tuple[int, int, int]  # red, green, blue
Point = tuple[float, float]  # u, v in px of the photo
Box = tuple[int, int, int, int]  # left, top, right, bottom in cells of the map of what is taken

_SHIFT = 4
"""OpenCV takes places in 1/16 px."""
PAPER_LEVEL = 250
"""Grey beside a photo that is narrower than its strips."""
_FARTHEST = 2**26
_TAKEN_PX = 3
"""Side of a cell of the map of what is taken."""


@dataclass(frozen=True, eq=False)
class Canvas:
    """A photo being drawn on. Places are in px of the photo, widths and text heights in px of the canvas."""

    pixels: NDArray[np.uint8]  # (H, W, 3) red, green, blue; written to
    taken: NDArray[np.uint8]  # (H / 3, W / 3) not 0 where marks or text are; written to
    scale: float  # canvas px over photo px

    def place(self, point: Point) -> Point:
        """A place on the canvas. The centre of pixel (0, 0) of the photo is not the canvas's."""
        return (point[0] + 0.5) * self.scale - 0.5, (point[1] + 0.5) * self.scale - 0.5

    def ellipse(self, ellipse: Array, colour: Colour, width: float, dashes: int = 0) -> None:
        """The outlines of ellipses (centre u v, semi-axes, angle in rad), or as many dashes.  # (5,) or (N, 5)"""
        points = ellipse_points(np.atleast_2d(ellipse), max(48, 8 * dashes))
        if not dashes:
            self.line(points, colour, width, closed=True)
            return
        for dash in np.array_split(points, 2 * dashes, axis=1)[::2]:
            self.line(dash, colour, width)

    def line(self, points: Array, colour: Colour, width: float, *, closed: bool = False) -> None:
        """A line through points, or several in one colour.  # (K, 2) or (N, K, 2)"""
        on_canvas = (points.reshape(-1, *points.shape[-2:]) + 0.5) * self.scale - 0.5
        fixed = np.rint(_drawable(on_canvas) * 2**_SHIFT).astype(np.int32)
        cv2.polylines(self.pixels, list(fixed), closed, colour, max(1, round(width)), cv2.LINE_AA, _SHIFT)

    def take(self, ellipse: Array) -> None:
        """Keep text away from ellipses.  # (N, 5)"""
        points = ((ellipse_points(ellipse, 24) + 0.5) * self.scale - 0.5) / _TAKEN_PX
        for outline in np.rint(_drawable(points)).astype(np.int32):
            cv2.fillConvexPoly(self.taken, outline, 1)

    def take_line(self, points: Array, width: float) -> None:
        """Keep text away from a line.  # (N, 2)"""
        places = ((points[None] + 0.5) * self.scale - 0.5) / _TAKEN_PX
        outlines, thickness = list(np.rint(_drawable(places)).astype(np.int32)), max(1, round(width / _TAKEN_PX))
        cv2.polylines(self.taken, outlines, isClosed=False, color=1, thickness=thickness)

    def size(self, text: str, height: float) -> Point:
        """Width and height of a text, in px of the photo."""
        rows, columns = text_mask(text, round(height)).shape
        return columns / self.scale, rows / self.scale

    def free_box(self, middle: Point, text: str, height: float) -> Box | None:
        """The cells a text would take, if it is inside the picture and they are free."""
        mask = text_mask(text, round(height))
        u, v = self.place(middle)
        if not (np.isfinite(u) and np.isfinite(v)):
            return None
        rows, columns = mask.shape
        left, top = (u - columns / 2) / _TAKEN_PX, (v - rows / 2) / _TAKEN_PX
        right, bottom = (u + columns / 2) / _TAKEN_PX + 1, (v + rows / 2) / _TAKEN_PX + 1
        if left < 0 or top < 0 or right >= self.taken.shape[1] or bottom >= self.taken.shape[0]:
            return None
        box = int(left), int(top), int(right) + 1, int(bottom) + 1
        return None if self.taken[box[1] : box[3], box[0] : box[2]].any() else box

    def take_box(self, box: Box) -> None:
        """Keep other text away."""
        self.taken[box[1] : box[3], box[0] : box[2]] = 1

    def text(self, middle: Point, text: str, height: float, colour: Colour, *, opacity: float = 1.0) -> None:
        """A text around a place, on a light rim that keeps it readable on dark ground."""
        u, v = self.place(middle)
        if not (np.isfinite(u) and np.isfinite(v)):
            return
        mask = text_mask(text, round(height))
        left, top = round(u - mask.shape[1] / 2), round(v - mask.shape[0] / 2)
        if opacity == 1:
            rim = cv2.dilate(mask, np.ones((3, 3), np.uint8), iterations=max(1, round(height / 14)))
            blend(self.pixels, rim.astype(np.uint8), (left, top), (255, 255, 255), 0.75)
        blend(self.pixels, mask, (left, top), colour, opacity)


def canvas_between(
    above: NDArray[np.uint8], grey: NDArray[np.uint8], below: NDArray[np.uint8], scale: float
) -> tuple[NDArray[np.uint8], Canvas]:
    """A sheet with a photo between two strips of one width, and the part of it that is the photo, to draw on.

    They are one array from the start: moving a finished picture takes as long as drawing it.

    Args:
        above: (A, W, 3) red, green, blue.
        grey: (H, at most W).
        below: (B, W, 3)
        scale: canvas px over photo px.
    """
    (rows, columns), top, width = grey.shape, len(above), above.shape[1]
    sheet = np.empty((top + rows + len(below), width, 3), np.uint8)
    sheet[:top], sheet[top + rows :] = above, below
    if columns < width:
        sheet[top : top + rows] = PAPER_LEVEL
    left = (width - columns) // 2
    pixels = sheet[top : top + rows, left : left + columns]
    cv2.cvtColor(grey, cv2.COLOR_GRAY2RGB, dst=pixels)
    return sheet, Canvas(pixels, np.zeros((rows // _TAKEN_PX + 1, columns // _TAKEN_PX + 1), np.uint8), scale)


def _drawable(points: Array) -> Array:
    """Lines that OpenCV's whole numbers hold; what is beyond them is not in the picture.  # (N, K, 2)"""
    with np.errstate(invalid="ignore"):
        inside: Array = points[(np.abs(points) <= _FARTHEST).all(axis=(1, 2))]  # false if not finite
    return inside


def ellipse_points(ellipse: Array, count: int) -> Array:
    """Points of the outlines of ellipses.  # (..., 5) -> (..., count, 2)"""
    turn = np.linspace(0, 2 * np.pi, count, endpoint=False)
    u, v, large, small, angle = np.moveaxis(ellipse[..., None], -2, 0)
    along, across = large * np.cos(turn), small * np.sin(turn)
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.stack([u + cosine * along - sine * across, v + sine * along + cosine * across], axis=-1)


def blend(
    pixels: NDArray[np.uint8], mask: NDArray[np.uint8], at: tuple[int, int], colour: Colour, opacity: float
) -> None:
    """Lay a colour over pixels, as much as the mask says; what hangs over the edge is cut off."""
    left, top = at
    height, width = mask.shape
    u0, v0, u1, v1 = max(left, 0), max(top, 0), min(left + width, pixels.shape[1]), min(top + height, pixels.shape[0])
    if u0 >= u1 or v0 >= v1:
        return
    weight = mask[v0 - top : v1 - top, u0 - left : u1 - left, None].astype(np.float32) * (opacity / 255)
    below = pixels[v0:v1, u0:u1]
    below[:] = np.rint(below + weight * (np.array(colour, np.float32) - below)).astype(np.uint8)


@lru_cache(maxsize=4096)
def text_mask(text: str, height: int) -> NDArray[np.uint8]:
    """A line of text as grey levels, with a little room around it.  # (H, W)"""
    font = ImageFont.load_default(max(6, height))
    shown = text.encode("utf-8", "replace").decode()  # names of any bytes
    left, top, right, bottom = font.getbbox(shown)
    room = max(2, height // 6)
    image = Image.new("L", (max(1, round(right - left)) + 2 * room, max(1, round(bottom - top)) + 2 * room))
    ImageDraw.Draw(image).text((room - left, room - top), shown, fill=255, font=font)
    return np.asarray(image)
