"""From a photo's pixels to named centres: the steps of the detector in order."""

import math
from collections import Counter
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.cameras.camera import Camera
from calib.core.types import Detections, FaceRecord, Mark
from calib.detector.boards import LEAST_SIDE_PX, FoundBoards, detect_boards, find_boards
from calib.detector.borders import reduced, reduction, thresholds
from calib.detector.candidates import Candidates, find_candidates, merged, semi_axes_px
from calib.detector.frame_quality import frame_quality
from calib.detector.grid import Grid, grow_grids
from calib.detector.lens import CameraLens, Lens, misfit_px
from calib.detector.measure import ODD_EDGES, Measured, measure
from calib.detector.naming import BoardName, NamedGrid, StrangeCode, name_board, name_faces
from calib.detector.place import Naming, Placement, complete, predict, without_strangers
from calib.detector.plan import TargetPlan, plan_for
from calib.detector.ring_marks import DOT, RING, usual_contrast
from calib.detector.verify import gather, proportion_remark, refusal
from calib.detector.wide_guess import guess_lens
from designer.base.arrays import Array
from designer.target import TargetGeometry

_WORDS: dict[int, Mark] = {DOT: "dot", RING: "ring"}

REGIONS_APART = 1 << 40
EASY_RADIUS_PX = 4.0
"""Features with a smaller semi-axis below this may stay unseen without another threshold being tried."""
LITTLE_PX = 0.1
"""That grids may be off with a camera, whatever a guessed lens leaves."""
BYTES_IN_WORDS = (257, 256)
MIRRORED = "mirrored: the image shows the target in a mirror, or was flipped; flip it back and detect again"
INVERTED = "inverted: the image shows the target white on black; its grey levels were exchanged for the search"
MOTION_BLUR_PX, MOTION_RINGS = 0.85, 20
"""Edges of less blur, in the median, were not blurred by a motion worth a word; so many rings tell its direction."""
LEAST_MOTION_PX, MOTION_OF_BLUR = 2.5, 1.9
"""A motion that explains the blur: its variance makes that along it at least so many times that across. Wide blurs of
slanted rings come to 1.6 without one (rendered)."""
INK_WIDTH = 0.6
"""Of the outer radius."""
FEWEST_DISCS = 6
"""Dark discs, as an inverted image has in its rings, without which it is none."""


def face_records(
    plan: TargetPlan, found: "NamedRings", placement: Placement, measured: Measured
) -> tuple[FaceRecord, ...]:
    """A record for each face that shows, in the order of the faces."""
    read = {item.face: item for item in found.named}
    carried = {one.face: one.carries for one in found.strange}
    face_of = plan.target.ring_face
    rings = Counter(face_of[measured.ring].tolist())
    records = []
    for face in placement.seen().tolist():
        missing = Counter(reason for row, reason in measured.missing if face_of[row] == face)
        item = read.get(face)
        records.append(
            FaceRecord(
                face=face,
                code_read=() if item is None else tuple(_WORDS.get(mark, "unreadable") for mark in item.marks),
                margin=0 if item is None else item.margin,
                rings_found=rings.get(face, 0),
                rings_expected=int(np.count_nonzero(face_of == face)),
                missing=tuple(sorted(missing.items())),
                remark=_remark(item, rings.get(face, 0)),
                carries=carried.get(face),
            )
        )
    return tuple(records)


def _remark(item: NamedGrid | None, found: int) -> str:
    """How a face came to its name, where it was not by its own code."""
    if item is not None:
        return ""
    return "named by the other faces" if found else "turned to the camera, but nothing on it could be measured"


@dataclass(frozen=True, eq=False)
class NamedRings:
    """What naming made of an image, which no lens has a part in."""

    candidates: Candidates
    grids: tuple[Grid, ...]  # all, with and without names
    named: tuple[NamedGrid, ...]
    remarks: tuple[str, ...]
    is_mirrored: bool = False
    strange: tuple[StrangeCode, ...] = ()
    is_inverted: bool = False  # found in the inverted image
    placed: tuple[Naming, Placement] | None = None  # completed by a lens guessed from the grids; None: not asked for

    @property
    def size(self) -> int:
        """How many candidates have names."""
        return sum(len(item.grid.row) for item in self.named)


def find(pixels: NDArray[np.generic], target: TargetGeometry) -> NamedRings | FoundBoards | None:
    """The half of the search that is the same for any lens, for a photo that is searched more than once.

    What `detect` may be given; None if the image is too small to hold anything.
    """
    if min(pixels.shape) < LEAST_SIDE_PX:
        return None
    pixels = as_kernels_want(pixels)
    return _search(pixels, plan_for(target)) if target.marks is None else find_boards(pixels, target)


