"""What stands around an overlay: what was found in words above, the meaning of the marks below; and the colours."""

import math
from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from calib.core.types import Detections
from calib.detector.canvas import Canvas, Colour
from designer.base.arrays import Array
from designer.target import TargetGeometry

SIGMA_RANGE_PX = (0.001, 0.3)
"""Standard deviations that the colours of centres span, on a logarithmic scale; beyond, the end's colour."""

# The colours of Okabe and Ito, "Color Universal Design" (2008), which people with any colour vision tell apart.
FACE_COLOURS: tuple[Colour, ...] = ((0, 114, 178), (230, 159, 0), (0, 158, 115), (86, 180, 233), (204, 121, 167))
MISSING: Colour = (213, 94, 0)
REJECTED: Colour = (213, 0, 60)
LEFT_OUT = "found, not measured"
"""Said of other makers' marks, which are no rings."""
LEAST_WIDTH_PX = 720
INK: Colour = (30, 33, 38)
_SOFT: Colour = (105, 112, 122)
_PAPER: Colour = (250, 250, 248)
_PLASMA = cv2.applyColorMap(np.arange(256, dtype=np.uint8)[:, None], cv2.COLORMAP_PLASMA)[:, 0, ::-1].tolist()
"""Red, green and blue of each level; OpenCV makes this table anew whenever it is asked for one colour."""


def face_colours(target: TargetGeometry) -> tuple[Colour, ...]:
    """A colour for each face; faces of one colour look in directions that are far apart."""
    normals = target.target_from_face[:, :3, 2]
    chosen: list[int] = []
    for normal in normals:
        nearest = [max((float(normals[f] @ normal) for f, c in enumerate(chosen) if c == colour), default=-2.0)
                   for colour in range(len(FACE_COLOURS))]  # fmt: skip
        chosen.append(int(np.argmin(np.round(nearest, 6))))
    return tuple(FACE_COLOURS[k] for k in chosen)


def sigma_colour(sigma_px: float) -> Colour:
    """Blue for sure, over purple, to orange for unsure: dark enough for white paper, in order of lightness too."""
    low, high = map(math.log, SIGMA_RANGE_PX)
    share = (math.log(max(sigma_px, 1e-12)) - low) / (high - low) if math.isfinite(sigma_px) else 1.0
    red, green, blue = _PLASMA[round(255 * 0.82 * min(max(share, 0.0), 1.0))]
    return red, green, blue


def frame(seen: Detections, target: TargetGeometry, columns: int) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """What stands above and below a picture so wide: a header and a legend.  # (A, W, 3), (B, W, 3)"""
    width = max(columns, LEAST_WIDTH_PX)
    height = int(np.clip(width / 85, 14, 130))
    return _header(seen, target, width, height), _legend(target, width, height)


_Text = tuple[str, Colour]


def _header(seen: Detections, target: TargetGeometry, width: int, height: int) -> NDArray[np.uint8]:
    """Name, counts, faces and remarks, in as many lines as they need."""
    named = [record for record in seen.faces if record.face is not None and record.measurable]
    expected = sum(record.measurable for record in named)
    word = "features" if target.marks is None else target.feature_word
    found = f"{len(seen.ring)} of {expected} {word}" if named else "target not found"
    title: list[_Text] = [(cut_text(seen.image, 60), INK), (f"{seen.image_size[0]} x {seen.image_size[1]} px", _SOFT)]
    title.append((found, INK if len(seen.ring) else REJECTED))
    if len(seen.ring):
        sigma = np.sqrt(np.linalg.eigvalsh(seen.cov_px2)[:, 1])
        title.append((f"median sigma {_digits(float(np.median(sigma)))} px", _SOFT))
    rows = _flowed(title, width, height)
    if not target.is_planar and named:
        colours = face_colours(target)
        faces: list[_Text] = [("faces", _SOFT)]
        for record in sorted(named, key=lambda record: record.face or 0):
            faces.append((f"{record.face}: {record.rings_found}/{record.measurable}", _dark(colours[record.face or 0])))
        rows += _flowed(faces, width, height)
    rejected = 0 if seen.rejected_px is None else len(seen.rejected_px)
    remarks = [*seen.remarks]
    if rejected:
        remarks.append(f"{rejected} {'ring-like things without a name' if target.marks is None else LEFT_OUT}")
    if remarks:
        rows += _flowed([(cut_text(remark, 160), REJECTED) for remark in remarks], width, height)
    return _strip(rows, width, height)


def _legend(target: TargetGeometry, width: int, height: int) -> NDArray[np.uint8]:
    """The meaning of the marks, and the scale of the centres' colours."""
    icons = {"ring": 0, "dot": 1, "expected, not found": 2, "looks like a ring, no name": 3}
    if target.marks is not None:
        words = {"circle": 0} if target.radius_outer_mm.any() else {}
        corner = {} if target.radius_outer_mm.all() else {"corner": 4}
        icons = words | corner | {"expected, not found": 2, LEFT_OUT: 3}
    entries: list[_Text] = [(word, INK) for word in (*icons, "i,j : index in the face's lattice")]
    rows = _flowed(entries, width, height, indent=round(1.8 * height))
    strip = _strip([*rows, [], []], width, height)
    canvas = Canvas(strip, np.zeros((1, 1), np.uint8), 1.0)
    line, pen = _line_height(height), max(1.5, height / 9)
    icon = 0
    for number, row in enumerate(rows):
        for left, _, _ in row:
            middle = np.array([left - 0.95 * height, height / 2 + (number + 0.5) * line])
            if icon < len(icons):
                _draw_icon(canvas, list(icons.values())[icon], middle, 0.55 * height, pen)
            icon += 1
    _draw_scale(strip, height, round(height / 2 + (len(rows) + 0.4) * line))
    return strip


