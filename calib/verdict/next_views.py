"""The next photos that would make a camera best known: of many that could be taken, those that tell most.

Photos are chosen one after the other. The next is the one after which the deviation that 95 % of the image stays within
is least, with all chosen before it taken (greedy optimal design; as guidance in Richardson et al. 2013, "AprilCal").
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.cameras import project
from calib.se3 import transform
from calib.solver.degeneracy import NO_FIT
from calib.types import Calibration, Camera, frozen_array
from calib.verdict.candidate_views import Candidates, candidates_of, faces_seen, shown_in
from calib.verdict.coverage import coverage, coverage_of
from calib.verdict.information import (
    Knowledge,
    grid_count,
    has_information,
    image_change,
    knowledge_of,
    sigma_px,
    view_information,
)
from calib.verdict.next_view_target import Habits, TargetShape, habits_of, shape_of
from calib.verdict.next_view_words import Hold, sentence_of

Array = NDArray[np.float64]

MOST_VIEWS = 4
SHARE_PERCENT = 95.0
COARSE_MAP = (16, 12)
"""Pixels of the map that candidates are compared by; the deviation that is stated is over the usual grid."""
POINTS_COMPARED = 240
FEWEST_ON_FACE = 12
COMPARED_IN_FULL = 300
"""Of the candidates, those best by the mean square over the image."""
LEAST_RINGS = 12
STRANGE = 0.2
"""A distance beyond the used ones by a factor of two must lower the deviation by this share more."""
AGAIN = 0.1
"""The same for a place that was proposed already, because the lens may be less even than its model takes it to be."""
WORTH_OF_NEW = 0.2
"""The same for a photo that shows nothing where nothing was seen yet, against the one that shows most there."""
WORTH_OF_NEW_ALONE = 2.0
"""The same once the camera is known as well as wanted, and only parts of the image are missing."""
LITTLE_AREA = 0.01
"""Of the image: a photo that adds less than this to what is covered adds nothing."""
CELLS = (16, 12)
"""Parts of the image, by which what is new is counted."""
LITTLE_GAIN = 0.97
"""A photo that leaves more than this of the deviation is not worth taking."""
ROUGH_PX = 3.0
"""Where the image is no better known than this, the lens may be another one, and what a photo will show with it."""
SAME_FROM_ANY_SIDE = 1.15
STEPS_ALONG_EDGE = 8


@dataclass(frozen=True, eq=False)
class NextView:
    """A photo to take, and what it would do."""

    cam_from_target: Array  # (4, 4)
    sentence: str
    sigma_px_before: float  # what 95 % of the image stays within; infinite: not determined
    sigma_px_after: float  # with this photo and those proposed before it
    outline_px: tuple[Array, ...]  # (K, 2) closed lines around the faces that look at the camera, as they would appear

    def __post_init__(self) -> None:
        object.__setattr__(self, "cam_from_target", frozen_array(self.cam_from_target))
        object.__setattr__(self, "outline_px", tuple(frozen_array(line) for line in self.outline_px))


@dataclass(frozen=True, eq=False)
class _Scene:
    """What a choice is made from."""

    known: Knowledge
    shape: TargetShape
    habits: Habits
    candidates: Candidates
    information: Array  # (C, Q, Q) of each, from some of the points
    covers: NDArray[np.bool_]  # (C, K) cells of the image that each covers
    is_covered: NDArray[np.bool_]  # (K,) cells that the photos taken so far cover


def why_no_next_views(calibration: Calibration) -> str:
    """Why nothing can be proposed, in a line; empty if it can."""
    if not has_information(calibration.camera.model):
        return (
            f"the {calibration.camera.model} model's accuracy takes its learned map as exact; "
            "see the next photos of another model"
        )
    if not math.isfinite(calibration.scale) or not calibration.scale > 0:
        return "the solution states no accuracy of an observation"
    typical = float(np.sqrt(np.median((calibration.residual_px**2).sum(axis=1))))
    if not typical < NO_FIT * max(calibration.camera.image_size):
        return "the solution does not fit its photos"
    if shape_of(calibration) is None:
        return "the points lie on no known plane, so which of them a photo would show is not known"
    return ""


def next_views(
    calibration: Calibration,
    *,
    most: int = MOST_VIEWS,
    goal_px: float = 0.0,
    goal_covered: float = 0.0,
    face_share: float | None = None,
) -> tuple[NextView, ...]:
    """The photos to take next, the most useful first; none if both goals are reached, or `why_no_next_views` says why.

    Args:
        calibration: what is known so far.
        most: so many photos at most; fewer if more do little.
        goal_px: 95 % of the image is to be known so well.
        goal_covered: so much of the image is to be surrounded by sightings, 0 to 1.
        face_share: so much of a face must be seen for its rings to be read; None: as in the photos taken so far.
    """
    if why_no_next_views(calibration):
        return ()
    scene = _scene(calibration, face_share)
    change = image_change(scene.known)
    if not len(change) or not len(scene.candidates.distance_mm):
        return ()
    everywhere = grid_count(calibration.camera)
    is_known = scene.known.is_determined and len(change) >= SHARE_PERCENT / 100 * everywhere
    # Where the lens model breaks down in more than the rest, numbers can only be of what it reaches.
    pixels = everywhere if is_known else len(change)
    knowledge, covered = np.eye(scene.known.basis.shape[1]), coverage_of(calibration).is_covered
    before = share_px(sigma_px(change, knowledge), pixels)
    is_rough = not is_known or before > ROUGH_PX
    chosen: list[NextView] = []
    for row in _choose(scene, most, goal_px):
        wants_area = covered.mean() < goal_covered
        if is_known and before <= goal_px and not wants_area:
            break
        added, area = _in_full(scene, row)
        after = share_px(sigma_px(change, knowledge + added), pixels)
        adds_area = bool((area & ~covered).mean() > LITTLE_AREA)
        if after > LITTLE_GAIN * before and not (wants_area and adds_area):
            break
        shown = before if is_known else math.inf
        one = scene.candidates[np.array([row])]
        sentence = sentence_of(_hold(scene, one, calibration), shown, after, is_rough=is_rough)
        pose = one.cam_from_target[0]
        chosen.append(NextView(pose, sentence, shown, after, outline_px(calibration.camera, scene.shape, pose)))
        knowledge, covered, before, is_known = knowledge + added, covered | area, after, True
    return tuple(chosen)


def share_px(sigma: Array, pixels: int = 0) -> float:
    """What 95 % of a map of deviations stays within; infinite if less of it is known.

    Args:
        sigma: of what is known.
        pixels: of the whole map, if those that are not known were left out.
    """
    known = sigma[np.isfinite(sigma)]
    missing = np.full(max(len(sigma), pixels) - len(known), np.inf)
    everywhere = np.concatenate([known, missing])
    return float(np.percentile(everywhere, SHARE_PERCENT, method="inverted_cdf")) if len(everywhere) else math.nan


def photos_needed(photos: int, sigma_px_now: float, limit_px: float) -> int:
    """How many photos like those so far, these included, until a deviation is within a limit.

    Photos like each other add information alike, so that deviations fall with the square root of their number.
    """
    if not (photos > 0 and limit_px > 0 and math.isfinite(sigma_px_now)):
        raise ValueError(f"{photos} photos, {sigma_px_now} px, limit {limit_px} px: there is no such number")
    return max(photos, math.ceil(photos * (sigma_px_now / limit_px) ** 2 - 1e-9))


def _scene(calibration: Calibration, face_share: float | None) -> _Scene:
    shape = shape_of(calibration)
    if shape is None:
        raise ValueError("no point lies on a known plane")
    habits = habits_of(calibration, shape)
    if face_share is not None:
        habits = Habits(habits.distance_mm, face_share, habits.pitch_px, habits.rings)
    known = knowledge_of(calibration)
    candidates = candidates_of(calibration, shape, habits)
    rows = _some_points(shape)
    shown = shown_in(calibration.camera, shape, habits, candidates.cam_from_target, rows)
    faces = len(shape.normal)
    stands_for = np.bincount(shape.face, minlength=faces) / np.bincount(shape.face[rows], minlength=faces).clip(min=1)
    weight = shown.is_read * stands_for[shape.face[rows]]
    ok = weight.sum(axis=1) >= min(LEAST_RINGS, habits.rings)
    information = view_information(known, candidates.cam_from_target[ok], shape.position_mm[rows], weight[ok])
    covers = _cells(calibration.camera, shown.pixel[ok], shown.is_read[ok])
    return _Scene(known, shape, habits, candidates[ok], information, covers, _covered_cells(calibration))


def _cells(camera: Camera, pixel: Array, is_read: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Which cells of the image photos show a point in (C, K)."""
    columns, rows = CELLS
    covers = np.zeros((len(pixel), columns * rows), dtype=bool)
    photo, point = np.nonzero(is_read)
    place = (pixel[photo, point] + 0.5) / camera.image_size * CELLS
    column, row = np.clip(place.astype(np.int64), 0, np.array(CELLS) - 1).T
    covers[photo, row * columns + column] = True
    return covers


