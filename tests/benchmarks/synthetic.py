"""What the benchmarks share: exact pictures of circles in a plane, drawn without the renderer, and small tables.

A plane's picture is white minus the blurred coverage of its ink: blur is linear, so circles that do not overlap
are drawn one by one in their own patches. Along a row, the coverage of a pixel by an ellipse is exact; across,
it is the mean over fine rows.
"""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from calib.core.types import Detections
from calib.renderer import View
from designer.base.arrays import Array, Flags
from designer.base.codes import code_positions
from designer.kinds.board import BoardSpec
from designer.kinds.ico import IcoSpec
from designer.kinds.layout import lay_out
from designer.spec.spec import Spec
from designer.target import MAX_INDEX, TargetGeometry

LIGHT, DARK = 0.9, 0.1
"""Intensity of paper and ink, of full scale."""
SPECS: dict[str, Spec] = {
    "ico 100 mm": IcoSpec(100.0, 8, 7.0, 0.45, 10.0, 2.0, 1.5),
    "ico 133 mm": IcoSpec(133.0, 8, 10.5, 0.45, 13.2, 2.66, 1.5),
    "ico 60 mm, m = 6": IcoSpec(60.0, 6, 5.6, 0.45, 8.0, 1.2, 1.0),
    "board, square": BoardSpec((220.0, 220.0), 5.0, 21, 21, "square", 7.0, 0.45, 10.0, 0.0, 5.0, dots=True),
    "board, triangular": BoardSpec((220.0, 220.0), 5.0, 20, 22, "triangular", 7.0, 0.45, 10.0, 3.0, 2.0, dots=True),
}
RECALL_RAD, RECALL_MINOR_PX = math.radians(65), 5.0
"""Rings seen less steeply and larger than this must be found if nothing hides them."""


@cache
def target_of(name: str) -> TargetGeometry:
    """The target of a name in `SPECS`."""
    return lay_out(SPECS[name])


@dataclass(frozen=True)
class Box:
    """Whole pixels from (left, top) on."""

    left: int
    top: int
    width: int
    height: int

    def clipped(self, width: int, height: int) -> "Box":
        """The part inside an image."""
        left, top = max(self.left, 0), max(self.top, 0)
        right, bottom = min(self.left + self.width, width), min(self.top + self.height, height)
        return Box(left, top, max(right - left, 0), max(bottom - top, 0))


def best_of(times: int, work: Callable[[], object]) -> float:
    """The shortest of several durations, in seconds: the one least disturbed by other processes."""
    durations = []
    for _ in range(times):
        start = time.perf_counter()
        work()
        durations.append(time.perf_counter() - start)
    return min(durations)


def row(what: str, goal: str, measured: str, against: str = "") -> None:
    """One line of a table, at once on the screen."""
    print(f"  {what:<58} {goal:>12} {measured:>16}   {against}".rstrip(), flush=True)


def conic_of_circle(pixel_from_plane: Array, center: Array, radius: float) -> Array:
    """The image of a circle: C = H^-T diag-like circle H^-1, negative inside, as a 3 x 3 matrix."""
    x, y = center
    circle = np.array([[1.0, 0.0, -x], [0.0, 1.0, -y], [-x, -y, x * x + y * y - radius * radius]])
    back = np.linalg.inv(pixel_from_plane)
    conic: Array = back.T @ circle @ back
    return conic * np.sign(conic[0, 0])


def ellipse_box(conic: Array, margin: float) -> Box:
    """Pixels that an ellipse reaches, widened by a margin."""
    dual = np.linalg.inv(conic)
    center = dual[:2, 2] / dual[2, 2]
    half = np.sqrt(np.maximum(center**2 - np.diag(dual)[:2] / dual[2, 2], 0.0))
    low, high = np.floor(center - half - margin).astype(int), np.ceil(center + half + margin).astype(int)
    return Box(int(low[0]), int(low[1]), int(high[0] - low[0] + 1), int(high[1] - low[1] + 1))