def _draw_icon(canvas: Canvas, icon: int, middle: Array, radius: float, pen: float) -> None:
    """A mark as it stands in the picture: ring, dot, missing, rejected, corner."""
    circle = np.array([*middle, radius, radius, 0.0])
    reach = np.array([[1.0, 0.0], [0.0, 1.0]]) * 0.45 * radius
    if icon == 2:
        canvas.ellipse(circle, MISSING, pen, dashes=9)
    elif icon == 3:
        for step in (np.array([1.0, 1.0]), np.array([1.0, -1.0])):
            canvas.line(np.stack([middle - 0.75 * radius * step, middle + 0.75 * radius * step]), REJECTED, 1.3 * pen)
    else:
        if icon == 1:
            cv2.circle(canvas.pixels, (round(middle[0]), round(middle[1])), round(radius), (70, 70, 70), cv2.FILLED)
            canvas.ellipse(np.array([*middle, 0.66 * radius, 0.66 * radius, 0.0]), (255, 255, 255), pen)
        if icon != 4:
            canvas.ellipse(circle, FACE_COLOURS[0], pen)
        for step in reach * (2.0 if icon == 4 else 1.0):
            canvas.line(np.stack([middle - step, middle + step]), sigma_colour(0.005), 0.8 * pen)


def _draw_scale(strip: NDArray[np.uint8], height: int, top: int) -> None:
    """A bar of the centres' colours with its numbers, as long as the strip allows."""
    low, high = map(math.log, SIGMA_RANGE_PX)
    caption = "standard deviation, px"
    font = ImageFont.load_default(height)
    left = height + round(font.getlength(caption)) + 2 * height
    length = min(26 * height, strip.shape[1] - left - 2 * height)
    steps = np.exp(np.linspace(low, high, length))
    bar = np.array([sigma_colour(step) for step in steps], np.uint8)
    strip[top + height // 8 : top + height // 2, left : left + length] = bar
    image = Image.fromarray(strip)
    draw = ImageDraw.Draw(image)
    draw.text((height, top), caption, fill=_SOFT, font=font)
    for tick in (0.001, 0.003, 0.01, 0.03, 0.1, 0.3):
        at = left + round((math.log(tick) - low) / (high - low) * (length - 1))
        small = ImageFont.load_default(max(9, round(0.72 * height)))
        draw.line([(at, top + height // 2), (at, top + round(0.65 * height))], fill=INK, width=max(1, height // 14))
        draw.text((at, top + round(0.68 * height)), f"{tick:g}", fill=INK, font=small, anchor="ma")
    strip[:] = np.asarray(image)


_Row = list[tuple[int, str, Colour]]


def _flowed(texts: Sequence[_Text], width: int, height: int, indent: int = 0) -> list[_Row]:
    """Texts one after the other, with their left ends; broken between texts where a line is full.

    Each has an indent before it.
    """
    font, gap = ImageFont.load_default(height), round(1.6 * height)
    rows: list[_Row] = [[]]
    left = height
    for text, colour in texts:
        length = indent + round(font.getlength(text))
        if rows[-1] and left + length > width - height:
            rows.append([])
            left = height
        rows[-1].append((left + indent, text, colour))
        left += length + gap
    return rows


def text_strip(texts: Sequence[_Text], width: int, height: int) -> NDArray[np.uint8]:
    """Texts on paper, in as many lines as they need.  # (A, W, 3)"""
    return _strip(_flowed(texts, width, height), width, height)


def _strip(rows: Sequence[_Row], width: int, height: int) -> NDArray[np.uint8]:
    """Lines of text on paper."""
    line = _line_height(height)
    image = Image.new("RGB", (width, height + line * len(rows)), _PAPER)
    draw, font = ImageDraw.Draw(image), ImageFont.load_default(height)
    for number, row in enumerate(rows):
        for left, text, colour in row:
            draw.text((left, height / 2 + (number + 0.5) * line), text, fill=colour, font=font, anchor="lm")
    return np.array(image)


def _line_height(height: int) -> int:
    return round(1.45 * height)


def _dark(colour: Colour) -> Colour:
    """Dark enough for text on paper."""
    red, green, blue = (round(0.72 * level) for level in colour)
    return red, green, blue


def _digits(value: float) -> str:
    """Two significant digits."""
    return f"{value:.{max(0, 1 - math.floor(math.log10(value)))}f}" if value > 0 else "0"


def cut_text(text: str, length: int) -> str:
    """A text without line breaks, its middle left out if it is long."""
    shown = " ".join(text.encode("utf-8", "replace").decode().split())
    return shown if len(shown) <= length else f"{shown[: length // 2 - 2]} ... {shown[2 - length // 2 :]}"
