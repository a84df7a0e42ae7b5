"""A quick look at a frame of a video: the same names as the exact pass gives, and centres to about .2 px.

Every frame is looked at afresh, so that no name can slip from one to the next. Time is saved where a name does not hang
on it: candidates by one threshold, more only if that fails; one lens; and no edge is measured. A border search knows a
ring to some tenths of a pixel. A face's homography passes through all its rings, and is what their centres are told by.
"""

import math
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from calib.core.types import Detections, FaceRecord
from calib.detector.boards import LEAST_SIDE_PX, as_bytes, find_boards
from calib.detector.borders import reduced, thresholds
from calib.detector.candidates import Candidates, find_candidates, merged
from calib.detector.lens import Lens
from calib.detector.measure import Measured
from calib.detector.pipeline import (
    MIRRORED,
    REGIONS_APART,
    NamedRings,
    as_kernels_want,
    ellipses_px,
    face_records,
    name_grids,
    naming_of,
    nothing_found,
)
from calib.detector.place import Naming, Placement, Places, complete, predict, without_strangers
from calib.detector.plan import TargetPlan, plan_for
from calib.detector.ring_marks import usual_contrast
from calib.detector.verify import gather, refusal
from calib.detector.where_expected import face_map, imaged_circles
from calib.detector.wide_guess import guess_lens
from designer.base.arrays import Array, Rows
from designer.target import TargetGeometry

Grey: TypeAlias = NDArray[np.generic]
Size: TypeAlias = tuple[int, int]

GLANCE_PIXELS = 2_100_000
"""Larger frames are reduced to about this size, 1920 x 1080, and looked at in full only if nothing is found so."""
BOARD_PIXELS = 520_000
"""Of other makers' boards the same, which are found whole or not at all; a larger frame costs time in each without."""
BOARD_SIGMA = 0.2
"""Of a point found there, px of the reduced frame."""
LEAST_POINTS = 4
NOT_SEEN, NO_BOARD = "not found", "no board of this target was found"
ENOUGH = 0.5
"""With this share of the rings that should be in view no other threshold is tried."""
FITS_PX = 0.3
"""A lens that leaves no more is good enough for centres that are as rough; to fit another takes .1 s."""
LEAST_SIGMA_PX = 0.04
"""What light and lens move a whole face by, which its rings do not tell."""
SLACK = 2.0
"""Of variances: borders of neighbours err alike, and places at a face's rim are known less well than its middle."""
TOO_FEW = "too few rings could be named"
TOLERATED_PITCHES = 0.08
"""Farther from where its face puts it no ring is believed ..."""
FACE_PITCHES = 0.03
"""... and no face whose rings lie so far off (root mean square): a stranger among few bends their homography."""


@dataclass(frozen=True, eq=False)
class Glimpse:
    """What one set of candidates gives."""

    found: Detections
    share: float  # of the plain features in view that were named


def look_quickly(
    pixels: Grey, target: TargetGeometry, name: str = "", camera_lens: Lens | None = None, likely: Lens | None = None
) -> Detections:
    """Names and rough centres in a frame, whatever the target's marks: as `glance` of rings."""
    if target.marks is None:
        return glance(pixels, plan_for(target), name, camera_lens, likely)
    factor = 2 ** max(0, math.ceil(math.log(pixels.size / BOARD_PIXELS, 4)))
    grey = reduced(pixels, factor) if factor > 1 else as_bytes(pixels)
    faces = find_boards(grey, target).faces if min(grey.shape) >= LEAST_SIDE_PX else ()
    sigma_px, rings, centers, ellipses, records = BOARD_SIGMA * factor, [], [], [], []
    for one in sorted((one for one in faces if len(one.row) >= LEAST_POINTS), key=lambda one: one.face):
        own = np.flatnonzero(target.ring_face == one.face)
        ring, center = own[one.row], factor * (one.near_px + 0.5) - 0.5
        at_mm = target.center_in_face_mm[ring, :2]
        _, affine = face_map(at_mm, center).at(at_mm)
        rings.append(ring)
        centers.append(center)
        ellipses.append(imaged_circles(center, affine, target.reach_mm[ring]))
        left = len(own) - len(ring)
        records.append(FaceRecord(one.face, (), 0, len(ring), len(own), ((NOT_SEEN, left),) if left else ()))
    ring = np.concatenate([np.zeros(0, dtype=np.int64), *rings])
    remarks = tuple(dict.fromkeys(remark for one in faces for remark in one.remarks))
    return Detections(
        image=name, image_size=(pixels.shape[1], pixels.shape[0]), layout_id=target.layout_id,
        geometry_id=target.geometry_id, ring=ring, position_mm=target.center_mm[ring],
        center_px=np.concatenate([np.zeros((0, 2)), *centers]),
        cov_px2=np.tile(sigma_px**2 * np.eye(2), (len(ring), 1, 1)),
        ellipse_px=np.concatenate([np.zeros((0, 5)), *ellipses]), faces=tuple(records),
        remarks=remarks if len(ring) else (*remarks, NO_BOARD),
    )  # fmt: skip


