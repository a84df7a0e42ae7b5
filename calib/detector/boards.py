"""Other makers' boards in a photo: found and named by kind (`calib.detector.marks`), then measured here."""

from collections import Counter
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.cameras.camera import Camera
from calib.core.types import Detections, FaceRecord
from calib.detector.marks import FINDERS, FoundFace
from designer.base.arrays import Array
from designer.target import TargetGeometry

LEAST_SIDE_PX = 16
PLAIN_SIGMA_PX = 0.1
NOT_FOUND = "not found"


@dataclass(frozen=True, eq=False)
class FoundBoards:
    """What the finders named in a photo: the half of the search that is the same for any lens."""

    faces: tuple[FoundFace, ...]


def find_boards(pixels: NDArray[np.generic], target: TargetGeometry) -> FoundBoards:
    """The faces' points, about where they are."""
    assert target.marks is not None  # noqa: S101 - who calls has looked
    grey = as_bytes(pixels)
    found = []
    for kind in dict.fromkeys(marks.kind for marks in target.marks):
        face = [row for row, marks in enumerate(target.marks) if marks.kind == kind]
        faces = FINDERS[kind](grey, [target.marks[row] for row in face])
        found += [replace(one, face=face[one.face]) for one in faces]
    return FoundBoards(tuple(found))


def detect_boards(
    pixels: NDArray[np.generic],
    target: TargetGeometry,
    *,
    name: str,
    camera: Camera | None = None,
    found: FoundBoards | None = None,
) -> Detections:
    """Find, name and measure the points of a target of other makers' marks; as `calib.detector.pipeline.detect`."""
    if found is None:
        found = find_boards(pixels, target) if min(pixels.shape) >= LEAST_SIDE_PX else FoundBoards(())
    grey = as_bytes(pixels)
    first = np.searchsorted(target.ring_face, np.arange(target.face_count))
    ring = np.concatenate([np.zeros(0, dtype=np.int64), *(first[one.face] + one.row for one in found.faces)])
    near_px = np.concatenate([np.zeros((0, 2)), *(one.near_px for one in found.faces)])
    order = np.argsort(ring, kind="stable")
    ring, near_px = ring[order], near_px[order]
    step_px = _steps_px(near_px)
    center_px = _measured(grey, near_px, step_px)
    remarks = tuple(dict.fromkeys(remark for one in found.faces for remark in one.remarks))
    return Detections(
        image=name,
        image_size=(pixels.shape[1], pixels.shape[0]),
        layout_id=target.layout_id,
        geometry_id=target.geometry_id,
        ring=ring,
        position_mm=target.center_mm[ring],
        center_px=center_px,
        cov_px2=np.tile(PLAIN_SIGMA_PX**2 * np.eye(2), (len(ring), 1, 1)),
        ellipse_px=np.column_stack([center_px, 0.25 * step_px, 0.25 * step_px, np.zeros(len(ring))]),
        faces=_records(target, ring),
        remarks=remarks if len(ring) else (*remarks, "no board of this target was found"),
    )


def _records(target: TargetGeometry, ring: NDArray[np.int64]) -> tuple[FaceRecord, ...]:
    """A record for each face that was found."""
    seen = Counter(target.ring_face[ring].tolist())
    records = []
    for face, count in sorted(seen.items()):
        expected = int(np.count_nonzero(target.ring_face == face))
        missing = ((NOT_FOUND, expected - count),) if count < expected else ()
        records.append(FaceRecord(face, (), 0, count, expected, missing))
    return tuple(records)


def as_bytes(pixels: NDArray[np.generic]) -> NDArray[np.uint8]:
    """The photo as finders take it: other levels are stretched over what occurs.  # (H, W)"""
    if pixels.dtype == np.uint8:
        return np.ascontiguousarray(pixels.view(np.uint8))
    low, high = float(pixels.min()), float(pixels.max())
    return np.asarray((pixels.astype(np.float64) - low) * (255.0 / max(high - low, 1e-9)), dtype=np.uint8)


def _steps_px(at: Array) -> Array:
    """How far from each point its nearest neighbour is.  # (N, 2) -> (N,)"""
    if len(at) < 2:
        return np.full(len(at), 8.0)
    apart = np.linalg.norm(at[:, None] - at, axis=2)
    np.fill_diagonal(apart, np.inf)
    return np.asarray(apart.min(axis=1))


def _measured(grey: NDArray[np.uint8], near_px: Array, step_px: Array) -> Array:
    """Centres by OpenCV's corner refinement."""
    if not len(near_px):
        return near_px
    half = max(2, int(0.3 * np.median(step_px)))
    end = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 40, 1e-3)
    at = cv2.cornerSubPix(grey, np.ascontiguousarray(near_px[:, None], dtype=np.float32), (half, half), (-1, -1), end)
    return np.asarray(at[:, 0], dtype=np.float64)