def detect(
    pixels: NDArray[np.generic],
    target: TargetGeometry,
    *,
    name: str,
    camera: Camera | None = None,
    found: NamedRings | FoundBoards | None = None,
) -> Detections:
    """Find and name the target's features in one photo.

    Args:
        pixels: grey levels, uint8, uint16 or float32.  # (H, W)
        target: what was printed.
        name: what the image is called in the result.
        camera: if it is known, its lens straightens the image; else a radial lens is estimated from the grids.
        found: what `find` has found in these pixels; None: it is looked for.

    Returns:
        The features with centres and covariances, and a record of what was read; without features if none could
        be named, with the reason in `remarks`.

    Raises:
        ValueError: the image is no two-dimensional array, the camera belongs to images of another size, or the
            target's faces have different lattices.
    """
    if pixels.ndim != 2:
        raise ValueError(f"the image has the shape {pixels.shape}; it must be height x width, grey")
    pixels = as_kernels_want(pixels)
    image_size = (pixels.shape[1], pixels.shape[0])
    if camera is not None and camera.image_size != image_size:
        raise ValueError(
            f"the camera is for images of {camera.image_size[0]} x {camera.image_size[1]} px, this one has "
            f"{image_size[0]} x {image_size[1]}; use the camera's own images"
        )
    if target.marks is not None:
        boards = found if isinstance(found, FoundBoards) else None
        return detect_boards(pixels, target, name=name, camera=camera, found=boards)
    rings = found if isinstance(found, NamedRings) else None
    return _detect_rings(pixels, plan_for(target), name, CameraLens(camera) if camera is not None else None, rings)


def _detect_rings(
    pixels: NDArray[np.generic], plan: TargetPlan, name: str, camera_lens: CameraLens | None, found: NamedRings | None
) -> Detections:
    """`detect` of rings, in an image that kernels take."""
    image_size, target = (pixels.shape[1], pixels.shape[0]), plan.target
    if min(pixels.shape) < LEAST_SIDE_PX:
        return nothing_found(plan, name, image_size, None, ("the image is too small to hold a ring",))
    found = _search(pixels, plan) if found is None else found
    pixels = inverted(pixels) if found.is_inverted else pixels
    if not found.named:
        return nothing_found(plan, name, image_size, found.candidates, found.remarks)
    first = naming_of(plan, found.named)
    naming, strangers = without_strangers(plan, found.candidates, first, image_size, camera_lens)
    dropped, remarks = len(first.ring) - len(naming.ring), list(found.remarks)
    if strangers and len(np.unique(target.ring_face[naming.ring])) < 2:
        return nothing_found(plan, name, image_size, found.candidates, (*remarks, "the faces contradict each other"))
    if strangers:
        remarks.append(f"{len(strangers)} faces contradicted the others and were left out")
    if len(naming.ring) < 4:
        return nothing_found(plan, name, image_size, found.candidates, (*remarks, "too few rings could be named"))
    placed = found.placed if camera_lens is None and not strangers else None
    naming, placement = placed or complete(plan, found.candidates, naming, image_size, camera_lens)
    if placement.is_mirrored:
        return nothing_found(plan, name, image_size, found.candidates, (*remarks, MIRRORED))
    contrast = usual_contrast(pixels, found.candidates)
    measured = measure(pixels, plan, found.candidates, naming, placement, contrast, camera_lens)
    if not len(measured.ring):
        why = "of the rings that would be named none could be measured as a ring of this target"
        return nothing_found(plan, name, image_size, found.candidates, (*remarks, why))
    evidence = gather(pixels, contrast, plan, found.candidates, found.grids, naming, dropped, placement, measured)
    if camera_lens is not None:
        remarks += _camera_remarks(plan, measured, camera_lens, image_size)
    if why := refusal(evidence):
        return nothing_found(plan, name, image_size, found.candidates, (*remarks, f"not taken for the target: {why}"))
    if odd := proportion_remark(evidence):
        remarks.append(odd)
    result = _result(plan, name, image_size, found, naming, placement, measured, tuple(remarks))
    motion_px, motion = _motion(pixels, result, target)
    # Where a motion made the edges odd, no print did.
    said = (motion, *(one for one in measured.remarks if one != ODD_EDGES)) if motion else measured.remarks
    return replace(result, remarks=(*remarks, *said), motion_px=motion_px)


