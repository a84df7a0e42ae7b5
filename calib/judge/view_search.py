"""Photos that could be taken next, what each would tell, and which of them come first.

Candidates are compared by what they tell with some of the target's points, or by the cells of the image they show
points in; the best few are then looked at with all points.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from calib.cameras.camera import Camera
from calib.cameras.refit import image_grid
from calib.core.linear_algebra import covariance_with_prior
from calib.judge.candidate_views import CandidateViews, ShownPoints, shown_in
from calib.judge.coverage import LitPart, area_of, coverage_of, lit_part
from calib.judge.greedy import LITTLE_GAIN
from calib.judge.information import (
    ImageGoal,
    Knowledge,
    StatedError,
    covariance_of_photos,
    image_goal,
    view_information,
)
from calib.judge.views import Habits, TargetShape
from calib.solver.accuracy import SHARE_PERCENT
from calib.solver.calibration import Calibration
from designer.base.arrays import Array, Flags, Rows

COARSE_MAP = (16, 12)
"""Pixels of the map that candidates are compared by; the deviation that is stated is over the usual grid."""
POINTS_COMPARED = 240
FEWEST_ON_FACE = 12
POINTS_AT_A_TIME = 20_000
COMPARED_IN_FULL = 300
"""Of the candidates, those best by the mean square over the image."""
TRIED = 12
"""Of the candidates in their order, so many are looked at with all points."""
LEAST_RINGS = 12
STRANGE = 0.2
"""A distance beyond the used ones by a factor of two must be worth this share more."""
AGAIN = 0.1
"""The same for a place that was proposed already, because the lens may be less even than its model takes it to be."""
WORTH_OF_NEW = 0.2
"""The same for a photo that shows nothing where nothing was seen yet, against the one that shows most there."""
MOST_FOR_NEW = 0.5
"""Of what the best photo gains: more of it is not given up for what is new."""
CELLS = (16, 12)
"""Parts of the image, by which what is new is counted."""
LEAST_NEW = 0.06
"""Of the image: where less is new of what any photo shows, that makes up for less."""


@dataclass(frozen=True)
class ViewGoal:
    """What photos are to reach."""

    sigma_px: float  # 95 % of the image is to be known so well
    covered: float  # so much of it is to be surrounded by observations, 0 to 1
    little_gain: float = LITTLE_GAIN  # a photo that leaves more than this of the deviation is not worth taking
    little_area: float = 0.01  # of the image: one that covers no more is not, either
    most_for_accuracy: int = 4  # what is known after so many photos is to be solved before more are chosen by it
    fewest: int = 0  # photos, however well the image is known and covered


@dataclass(frozen=True, eq=False)
class CandidatePhoto:
    """A candidate with all its points."""

    row: int
    information: Array  # (Q + S, Q + S) on the camera, and on the target's shape
    area: Flags  # (R, C) cells of a coverage


@dataclass(frozen=True, eq=False)
class SoFar:
    """What is known and covered with the photos chosen so far."""

    search: "ViewSearch"
    told: Array  # (Q + S, Q + S) information of the photos chosen so far, beside what was known
    is_covered: Flags  # (R, C) cells of a coverage
    is_lit: Flags  # (R, C) cells that are asked for
    chosen: tuple[int, ...] = ()  # rows of the candidates

    @cached_property
    def within_px(self) -> float:
        """What 95 % of the image stays within; infinite if less is known."""
        covariance = self.search.covariance_after(self.told)
        return math.inf if covariance is None else self.search.goal.within_px(covariance)

    @property
    def covered(self) -> float:
        """Of what is asked for, 0 to 1."""
        return float(self.is_covered[self.is_lit].mean())

    def with_photo(self, photo: CandidatePhoto) -> "SoFar":
        """After a choice."""
        told, is_covered = self.told + photo.information, self.is_covered | photo.area
        return replace(self, told=told, is_covered=is_covered, chosen=(*self.chosen, photo.row))

    def new_area(self, area: Flags) -> float:
        """Of what is asked for, what a photo's area adds to what is covered."""
        return float((area & ~self.is_covered)[self.is_lit].mean())

    def wants_accuracy(self, goal: ViewGoal) -> bool:
        """Whether the image is to be known better, or is a guess up to now."""
        is_guess = not self.search.is_whole and not self.chosen
        some = len(self.chosen) + (self.covered < goal.covered)
        return self.within_px > goal.sigma_px or is_guess or some < goal.fewest


