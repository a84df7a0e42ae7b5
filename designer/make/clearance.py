"""The narrowest widths of a target's black and white: what decides whether it can be printed."""

from dataclasses import dataclass

import numpy as np

from designer.kinds.faces import border_width_mm
from designer.target import TargetGeometry


@dataclass(frozen=True)
class Widths:
    """Narrowest widths, in millimetres; infinite where a target has no such thing."""

    stroke_mm: float  # of a ring
    centre_mm: float  # diameter of a ring's white centre
    gap_mm: float  # between neighbouring rings or dots
    margin_mm: float  # between a ring and the border or, without one, the edge
    border_mm: float  # 0 without one

    @property
    def ink_offset_range_mm(self) -> tuple[float, float]:
        """Between these offsets no stroke and no white closes."""
        shrink = min(self.stroke_mm / 2, self.border_mm if self.border_mm > 0 else np.inf)
        # Both sides of a gap are ink; so are those of a margin, if there is a border.
        margin = self.margin_mm / 2 if self.border_mm > 0 else self.margin_mm
        return -shrink, min(self.centre_mm / 2, self.gap_mm / 2, margin)


def narrowest_widths(target: TargetGeometry) -> Widths:
    """The narrowest widths over all faces."""
    is_ring = ~target.is_dot
    inner, outer = target.radius_inner_mm[is_ring], target.radius_outer_mm[is_ring]
    return Widths(
        stroke_mm=float((outer - inner).min(initial=np.inf)),
        centre_mm=2 * float(inner.min(initial=np.inf)),
        gap_mm=_gap_mm(target),
        margin_mm=_margin_mm(target),
        border_mm=border_width_mm(target),
    )


def _gap_mm(target: TargetGeometry) -> float:
    """Least distance between the outer edges of features that are neighbours in their face's lattice."""
    face, index = target.ring_face, target.ring_index - target.ring_index.min(axis=0) + 1
    width = int(index.max()) + 2
    key = (face * width + index[:, 0]) * width + index[:, 1]
    order = np.argsort(key)
    least = np.inf
    for i_step, j_step in ((1, 0), (0, 1), (1, -1), (1, 1)):
        wanted = key + i_step * width + j_step
        place = np.minimum(np.searchsorted(key, wanted, sorter=order), len(key) - 1)
        neighbour = order[place]
        (has,) = np.nonzero(key[neighbour] == wanted)
        other = neighbour[has]
        distance = np.linalg.norm(target.center_mm[has] - target.center_mm[other], axis=1)
        gaps = distance - target.radius_outer_mm[has] - target.radius_outer_mm[other]
        least = min(least, float(gaps.min(initial=np.inf)))
    return least


def _margin_mm(target: TargetGeometry) -> float:
    """Least distance from a ring's outer edge to its face's window."""
    corner = target.window_mm[target.ring_face]  # (R, K, 2)
    edge = np.roll(corner, -1, axis=1) - corner
    to_center = target.center_in_face_mm[:, None, :2] - corner
    cross = edge[..., 0] * to_center[..., 1] - edge[..., 1] * to_center[..., 0]
    inside = cross / np.linalg.norm(edge, axis=2)
    return float((inside - target.radius_outer_mm[:, None]).min())
