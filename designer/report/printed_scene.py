"""The 3D view of a design: the target as it is printed, its letters and its thickness included."""

import numpy as np
from manifold3d import triangulate
from numpy.typing import NDArray

from designer.make.pattern import Contour, Pattern
from designer.page.scene import Layer, Scene, Surface
from designer.produce import Design
from designer.report.slicer_steps import colour_words
from designer.target import bounding_radius_mm
from designer.target_scene import target_scene

_LIFT = 5e-4
"""Of letters above the surface, over the target's radius: enough for a browser's depth buffer."""


def printed_scene(design: Design) -> Scene:
    """The target with what is written on it, in the target frame, at the design's size."""
    printing, pattern = design.job.printing, printed_ink(design)
    scale = design.scale if printing.is_two_filament else 1.0
    body, ink = printing.body_colour, printing.ink_colour
    lift = _LIFT * bounding_radius_mm(design.target)
    letters = (
        _letters(pattern, tuple(face.dark_text for face in pattern.faces), ink, scale, lift),
        _letters(pattern, tuple(face.light_text for face in pattern.faces), body, scale, lift),
    )
    written = tuple(surface for surface in letters if surface is not None)
    more = (Layer("printed letters", written, has_switch=False),) if written else ()
    ways = ("body", "ink") if printing.is_two_filament else ("ground", "print")
    legend = tuple((colour, f"{way}, {colour_words(colour)}") for colour, way in zip((body, ink), ways, strict=True))
    return target_scene(design.target, body_colour=body, ink_colour=ink, legend=legend, more=more)


def printed_ink(design: Design) -> Pattern:
    """The pattern as it is made: set into plastic, or on paper and sheet."""
    return design.printed_pattern if design.job.printing.is_two_filament else design.artwork


def _letters(
    pattern: Pattern, contours: tuple[tuple[Contour, ...], ...], colour: str, scale: float, lift_mm: float
) -> Surface | None:
    """All letters of one colour; None where there are none."""
    vertices: list[NDArray[np.float64]] = []
    triangles: list[NDArray[np.int64]] = []
    count = 0
    for frame, face in zip(pattern.target_from_face, contours, strict=True):
        for contour in face:
            outline = contour if _area_mm2(contour) > 0 else contour[::-1]
            at = (outline @ frame[:3, :2].T + frame[:3, 3]) / scale + lift_mm * frame[:3, 2]
            vertices.append(at)
            triangles.append(triangulate([outline]).astype(np.int64) + count)
            count += len(outline)
    if not vertices:
        return None
    return Surface(np.concatenate(vertices), np.concatenate(triangles), colour)


def _area_mm2(contour: Contour) -> float:
    """Twice the signed area: above 0 where the contour runs counter-clockwise."""
    x, y = contour.T
    return float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum())