def _covered_cells(calibration: Calibration) -> NDArray[np.bool_]:
    """Which cells (K,) the photos taken so far cover."""
    covered = coverage_of(calibration).is_covered
    columns, rows = CELLS
    row = ((np.arange(rows) + 0.5) / rows * covered.shape[0]).astype(np.int64)
    column = ((np.arange(columns) + 0.5) / columns * covered.shape[1]).astype(np.int64)
    cells: NDArray[np.bool_] = covered[np.ix_(row, column)].ravel()
    return cells


def _some_points(shape: TargetShape) -> NDArray[np.int64]:
    """Rows of a few points a face: its corners, and others evenly over their order."""
    faces = np.unique(shape.face)
    each = max(FEWEST_ON_FACE, POINTS_COMPARED // len(faces)) if len(faces) > 1 else POINTS_COMPARED // 3
    chosen = []
    for face in faces.tolist():
        rows = np.flatnonzero(shape.face == face)
        some = rows[np.linspace(0, len(rows) - 1, min(len(rows), each)).round().astype(np.int64)]
        chosen.append(np.union1d(some, shape.corner[face]))
    return np.concatenate(chosen)


def _choose(scene: _Scene, most: int, goal_px: float) -> list[int]:
    """Rows of the candidates to take, one after the other."""
    change = image_change(scene.known, *COARSE_MAP)
    flat = change.reshape(-1, change.shape[2])
    mean_square = flat.T @ flat / len(change)
    knowledge = np.eye(change.shape[2])
    chosen: list[int] = []
    while len(chosen) < most and len(scene.candidates.distance_mm):
        is_reached = np.percentile(sigma_px(change, knowledge), SHARE_PERCENT) <= goal_px
        effort = _effort(scene, chosen, WORTH_OF_NEW_ALONE if is_reached else WORTH_OF_NEW)
        after = knowledge + scene.information
        square = np.einsum("cij,ji->c", np.linalg.inv(after), mean_square)
        best = np.argsort(square * effort**2, kind="stable")[:COMPARED_IN_FULL]
        share = np.percentile(sigma_px(change, after[best]), SHARE_PERCENT, axis=1)
        pick = int(best[np.argmin(share * effort[best])])
        chosen.append(pick)
        knowledge = after[pick]
    return chosen


def _effort(scene: _Scene, chosen: list[int], worth_of_new: float) -> Array:
    """Factors (C,) that make less attractive: distances nobody has used, places proposed already, nothing new seen."""
    near, far = scene.habits.distance_mm
    distance, place = scene.candidates.distance_mm, scene.candidates.place
    beyond = np.maximum(np.log2(near / distance), np.log2(distance / far)).clip(min=0.0)
    again: NDArray[np.bool_] = np.asarray((place[:, None] == place[chosen]).all(axis=2).any(axis=1))
    new = (scene.covers & ~(scene.is_covered | scene.covers[chosen].any(axis=0))).sum(axis=1)
    nothing_new = 1 - new / max(int(new.max()), 1)
    effort: Array = np.asarray((1 + STRANGE * beyond) * (1 + AGAIN * again) * (1 + worth_of_new * nothing_new))
    return effort


def _in_full(scene: _Scene, row: int) -> tuple[Array, NDArray[np.bool_]]:
    """What a candidate would add with all its points: information, and the cells of a coverage that it covers."""
    shape, pose, camera = scene.shape, scene.candidates.cam_from_target[row : row + 1], scene.known.camera
    shown = shown_in(camera, shape, scene.habits, pose, np.arange(len(shape.face)))
    read = shown.is_read[0]
    added: Array = view_information(scene.known, pose, shape.position_mm, shown.is_read.astype(np.float64))[0]
    one_view = np.zeros(int(read.sum()), dtype=np.int64)
    area = coverage(camera.image_size, shown.pixel[0, read], one_view, shape.face[read])
    return added, area.is_covered


def _hold(scene: _Scene, one: Candidates, calibration: Calibration) -> Hold:
    """How a candidate is to be held, as plain numbers."""
    like = int(one.like_view[0])
    any_side = like < 0 or _is_same_from_any_side(scene, one)
    return Hold(
        place=(float(one.place[0, 0]), float(one.place[0, 1])),
        distance_mm=float(one.distance_mm[0]),
        usual_distance_mm=None if scene.known.is_determined else _usual_distance_mm(calibration, scene.shape),
        tilt_deg=float(one.tilt_deg[0]),
        away=(float(one.away[0, 0]), float(one.away[0, 1])),
        long_side="" if scene.shape.aspect <= 1.15 or like >= 0 else "upright" if one.is_upright[0] else "level",
        like_photo="" if any_side else calibration.observations.view_names[like],
        is_flat=scene.shape.is_flat,
    )


def _usual_distance_mm(calibration: Calibration, shape: TargetShape) -> float:
    """The median distance from the camera to the target's middle."""
    return float(np.median(np.linalg.norm(transform(calibration.cam_from_target, shape.center_mm), axis=1)))


def _is_same_from_any_side(scene: _Scene, one: Candidates) -> bool:
    """Whether a solid tells about as much at a place, whichever of its sides is shown."""
    all_of = scene.candidates
    alike = (all_of.place == one.place).all(axis=1) & np.isclose(all_of.distance_mm, one.distance_mm[0])
    change = image_change(scene.known, *COARSE_MAP)
    share = np.percentile(sigma_px(change, np.eye(change.shape[2]) + scene.information[alike]), SHARE_PERCENT, axis=1)
    return float(share.max()) <= SAME_FROM_ANY_SIDE * float(share.min())


def outline_px(camera: Camera, shape: TargetShape, cam_from_target: Array) -> tuple[Array, ...]:
    """Closed lines (K, 2) in the image around the outermost rings of each face that looks at the camera."""
    looks = faces_seen(shape, cam_from_target[None])[0][0]
    lines = []
    for face in np.flatnonzero(looks).tolist():
        corner = shape.position_mm[shape.corner[face]]
        if len(corner) < 3:
            continue
        step = np.linspace(0, 1, STEPS_ALONG_EDGE, endpoint=False)[:, None]
        edges = corner[:, None] + step * (np.roll(corner, -1, axis=0) - corner)[:, None]
        line = edges.reshape(-1, 3)
        pixel = project(camera, transform(cam_from_target, np.concatenate([line, line[:1]])))
        if np.isfinite(pixel).all():
            lines.append(pixel)
    return tuple(lines)