def _motion(pixels: NDArray[np.generic], found: Detections, target: TargetGeometry) -> tuple[float, str]:
    """How far in px a motion smeared a photo's edges, and what to say of it; 0: none, or other blur was more."""
    if not len(found.ring) or np.median(np.asarray(found.blur_px)) < MOTION_BLUR_PX:
        return 0.0, ""
    rows = np.unique(np.linspace(0, len(found.ring) - 1, MOTION_RINGS).round().astype(np.int64))
    quality = frame_quality(pixels, found.keep(rows), target)
    if quality is None or not quality.motion_px >= LEAST_MOTION_PX:
        return 0.0, ""
    length_px, across = quality.motion_px, quality.blur_px**2
    if across + length_px**2 / 12 < MOTION_OF_BLUR * across:
        return 0.0, ""
    # Beyond the ink's width more cannot be told.
    words = f"{length_px:.0f} px or more" if length_px > INK_WIDTH * quality.radius_px else f"about {length_px:.0f} px"
    return length_px, (
        f"motion blur: edges are smeared by {words} along {math.degrees(quality.motion_rad):.0f} deg (0: left and "
        "right, 90: up and down); hold still, or expose for a shorter time"
    )


def _camera_remarks(plan: TargetPlan, measured: Measured, lens: Lens, image_size: tuple[int, int]) -> list[str]:
    """A warning if the grids are straighter without the camera that was given than with it."""
    groups = plan.by_face(measured.ring, measured.center_px)
    given = misfit_px(lens, groups)
    if given <= LITTLE_PX:  # whatever a guess leaves, which takes a while
        return []
    guessed = misfit_px(guess_lens(groups, image_size), groups)
    if given <= 2 * guessed + LITTLE_PX:
        return []
    return [
        f"the camera does not fit this photo: grids are off by {given:.2f} px with it, by {guessed:.2f} px with a lens "
        "guessed from them; check --camera"
    ]


def as_kernels_want(pixels: NDArray[np.generic]) -> NDArray[np.generic]:
    """Bytes or single floats, contiguous and writable: every other kind would be compiled for, which takes 20 s.

    What sixteen bits hold of an 8-bit photo are its bytes, written twice or moved up.
    """
    if pixels.dtype == np.uint16:
        for step in BYTES_IN_WORDS:
            whole, rest = np.divmod(pixels, np.uint16(step))
            if not rest.any():
                pixels = whole.astype(np.uint8)
                break
    kind = np.uint8 if pixels.dtype == np.uint8 else np.float32
    return np.require(pixels, dtype=kind, requirements=["C", "W"])


def inverted(pixels: NDArray[np.generic]) -> NDArray[np.generic]:
    """White for black, within the levels that the kind of pixels, or an image of floats, has."""
    if pixels.dtype == np.uint8:
        return np.asarray(cv2.bitwise_not(pixels.view(np.uint8)))
    return np.asarray((pixels.min() + pixels.max()) - pixels, dtype=np.float32)


def _search(pixels: NDArray[np.generic], plan: TargetPlan) -> NamedRings:
    """As the image is; only if the target is not named there, but discs are seen, in the inverted one."""
    found = _search_as_is(pixels, plan)
    if found.named or found.is_mirrored or np.count_nonzero(found.candidates.ratio == 0) < FEWEST_DISCS:
        return found
    other = _search_as_is(inverted(pixels), plan)
    if not (other.named or other.is_mirrored):
        return found
    return replace(other, is_inverted=True, remarks=(INVERTED, *other.remarks))


def _search_as_is(pixels: NDArray[np.generic], plan: TargetPlan) -> NamedRings:
    """Coarse to fine: name grids in a reduced image; only if none is to be had there, in a finer one."""
    factor = reduction((pixels.shape[0], pixels.shape[1]))
    found = _search_at(pixels, plan, factor)
    while not found.named and not found.is_mirrored and factor > 1:
        factor //= 2
        found = _search_at(pixels, plan, factor)
    return found


def _search_at(pixels: NDArray[np.generic], plan: TargetPlan, factor: int) -> NamedRings:
    """Candidates by one threshold after the other, until the whole target is found or all are used."""
    grey = reduced(pixels, factor)
    candidates: Candidates | None = None
    found: NamedRings | None = None
    for number, threshold in enumerate(thresholds(grey)):
        more = find_candidates(grey, threshold, factor, number * REGIONS_APART, plan.ratio)
        before = candidates.count if candidates is not None else -1
        candidates = more if candidates is None else merged(candidates, more)
        if candidates.count == before and found is not None:
            continue
        new = name_grids(pixels, plan, candidates)
        # More candidates can also confuse a grid: what named more stays.
        found = new if found is None or new.is_mirrored or new.size >= found.size else found
        if found.is_mirrored:
            break
        found, is_whole = _completed(pixels, plan, found)
        if is_whole:
            break
    assert found is not None  # noqa: S101 - there is at least one threshold
    return found


