"""Drawing on a photo with sub-pixel places, text that is readable, and a memory of what is already taken."""

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

Colour = tuple[int, int, int]  # red, green, blue
Point = tuple[float, float]  # u, v in px of the photo
Box = tuple[int, int, int, int]  # left, top, right, bottom in cells of the map of what is taken

_SHIFT = 4
"""OpenCV takes places in 1/16 px."""
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

    def ellipse(self, ellipse: NDArray[np.float64], colour: Colour, width: float, dashes: int = 0) -> None:
        """The outline of an ellipse (centre u v, semi-axes, angle in rad), or as many dashes of it."""
        points = ellipse_points(ellipse, max(48, 8 * dashes))
        if not dashes:
            self.line(points, colour, width, closed=True)
            return
        for dash in np.array_split(points, 2 * dashes)[::2]:
            self.line(dash, colour, width)

    def line(self, points: NDArray[np.float64], colour: Colour, width: float, *, closed: bool = False) -> None:
        """A line through points.  # (N, 2)"""
        on_canvas = (points + 0.5) * self.scale - 0.5
        if not np.isfinite(on_canvas).all() or np.abs(on_canvas).max() > 2**26:
            return  # beyond what OpenCV's whole numbers hold, so not in the picture
        fixed = np.rint(on_canvas * 2**_SHIFT).astype(np.int32)
        cv2.polylines(self.pixels, [fixed], closed, colour, max(1, round(width)), cv2.LINE_AA, _SHIFT)

    def take(self, ellipse: NDArray[np.float64]) -> None:
        """Keep text away from an ellipse."""
        points = ((ellipse_points(ellipse, 24) + 0.5) * self.scale - 0.5) / _TAKEN_PX
        if np.isfinite(points).all() and np.abs(points).max() < 2**26:
            cv2.fillConvexPoly(self.taken, np.rint(points).astype(np.int32), 1)

    def take_line(self, points: NDArray[np.float64], width: float) -> None:
        """Keep text away from a line.  # (N, 2)"""
        places = ((points + 0.5) * self.scale - 0.5) / _TAKEN_PX
        if np.isfinite(places).all() and np.abs(places).max() < 2**26:
            thickness = max(1, round(width / _TAKEN_PX))
            cv2.polylines(self.taken, [np.rint(places).astype(np.int32)], isClosed=False, color=1, thickness=thickness)

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


def ellipse_points(ellipse: NDArray[np.float64], count: int) -> NDArray[np.float64]:
    """Points of an ellipse's outline.  # (5,) -> (count, 2)"""
    turn = np.linspace(0, 2 * np.pi, count, endpoint=False)
    along, across = ellipse[2] * np.cos(turn), ellipse[3] * np.sin(turn)
    cosine, sine = np.cos(ellipse[4]), np.sin(ellipse[4])
    return np.stack([ellipse[0] + cosine * along - sine * across, ellipse[1] + sine * along + cosine * across], axis=1)


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