@dataclass(frozen=True, eq=False)
class ViewSearch:
    """What a choice is made from."""

    calibration: Calibration
    lit: LitPart
    known: Knowledge
    covariance_after: Callable[[Array], Array | None]  # of q, after photos that tell so much; None: something is open
    modes_mm: Array  # (S, N, 3) of the shape's points: what the target's numbers move
    shape: TargetShape
    habits: Habits
    candidates: CandidateViews
    information: Array  # (C, Q, Q) of each, from some of the points
    covers: Flags  # (C, K) cells of the image that each shows a point in
    goal: ImageGoal
    coarse: ImageGoal  # that candidates are compared by
    is_whole: bool  # all of the image is known up to now, not only guessed

    def start(self) -> SoFar:
        """Before the first choice."""
        size, found = self.known.basis.shape[1] + len(self.modes_mm), coverage_of(self.calibration)
        return SoFar(self, np.zeros((size, size)), found.is_covered, found.is_lit)

    def choose(self, so_far: SoFar, goal: ViewGoal) -> CandidatePhoto | None:
        """The photo after which the image is known best, or that shows most of what is new; None: none is worth it."""
        if so_far.wants_accuracy(goal) and len(so_far.chosen) < goal.most_for_accuracy:
            for photo in self.for_accuracy(so_far):
                if so_far.with_photo(photo).within_px <= goal.little_gain * so_far.within_px:
                    return photo
        new = self.for_coverage(so_far) if so_far.covered < goal.covered else None
        return None if new is None or so_far.new_area(new.area) <= goal.little_area else new

    def for_accuracy(self, so_far: SoFar) -> Iterator[CandidatePhoto]:
        """Photos that make the camera best known by the noise, the best first."""
        mean_square, size = self.coarse.mean_square(), self.known.basis.shape[1]
        told = so_far.told[:size, :size]
        after = covariance_with_prior(told + self.information)
        square = np.einsum("cij,ji->c", after, mean_square)
        now = np.einsum("ij,ji", covariance_with_prior(told), mean_square)
        gain = 1 - np.sqrt(max(square.min(), 0.0) / now) if now > 0 else 0.0  # rounding may leave less than nothing
        worth_of_new = min(WORTH_OF_NEW, MOST_FOR_NEW * float(gain))
        effort = self._effort(so_far) * (1 + worth_of_new * (1 - self._new_cells(so_far)))
        best = np.argsort(square * effort**2, kind="stable")[:COMPARED_IN_FULL]
        order = best[np.argsort(self.coarse.compared_px(after[best]) * effort[best], kind="stable")]
        order = order[np.isfinite(effort[order])]
        return (self.in_full(row) for row in order[:TRIED].tolist())

    def for_coverage(self, so_far: SoFar) -> CandidatePhoto | None:
        """The photo that surrounds most of what no photo has shown yet; None if all were chosen."""
        effort = self._effort(so_far)
        order = np.argsort(-self._new_cells(so_far) / effort, kind="stable")[:TRIED]
        order = order[np.isfinite(effort[order])].tolist()
        if not order:
            return None
        return self.in_full(max(order, key=lambda row: so_far.new_area(self._area(self._shown(row))) / effort[row]))

    def in_full(self, row: int) -> CandidatePhoto:
        """What a candidate would add with all its points."""
        shown, pose = self._shown(row), self.candidates.cam_from_target[row : row + 1]
        added = view_information(self.known, pose, self.shape.position_mm, shown.weight, self.modes_mm)[0]
        return CandidatePhoto(row, added, self._area(shown))

    def _shown(self, row: int) -> ShownPoints:
        """All points in a candidate."""
        pose, points = self.candidates.cam_from_target[row : row + 1], np.arange(len(self.shape.face))
        return shown_in(self.known.camera, self.shape, self.habits, pose, points)

    def _area(self, shown: ShownPoints) -> Flags:
        """Cells of a coverage that one photo surrounds.  # (R, C)"""
        read = shown.is_read[0]
        return area_of(self.known.camera.image_size, shown.pixel[0, read], self.shape.face[read])

    def _new_cells(self, so_far: SoFar) -> Array:
        """What each candidate shows of what is not covered yet (C,), of what most do or of a part: 0 to 1."""
        columns, rows = CELLS
        fine = so_far.is_covered
        row = ((np.arange(rows) + 0.5) / rows * fine.shape[0]).astype(np.int64)
        column = ((np.arange(columns) + 0.5) / columns * fine.shape[1]).astype(np.int64)
        new = (self.covers & ~fine[np.ix_(row, column)].ravel()).sum(axis=1)
        return np.asarray(new / max(int(new.max(initial=0)), LEAST_NEW * columns * rows))

    def _effort(self, so_far: SoFar) -> Array:
        """Factors (C,) that make less attractive: distances nobody has used, places proposed already."""
        near, far = self.habits.distance_mm
        distance, place = self.candidates.distance_mm, self.candidates.place
        beyond = np.maximum(np.log2(near / distance), np.log2(distance / far)).clip(min=0.0)
        again: Flags = np.asarray((place[:, None] == place[list(so_far.chosen)]).all(axis=2).any(axis=1))
        effort: Array = np.asarray((1 + STRANGE * beyond) * (1 + AGAIN * again))
        # The very same photo once more averages the noise, and none of what is wrong in each photo.
        effort[list(so_far.chosen)] = np.inf
        return effort