def ellipse_coverage(conic: Array, box: Box, columns_per_px: int, rows_per_px: int) -> Array:
    """Share of each cell of a box that lies in an ellipse.

    Cells are 1 / columns_per_px wide (exact along x) and 1 / rows_per_px high (at their middle).
    # (height * rows_per_px, width * columns_per_px)
    """
    y = box.top - 0.5 + (np.arange(box.height * rows_per_px) + 0.5) / rows_per_px
    a = conic[0, 0]
    b = conic[0, 1] * y + conic[0, 2]
    c = conic[1, 1] * y * y + 2 * conic[1, 2] * y + conic[2, 2]
    root = np.sqrt(np.maximum(b * b - a * c, 0.0))
    first, last = (-b - root) / a, (-b + root) / a
    left = box.left - 0.5 + np.arange(box.width * columns_per_px) / columns_per_px
    inside = np.minimum(last[:, None], left + 1 / columns_per_px) - np.maximum(first[:, None], left)
    return np.clip(inside, 0.0, None) * columns_per_px


def ring_shade(
    pixel_from_plane: Array,
    center: Array,
    outer: float,
    inner: float,
    box: Box,
    blur_px: float,
    fine: int = 4,
    slope: Array | None = None,
) -> Array:
    """Blurred ink coverage of one ring (inner 0: a dot) in a box, pixel area included.  # (height, width)

    With a `slope` (per px, u v) the ink is weighed, before it is blurred, with light that is 1 in the box's middle.
    The blur is done on `fine` x `fine` cells a pixel, because a Gaussian of less than a pixel cannot be sampled.
    """
    import cv2

    rows = 8 * fine
    shade = ellipse_coverage(conic_of_circle(pixel_from_plane, center, outer), box, fine, rows)
    if inner > 0:
        shade = shade - ellipse_coverage(conic_of_circle(pixel_from_plane, center, inner), box, fine, rows)
    cells = shade.reshape(box.height * fine, 8, box.width * fine).mean(axis=1)
    if slope is not None:
        u, v = ((np.arange(n * fine) + 0.5) / fine - n / 2 for n in (box.width, box.height))
        cells *= 1 + slope[0] * u + slope[1] * v[:, None]
    if blur_px > 0:
        half = int(np.ceil(6 * blur_px * fine))
        cells = cv2.GaussianBlur(cells, (2 * half + 1, 2 * half + 1), blur_px * fine, borderType=cv2.BORDER_REPLICATE)
    return cells.reshape(box.height, fine, box.width, fine).mean(axis=(1, 3))


def picture_of_plane(
    size: tuple[int, int],
    pixel_from_plane: Array,
    center: Array,  # (N, 2)
    outer: Array,  # (N,)
    inner: Array,  # (N,)
    blur_px: float,
    *,
    fine: int = 4,
) -> NDArray[np.float32]:
    """Dark circles on an endless light plane, noise-free, between DARK and LIGHT.  # (H, W)"""
    width, height = size
    image = np.full((height, width), LIGHT, dtype=np.float32)
    for middle, large, small in zip(center, outer, inner, strict=True):
        conic = conic_of_circle(pixel_from_plane, middle, float(large))
        box = ellipse_box(conic, 1 + 5 * blur_px).clipped(width, height)
        if box.width and box.height:
            shade = ring_shade(pixel_from_plane, middle, float(large), float(small), box, blur_px, fine)
            part = image[box.top : box.top + box.height, box.left : box.left + box.width]
            part -= ((LIGHT - DARK) * shade).astype(np.float32)
    return image


def eight_bit(
    image: NDArray[np.floating], noise_levels: float, rng: np.random.Generator, *, strip: int = 512
) -> NDArray[np.uint8]:
    """Full scale is 255; Gaussian noise in grey levels. In strips, so that a large image needs little memory."""
    levels = np.empty(image.shape, dtype=np.uint8)
    for top in range(0, len(image), strip):
        part = np.asarray(image[top : top + strip], dtype=np.float32) * np.float32(255)
        if noise_levels > 0:
            part += np.float32(noise_levels) * rng.standard_normal(part.shape, dtype=np.float32)
        levels[top : top + strip] = np.clip(np.rint(part), 0, 255).astype(np.uint8)
    return levels