def glance(
    pixels: Grey, plan: TargetPlan, name: str = "", camera_lens: Lens | None = None, likely: Lens | None = None
) -> Detections:
    """Names and rough centres in a frame: `glance(pixels, plan_for(target))`.

    Args:
        pixels: grey levels, uint8, uint16 or float32.  # (H, W)
        plan: of the target that is looked for.
        name: what the frame is called in the result.
        camera_lens: of the camera, if it is known; else a lens is guessed from each frame's grids.
        likely: a lens that is tried before a wide one is guessed, which takes .1 s.

    Returns:
        As the exact pass gives it, with covariances that say how rough the centres are; blur is not measured.
    """
    pixels = as_kernels_want(pixels)
    size = (pixels.shape[1], pixels.shape[0])
    if min(size) < LEAST_SIDE_PX:
        return nothing_found(plan, name, size, None, ("the image is too small to hold a ring",))
    factor = 2 ** max(0, math.ceil(math.log(pixels.size / GLANCE_PIXELS, 4)))
    found = _glance_at(pixels, plan, name, camera_lens, likely, factor)
    while factor > 1 and not len(found.ring) and MIRRORED not in found.remarks:
        factor //= 2
        found = _glance_at(pixels, plan, name, camera_lens, likely, factor)
    return found


def _glance_at(
    pixels: Grey, plan: TargetPlan, name: str, camera_lens: Lens | None, likely: Lens | None, factor: int
) -> Detections:
    """By one threshold after the other, until about half of what should be in view is found."""
    grey = reduced(pixels, factor)
    candidates: Candidates | None = None
    best: Glimpse | None = None
    for number, threshold in enumerate(thresholds(grey)):
        more = find_candidates(grey, threshold, factor, number * REGIONS_APART, plan.ratio)
        candidates = more if candidates is None else merged(candidates, more)
        glimpse = _glimpse(pixels, plan, name, candidates, camera_lens, likely)
        if best is None or len(glimpse.found.ring) > len(best.found.ring):
            best = glimpse
        if best.share >= ENOUGH or MIRRORED in glimpse.found.remarks:
            break
    assert best is not None  # noqa: S101 - there is at least one threshold
    return best.found


def _glimpse(
    pixels: Grey, plan: TargetPlan, name: str, candidates: Candidates, camera_lens: Lens | None, likely: Lens | None
) -> Glimpse:
    """Names of candidates, held against the target as the exact pass does it."""
    size = (pixels.shape[1], pixels.shape[0])

    def none(*remarks: str) -> Glimpse:
        return Glimpse(nothing_found(plan, name, size, candidates, remarks), 0.0)

    named = name_grids(pixels, plan, candidates)
    if not named.named:
        return none(*named.remarks)
    first = naming_of(plan, named.named)
    lens = camera_lens or guess_lens(
        plan.by_face(first.ring, candidates.ellipse[first.candidate, :2]), size, likely, FITS_PX
    )
    naming, strangers = without_strangers(plan, candidates, first, size, lens)
    if strangers and len(np.unique(plan.target.ring_face[naming.ring])) < 2:
        return none(*named.remarks, "the faces contradict each other")
    dropped = len(first.ring) - len(naming.ring)
    if len(naming.ring) < 4:
        return none(*named.remarks, TOO_FEW)
    naming, placement = complete(plan, candidates, naming, size, lens)
    if placement.is_mirrored:
        return none(*named.remarks, MIRRORED)
    places = predict(plan, placement, size)
    seen = _seen(plan, candidates, naming, places, np.array([item.face for item in named.named]))
    if len(seen.ring) < 4:
        return none(*named.remarks, TOO_FEW)
    contrast = usual_contrast(pixels, candidates)
    evidence = gather(pixels, contrast, plan, candidates, named.grids, naming, dropped, placement, seen)
    if why := refusal(evidence):
        return none(*named.remarks, f"not taken for the target: {why}")
    return Glimpse(
        _detections(plan, name, size, named, naming, placement, seen), evidence.found / max(evidence.expected, 1)
    )