def _completed(pixels: NDArray[np.generic], plan: TargetPlan, found: NamedRings) -> tuple[NamedRings, bool]:
    """What was found, placed if need be, and whether that is all, so that other thresholds have nothing to add.

    What must be in the image is known from a board's face, or from three faces of a solid: fewer leave its pose
    open.
    """
    if len(found.named) < plan.target.shown_at_once:
        return found, False
    naming = naming_of(plan, found.named)
    if np.isin(np.flatnonzero(~plan.target.is_dot), naming.ring).all():
        return found, True
    image_size = (pixels.shape[1], pixels.shape[0])
    naming, placement = complete(plan, found.candidates, naming, image_size, None)
    places = predict(plan, placement, image_size)
    _, small = semi_axes_px(places.shape)
    is_whole = bool(np.isin(places.ring[small > EASY_RADIUS_PX], naming.ring).all())
    return replace(found, placed=(naming, placement)), is_whole


def name_grids(pixels: NDArray[np.generic], plan: TargetPlan, candidates: Candidates) -> NamedRings:
    """Grow grids and name them."""
    grids = grow_grids(candidates, plan.lattice, across_gaps=not plan.target.has_codes)
    if not grids:
        return NamedRings(candidates, (), (), ("no grid of rings was found",))
    if plan.target.has_codes:
        faces, mirrored = name_faces(plan, candidates, grids, pixels)
        if mirrored:
            return NamedRings(candidates, grids, (), (MIRRORED,), is_mirrored=True)
        remarks = () if faces.named else ("no face code could be read beyond doubt",)
        return NamedRings(candidates, grids, faces.named, remarks, strange=faces.strange)
    board: BoardName = name_board(plan, candidates, grids, pixels)
    remarks = (MIRRORED,) if board.is_mirrored else (board.remark,) if board.remark else ()
    return NamedRings(candidates, grids, (board.named,) if board.named else (), remarks, board.is_mirrored)


def naming_of(plan: TargetPlan, named: tuple[NamedGrid, ...]) -> Naming:
    """Candidates and target rows of all named grids."""
    candidate, ring = [], []
    for item in named:
        row = plan.rows_at(item.face, item.alignment.on_face(item.grid.index))
        candidate.append(item.grid.row[row >= 0])
        ring.append(row[row >= 0])
    return Naming(np.concatenate(candidate), np.concatenate(ring))


def _result(
    plan: TargetPlan,
    name: str,
    image_size: tuple[int, int],
    found: NamedRings,
    naming: Naming,
    placement: Placement,
    measured: Measured,
    remarks: tuple[str, ...],
) -> Detections:
    """The detections, ordered by target row, with their record."""
    order = np.argsort(measured.ring, kind="stable")
    kept = set(measured.ring.tolist())
    used = {c for c, r in zip(naming.candidate.tolist(), naming.ring.tolist(), strict=True) if r in kept}
    rings = np.flatnonzero(found.candidates.ratio > 0)
    rejected = np.array([k for k in rings if int(k) not in used], dtype=np.int64)
    return Detections(
        image=name,
        image_size=image_size,
        layout_id=plan.target.layout_id,
        geometry_id=plan.target.geometry_id,
        ring=measured.ring[order],
        position_mm=plan.target.center_mm[measured.ring[order]],
        center_px=measured.center_px[order],
        cov_px2=measured.cov_px2[order],
        ellipse_px=ellipses_px(measured.center_px[order], measured.shape[order]),
        faces=face_records(plan, found, placement, measured),
        remarks=remarks,
        rejected_px=found.candidates.ellipse[rejected, :2],
        ratio=measured.ratio[order],
        blur_px=measured.blur_px[order],
    )


def ellipses_px(center_px: Array, shape: Array) -> Array:
    """Centre, semi-axes and the angle of the larger one.  # (N, 2), (N, 3) -> (N, 5)"""
    if not len(shape):
        return np.zeros((0, 5))
    large, small = semi_axes_px(shape)
    a, b, c = shape[:, 0] ** 2 + shape[:, 1] ** 2, shape[:, 1] * shape[:, 2], shape[:, 2] ** 2
    # The larger axis belongs to the smaller eigenvalue of E'E.
    angle = 0.5 * np.arctan2(2 * b, a - c) + np.pi / 2
    return np.column_stack([center_px, large, small, (angle + np.pi / 2) % np.pi - np.pi / 2])


def nothing_found(
    plan: TargetPlan, name: str, image_size: tuple[int, int], candidates: Candidates | None, remarks: tuple[str, ...]
) -> Detections:
    """Detections without features."""
    rejected = None if candidates is None else candidates.ellipse[candidates.ratio > 0, :2]
    none, target = np.zeros((0, 5)), plan.target
    return Detections(
        name, image_size, target.layout_id, target.geometry_id, np.zeros(0, dtype=np.int64), none[:, :3], none[:, :2],
        np.zeros((0, 2, 2)), none, (), remarks, rejected,
    )  # fmt: skip
