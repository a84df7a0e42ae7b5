"""Where the parts of a drawing are, as far as it matters: which of them lie on an embedded picture."""

import math
import re
from dataclasses import dataclass
from typing import TypeAlias

from designer.page.drawing_tree import Element

Matrix: TypeAlias = tuple[float, float, float, float, float, float]
"""(a, b, c, d, e, f): x' = a x + c y + e, y' = b x + d y + f (SVG 2, section 8.5)."""
Box: TypeAlias = tuple[float, float, float, float]
"""Left, top, right, bottom."""

IDENTITY: Matrix = (1.0, 0.0, 0.0, 1.0, 0.0, 0.0)
_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
_STEP = re.compile(r"(matrix|translate|scale|rotate)\s*\(([^()]*)\)")
_RELATIVE_OR_ARC = re.compile(r"[a-yAHV]")
_EDGE = 1.0  # drawing units by which a line may stick out of a picture that it lies on


def numbers(text: str) -> list[float]:
    """All finite numbers in a text."""
    return [value for value in map(float, _NUMBER.findall(text)) if math.isfinite(value)]


def product(a: Matrix, b: Matrix) -> Matrix:
    """First `b`, then `a`."""
    return (
        a[0] * b[0] + a[2] * b[1], a[1] * b[0] + a[3] * b[1], a[0] * b[2] + a[2] * b[3], a[1] * b[2] + a[3] * b[3],
        a[0] * b[4] + a[2] * b[5] + a[4], a[1] * b[4] + a[3] * b[5] + a[5],
    )  # fmt: skip


def transform_of(element: Element) -> Matrix:
    """The element's own transform; a skew or a mistake counts as none."""
    matrix = IDENTITY
    for name, arguments in _STEP.findall(element.attributes.get("transform", "")):
        matrix = product(matrix, _step(name, numbers(arguments)))
    return matrix


def _step(name: str, values: list[float]) -> Matrix:
    """One transform of a list."""
    match name, values:
        case "matrix", [a, b, c, d, e, f]:
            return (a, b, c, d, e, f)
        case "translate", [x, *rest]:
            return (1, 0, 0, 1, x, rest[0] if rest else 0)
        case "scale", [x, *rest]:
            return (x, 0, 0, rest[0] if rest else x, 0, 0)
        case "rotate", [degrees]:
            cosine, sine = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
            return (cosine, sine, -sine, cosine, 0, 0)
        case "rotate", [degrees, x, y]:
            return product(product((1, 0, 0, 1, x, y), _step("rotate", [degrees])), (1, 0, 0, 1, -x, -y))
    return IDENTITY


@dataclass(frozen=True)
class Pictures:
    """The boxes of a drawing's embedded pictures."""

    boxes: tuple[Box, ...]

    def carry(self, element: Element, matrix: Matrix) -> bool:
        """Whether an element lies on one of them; `matrix` includes its own transform."""
        box = _box_of(element, matrix) if self.boxes else None
        return box is not None and any(_is_on(box, picture) for picture in self.boxes)


def pictures_in(root: Element) -> Pictures:
    """The pictures of a whole drawing."""
    boxes: list[Box] = []
    waiting = [(root, IDENTITY)]
    while waiting:
        element, above = waiting.pop()
        matrix = product(above, transform_of(element))
        if element.name == "image" and (box := _box_of(element, matrix)):
            boxes.append(box)
        waiting.extend((child, matrix) for child in element.children)
    return Pictures(tuple(boxes))


def _is_on(box: Box, picture: Box) -> bool:
    """Whether a box lies within a picture, its middle off the edge: a frame's line lies on the edge."""
    x, y = (box[0] + box[2]) / 2, (box[1] + box[3]) / 2
    is_middle_inside = picture[0] + _EDGE < x < picture[2] - _EDGE and picture[1] + _EDGE < y < picture[3] - _EDGE
    is_inside = all(inner >= outer - _EDGE for inner, outer in zip(box[:2], picture[:2], strict=True)) and all(
        inner <= outer + _EDGE for inner, outer in zip(box[2:], picture[2:], strict=True)
    )
    return is_middle_inside and is_inside


def _box_of(element: Element, matrix: Matrix) -> Box | None:
    """The box around an element's points; a group or text is where it starts."""
    match element.name:
        case "image" | "rect":
            x, y, width, height = (_number(element, name) for name in ("x", "y", "width", "height"))
            points = [(x, y), (x + width, y), (x, y + height), (x + width, y + height)]
        case "path":
            points = path_points(element)
        case "text" | "use":
            points = [(_number(element, "x"), _number(element, "y"))]
        case "g" if "transform" in element.attributes:
            points = [(0.0, 0.0)]
        case _:
            return None
    if not points:
        return None
    a, b, c, d, e, f = matrix
    xs = [a * x + c * y + e for x, y in points]
    ys = [b * x + d * y + f for x, y in points]
    return min(xs), min(ys), max(xs), max(ys)


def path_points(element: Element) -> list[tuple[float, float]]:
    """The points of a path of absolute commands, as matplotlib writes them; none of others."""
    course = element.attributes.get("d", "")
    if _RELATIVE_OR_ARC.search(course.replace("e", "")):
        return []
    values = numbers(course)
    return list(zip(values[0::2], values[1::2], strict=False))


def _number(element: Element, name: str) -> float:
    """An attribute that is a number, or zero."""
    found = numbers(element.attributes.get(name, ""))
    return found[0] if found else 0.0