def plane_view(focal_px: float, tilt_rad: float, axis_rad: float, distance: float, middle_px: Array) -> Array:
    """`pixel_from_plane` of a plane turned by `tilt_rad` about an axis in it, its origin seen at `middle_px`."""
    axis = np.array([np.cos(axis_rad), np.sin(axis_rad), 0.0])
    cross = np.array([[0.0, 0.0, axis[1]], [0.0, 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
    rotation = np.eye(3) + np.sin(tilt_rad) * cross + (1 - np.cos(tilt_rad)) * cross @ cross
    camera = np.array([[focal_px, 0.0, middle_px[0]], [0.0, focal_px, middle_px[1]], [0.0, 0.0, 1.0]])
    view: Array = camera @ np.column_stack([rotation[:, :2], [0.0, 0.0, distance]])
    return view / view[2, 2]


def apply_homography(homography: Array, point: Array) -> Array:
    """Images of points in the plane.  # (N, 2)"""
    image = np.column_stack([point, np.ones(len(point))]) @ homography.T
    return image[:, :2] / image[:, 2:]


def rms(residual: Array) -> float:
    """Root mean square over everything given; nan of nothing."""
    return float(np.sqrt(np.mean(np.square(residual)))) if np.size(residual) else float("nan")


def look_at(rng: np.random.Generator, direction: Array, distance_mm: float, aim_mm: Array) -> Array:
    """`cam_from_target` of a camera in a direction from the target's origin, rolled at random."""
    place = distance_mm * direction
    forward = (aim_mm - place) / np.linalg.norm(aim_mm - place)
    across = np.cross(forward, rng.standard_normal(3))
    across /= np.linalg.norm(across)
    pose = np.eye(4)
    pose[:3, :3] = across, np.cross(forward, across), forward
    pose[:3, 3] = -pose[:3, :3] @ place
    return pose


def random_direction(rng: np.random.Generator, is_board: bool) -> Array:
    """On the whole sphere; for a board up to 85 degrees off its normal."""
    z = rng.uniform(math.cos(math.radians(85)), 1) if is_board else rng.uniform(-1, 1)
    turn, radius = rng.uniform(0, 2 * np.pi), math.sqrt(1 - z * z)
    return np.array([radius * math.cos(turn), radius * math.sin(turn), z])


def wrong_names(found: Detections, target: TargetGeometry, truth_px: Array, visible: Flags) -> Flags:
    """Which of the N found features are not the ring they are called.

    Farther from its true place than 0.3 of the distance to the nearest neighbour in the picture and 2 px, or not to be
    seen at all.
    """
    error = np.linalg.norm(found.center_px - truth_px[found.ring], axis=1)
    gap = np.full(len(error), np.inf)
    for n, ring in enumerate(found.ring):
        same = np.flatnonzero(target.ring_face == target.ring_face[ring])
        same = same[same != ring]
        gap[n] = np.nanmin(np.linalg.norm(truth_px[same] - truth_px[ring], axis=1))
    is_wrong: Flags = ~(error <= np.maximum(0.3 * gap, 2.0)) | ~visible[found.ring]
    return is_wrong


def due_rings(view: View) -> Flags:
    """Rings that must be found."""
    return np.asarray(view.clean & (view.incidence_rad <= RECALL_RAD) & (view.minor_radius_px >= RECALL_MINOR_PX))


def readable_faces(view: View, target: TargetGeometry) -> int:
    """How many faces have all marks of their code well in view; of a board, its dots."""
    if target.is_planar:
        return int(due_rings(view)[target.is_dot].all())
    positions = code_positions(int(target.face_code[0]))
    mark = np.isin(target.ring_index @ [MAX_INDEX, 1], [MAX_INDEX * i + j for i, j in positions])
    seen = np.bincount(target.ring_face[mark], due_rings(view)[mark], minlength=target.face_count)
    return int((seen == len(positions)).sum())


def crashed(view: View, target: TargetGeometry, why: str) -> Detections:
    """Nothing found, with the error as the reason, so that the run goes on and the seed can be replayed."""
    height, width = view.image.shape
    ids, empty = (target.layout_id, target.geometry_id), np.zeros((0, 2))
    cov, ellipse = np.zeros((0, 2, 2)), np.zeros((0, 5))
    return Detections(
        "crash", (width, height), *ids, np.zeros(0, int), np.zeros((0, 3)), empty, cov, ellipse, (), (f"crash {why}",)
    )