def view_search(
    calibration: Calibration, shape: TargetShape, habits: Habits, candidates: CandidateViews,
    known: Knowledge, error: StatedError | None = None,
) -> ViewSearch | None:  # fmt: skip
    """What each of the photos that could be taken tells; None if the target is read in none of them.

    Args:
        calibration: what is known so far.
        shape: of the target.
        habits: how it is held, and read.
        candidates: the photos.
        known: of the calibration.
        error: as it is told; None: by the photos to come alone, of all of the image.
    """
    lit, rows, faces = lit_part(calibration), _some_points(shape), len(shape.normal)
    count, weight, covers = _read(lit.camera, shape, habits, candidates, rows)
    ok, goal = count >= min(LEAST_RINGS, habits.rings), image_goal(known)
    if not ok.any() or not len(goal.change):
        return None
    stands_for = np.bincount(shape.face, minlength=faces) / np.bincount(shape.face[rows], minlength=faces).clip(min=1)
    weighed = weight[ok] * stands_for[shape.face[rows]]
    information = view_information(known, candidates.cam_from_target[ok], shape.position_mm[rows], weighed)
    modes_mm = np.zeros((0, len(shape.face), 3)) if error is None or error.modes_mm is None else error.modes_mm
    everywhere = int(lit.is_lit(image_grid(calibration.camera.image_size)).sum())
    is_whole = known.is_determined and len(goal.change) >= SHARE_PERCENT / 100 * everywhere
    # Where the lens model breaks down in more than the rest, numbers can only be of what it reaches.
    pixels = everywhere if is_whole or error is None else goal.pixels
    return ViewSearch(
        calibration, lit, known, covariance_of_photos if error is None else error.after, modes_mm, shape, habits,
        candidates[ok], information, covers[ok], replace(goal, pixels=pixels), image_goal(known, *COARSE_MAP), is_whole,
    )  # fmt: skip


def _read(
    camera: Camera, shape: TargetShape, habits: Habits, candidates: CandidateViews, rows: Rows
) -> tuple[Rows, Array, Flags]:
    """How many points candidates show (C,), what some of them weigh (C, R), and in which cells of the image (C, K)."""
    count, points = len(candidates.distance_mm), np.arange(len(shape.face))
    read, weight = np.zeros(count, dtype=np.int64), np.zeros((count, len(rows)))
    covers = np.zeros((count, CELLS[0] * CELLS[1]), dtype=bool)
    step = max(1, POINTS_AT_A_TIME // max(len(points), 1))
    for begin in range(0, count, step):
        part = slice(begin, begin + step)
        shown = shown_in(camera, shape, habits, candidates.cam_from_target[part], points)
        read[part], weight[part] = shown.is_read.sum(axis=1), shown.weight[:, rows]
        covers[part] = _cells(camera, shown.pixel, shown.is_read)
    return read, weight, covers


def _cells(camera: Camera, pixel: Array, is_read: Flags) -> Flags:
    """Which cells of the image photos show a point in (C, K)."""
    columns, rows = CELLS
    covers = np.zeros((len(pixel), columns * rows), dtype=bool)
    column, row = (
        ((along[is_read] + 0.5) / size * count).astype(np.int64)
        for along, size, count in zip((pixel[..., 0], pixel[..., 1]), camera.image_size, CELLS, strict=True)
    )
    covers[np.nonzero(is_read)[0], row * columns + column] = True
    return covers


def _some_points(shape: TargetShape) -> Rows:
    """Rows of a few points a face: its corners, and others evenly over their order."""
    faces = np.unique(shape.face)
    each = max(FEWEST_ON_FACE, POINTS_COMPARED // len(faces)) if len(faces) > 1 else POINTS_COMPARED // 3
    chosen = []
    for face in faces.tolist():
        rows = np.flatnonzero(shape.face == face)
        some = rows[np.linspace(0, len(rows) - 1, min(len(rows), each)).round().astype(np.int64)]
        chosen.append(np.union1d(some, shape.corner[face]))
    return np.concatenate(chosen)