def _seen(plan: TargetPlan, candidates: Candidates, naming: Naming, places: Places, read: Rows) -> Measured:
    """Candidates that are what their names say, at the centres that their faces give them, on faces that were read.

    The few that other faces name on a face that hardly shows are not believed without a measured edge.
    """
    row_of = np.full(plan.target.ring_count, -1)
    row_of[places.ring] = np.arange(len(places.ring))
    in_view = (row_of[naming.ring] >= 0) & np.isin(plan.target.ring_face[naming.ring], read)
    naming = Naming(naming.candidate[in_view], naming.ring[in_view])
    at, ratio = row_of[naming.ring], candidates.ratio[naming.candidate]
    off_px = np.linalg.norm(candidates.ellipse[naming.candidate, :2] - places.center_px[at], axis=1)
    pitches = off_px * np.sqrt(places.shape[at, 0] * places.shape[at, 2]) / plan.pitch_radii
    face = plan.target.ring_face[naming.ring]
    square = np.bincount(face, pitches**2) / np.maximum(np.bincount(face), 1)
    is_like = (ratio == 0) == plan.target.is_dot[naming.ring]
    is_like &= (pitches < TOLERATED_PITCHES) & (square[face] < FACE_PITCHES**2)
    ring, off_px = naming.ring[is_like], off_px[is_like]
    sigma_px = _sigma_px(plan.target.ring_face[ring], off_px)
    return Measured(
        ring=ring,
        center_px=places.center_px[at[is_like]],
        cov_px2=sigma_px[:, None, None] ** 2 * np.eye(2),
        shape=candidates.ellipse[naming.candidate[is_like], 2:],
        ratio=ratio[is_like],
        blur_px=np.full(len(ring), np.nan),
        missing=(),
    )


def _sigma_px(face: Rows, off_px: Array) -> Array:
    """What centres of a face are off by, per axis: N borders fix eight numbers of its homography.  # (N,)"""
    count = np.maximum(np.bincount(face), 1)
    variance = np.bincount(face, off_px**2) / (2 * count)
    left = SLACK * np.minimum(4 / count, 1) * variance
    return np.asarray(np.hypot(np.sqrt(left), LEAST_SIGMA_PX)[face])


def _detections(
    plan: TargetPlan, name: str, size: Size, named: NamedRings, naming: Naming, placement: Placement, seen: Measured
) -> Detections:
    """In the order of the target's rows."""
    order = np.argsort(seen.ring, kind="stable")
    used = naming.candidate[np.isin(naming.ring, seen.ring)]
    rejected = np.setdiff1d(np.flatnonzero(named.candidates.ratio > 0), used)
    ring = seen.ring[order]
    return Detections(
        image=name,
        image_size=size,
        layout_id=plan.target.layout_id,
        geometry_id=plan.target.geometry_id,
        ring=ring,
        position_mm=plan.target.center_mm[ring],
        center_px=seen.center_px[order],
        cov_px2=seen.cov_px2[order],
        ellipse_px=ellipses_px(seen.center_px[order], seen.shape[order]),
        faces=face_records(plan, named, placement, seen),
        remarks=named.remarks,
        rejected_px=named.candidates.ellipse[rejected, :2],
        ratio=seen.ratio[order],
        blur_px=seen.blur_px[order],
    )
