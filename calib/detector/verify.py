"""Whether what was named can be the target at all: what the photo shows against what the target has, both ways.

A name by dots or a code is a hypothesis: this image shows this target here. Other targets carry the same marks. Three
questions decide: does the target explain more rings than it lacks and leaves over; does the pattern end where the
target ends, neither before nor after; and do the ratios agree that no perspective changes.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.core.types import LEAST_RADIUS_PX
from calib.detector.alignment import largest_overlap
from calib.detector.candidates import Candidates, nearest_candidates, semi_axes_px
from calib.detector.grid import Grid
from calib.detector.measure import Measured
from calib.detector.photo_checks import depth, face_end, lattice_over_spacing
from calib.detector.place import REACH, SIZE_RATIO, Naming, Placement, Places, imaged, predict
from calib.detector.plan import TargetPlan
from calib.detector.ring_marks import RING, read_marks, stretch_of
from designer.base.arrays import Array, Flags, Rows

PLAIN_RADIUS_PX = 4.0
"""Features with a larger semi-minor axis are plain to see where nothing hides them."""
MISSING_WEIGHT = 0.5
"""Covers and glare hide rings, so that one that is missing weighs less than one that is there ..."""
STRANGE_WEIGHT = 2.0
"""... and nothing makes rings, so that one that the target has not weighs more."""
MIN_GRID = 6
"""Smaller grids of rings are clutter."""
END_ODDS = 12.0
"""Odds as if all covers that hide rings one after the other were independent, so half of it is true."""
LEAST_BEYOND, BEYOND_SHARE = 3, 0.1
"""So many rings, and so large a share of the places one step outside the target, are no chance ..."""
BEYOND_A_BOARD = 2
"""... of a solid, where the rings of the next face lie; beside a board lie none."""
EXACTLY = 0.12
"""In radii and as logarithms: a ring so near its place, its size and its shape is not there by chance."""
MAX_SKEW = 0.25
"""How much more, as a logarithm, circles may be stretched one way than the other: more is another lattice."""
MAX_PROPORTION = 0.07
"""How far, as a logarithm, ring size over pitch may be from the target's: less is print, blur and exposure."""
OTHER_PROPORTION = 0.08
"""No print, blur or exposure makes so much: it is another target."""
OTHER_SPACING = 0.03
"""Nor does a print move the faces of a solid by so much, as a logarithm of lattice over distance (2 mm of 80)."""


@dataclass(frozen=True)
class NamingEvidence:
    """What speaks for and against a naming, in rings and sides of faces."""

    faces: int  # on which something was found
    found: int  # plain features that were measured
    expected: int  # plain features in the image
    strange: int  # rings where the target has none: within its faces, or in grids that no face can hold
    beyond: int  # rings one step outside the target, on its lattice
    beyond_in_view: int  # such places
    beyond_exactly: (
        int  # of the rings one step outside, those that lie as this target's would, in place, size and shape
    )
    end_odds: float  # logarithm of the odds that the pattern ends, and is not hidden, before the target does
    ended_faces: int  # on which it does so
    cut_off: int  # features outside the image, of a target without marks
    is_board: bool  # the target is flat
    is_lone: bool  # one face of a solid, so that no other face tells how large it is
    is_bounded: bool  # of a face, rings were found along every side
    radius_px: float  # semi-minor axis of the features, in the median
    skew: float  # logarithm of how much more circles are stretched one way than the other, in the median
    proportion: float  # logarithm of ring size over pitch, seen over the target's, in the median
    spacing: float  # logarithm of pitch over the distance of a solid's faces, seen over the target's; 0: not seen

    @property
    def balance(self) -> float:
        """Rings that agree less those that do not."""
        missing = self.expected - self.found
        return self.found - MISSING_WEIGHT * missing - STRANGE_WEIGHT * self.strange

    @property
    def is_too_small(self) -> bool:
        """Whether the pattern goes on where the target ends; on a board one ring that lies exactly so is no chance."""
        if self.is_board and self.beyond_exactly:
            return True
        least = BEYOND_A_BOARD if self.is_board else max(LEAST_BEYOND, BEYOND_SHARE * self.beyond_in_view)
        return self.beyond >= least

    @property
    def is_too_large(self) -> bool:
        """Whether the pattern ends before the target does, of a solid on half of the faces and more.

        Whole rows along the sides are missing and little else, or margin shows in their place.
        """
        return 2 * self.ended_faces >= self.faces and self.end_odds >= END_ODDS


def refusal(evidence: NamingEvidence) -> str:
    """Why this is not taken for the target, in a few words; "": it is.

    Somewhat other proportions do not refuse what is seen to all its sides: of targets made by others they may be known
    in part only. Where a part of the target shows, they are all that tells it from a larger one; and a lone face of a
    solid from another's, so that its rings must be large enough to tell them: of 4 px, blurred, they are up to 9 % off.
    """
    if evidence.skew > MAX_SKEW:
        return "rings lie on another lattice"
    if evidence.balance < 0:
        found = f"{evidence.found} of {evidence.expected} rings that should be in view were found"
        return found + (f", and {evidence.strange} where it has none" if evidence.strange else "")
    if evidence.cut_off:
        return "it has no dots, and not all of it is in the image"
    if evidence.is_too_small:
        count = max(evidence.beyond, evidence.beyond_exactly)
        return f"{count} ring{'s continue' if count > 1 else ' continues'} its pattern where it ends"
    if evidence.is_too_large:
        return "the pattern ends before the target does"
    if evidence.is_lone and (not evidence.is_bounded or evidence.strange >= LEAST_BEYOND):
        return "only one face is seen, and not to all its sides, or beside rings that no face of it can hold"
    if evidence.is_lone and evidence.radius_px < LEAST_RADIUS_PX:
        return "only one face could be named, and its rings are too small to tell whether it is one of this target"
    if abs(evidence.proportion) > (OTHER_PROPORTION if evidence.is_bounded else MAX_PROPORTION):
        return f"its rings are {math.exp(evidence.proportion):.2f} times as large for their pitch as the file says"
    if abs(evidence.spacing) > OTHER_SPACING:
        times = math.exp(evidence.spacing)
        return f"its rings lie {times:.2f} times as far apart for the distance of its faces as the file says"
    return ""


def proportion_remark(evidence: NamingEvidence) -> str:
    """What to say of a target whose rings are of another size than its file tells; "": nothing."""
    if abs(evidence.proportion) <= MAX_PROPORTION:
        return ""
    size = "larger" if evidence.proportion > 0 else "smaller"
    return (
        f"rings are {size} for their pitch than the target file says, by more than {100 * MAX_PROPORTION:.0f} %: "
        "is it the file of this one?"
    )


def gather(
    image: NDArray[np.generic],
    contrast: float,
    plan: TargetPlan,
    candidates: Candidates,
    grids: tuple[Grid, ...],
    naming: Naming,
    dropped: int,
    placement: Placement,
    measured: Measured,
) -> NamingEvidence:
    """Hold what was seen against what the target has where it was placed."""
    image_size = (image.shape[1], image.shape[0])
    places = predict(plan, placement, image_size)
    found = np.isin(places.ring, measured.ring)
    least_px = _radius_px(places.shape[found], 0.5)
    plain = _plain(places, least_px, image_size)
    seen = candidates.take(np.flatnonzero(candidates.ratio > 0))
    left = seen.take(_unexplained(plan, seen, places))
    faces = np.unique(plan.target.ring_face[measured.ring])
    around = _one_step_outside(plan, placement, faces, image_size)
    # Features hardly smaller than most of those found can be read, too.
    readable = around.take(_plain(around, 0.9 * _radius_px(places.shape[found], 0.1), image_size))
    rings_beyond = _read(image, plan, readable, contrast) == RING
    ends = [face_end(image, plan, places, int(face), found) for face in faces]
    skew, proportion = _ratios(plan, measured, places)
    return NamingEvidence(
        faces=len(faces),
        found=int((plain & found).sum()),
        expected=int(plain.sum()),
        strange=dropped
        + sum(int(_inside(plan, placement, int(face), left).sum()) for face in faces if left.count)
        + sum(_too_many(plan, candidates, grid, naming) for grid in grids),
        beyond=int(rings_beyond.sum()),
        beyond_in_view=len(readable.ring),
        beyond_exactly=int(_exactly(plan, seen, around).sum()),
        end_odds=sum(end.odds for end in ends),
        ended_faces=sum(end.odds > 0 for end in ends),
        cut_off=0 if plan.target.is_dot.any() else plan.target.ring_count - len(places.ring),
        is_board=plan.target.is_plate,
        is_lone=len(faces) == 1 and not plan.target.is_plate,
        is_bounded=any(end.is_bounded for end in ends),
        radius_px=float(np.median(semi_axes_px(measured.shape)[1])) if len(measured.ring) else 0.0,
        skew=skew,
        proportion=proportion,
        spacing=lattice_over_spacing(plan, placement.lens, measured.ring, measured.center_px),
    )


def _radius_px(found: Array, share: float) -> float:
    """PLAIN_RADIUS_PX; of smaller features, the semi-minor axis that so large a share of those found has not."""
    return min(PLAIN_RADIUS_PX, float(np.quantile(semi_axes_px(found)[1], share))) if len(found) else PLAIN_RADIUS_PX


def _plain(places: Places, least_px: float, image_size: tuple[int, int]) -> Flags:
    """Places whose feature would be plain to see.  # (N,)"""
    return np.asarray((semi_axes_px(places.shape)[1] >= least_px) & places.are_whole(image_size))


def _read(image: NDArray[np.generic], plan: TargetPlan, places: Places, contrast: float) -> Rows:
    """What stands at places, as the pixels say: borders may not have been found there.  # (N,)"""
    ellipse, around = np.hstack([places.center_px, places.shape]), 0.4 + 0.6 * plan.limit
    return read_marks(image, ellipse, ratio=plan.ratio, around=around, contrast=contrast)


def _at(plan: TargetPlan, rings: Candidates, places: Places) -> Rows:
    """The ring at each place, -1: none.  # (N,)"""
    reach = REACH * plan.pitch_radii
    return nearest_candidates(rings, places.center_px, places.shape, reach=reach, size_ratio=SIZE_RATIO)[0]


def _exactly(plan: TargetPlan, rings: Candidates, places: Places) -> Flags:
    """Places with a ring that is where it would be, and as large, as flat and as thick as it would be.  # (N,)"""
    if not rings.count:
        return np.zeros(len(places.ring), dtype=np.bool_)
    at = _at(plan, rings, places)
    e, ratio = rings.ellipse[at], rings.ratio[at]
    off = e[:, :2] - places.center_px
    e00, e10, e11 = places.shape.T
    off_radii = np.hypot(e00 * off[:, 0], e10 * off[:, 0] + e11 * off[:, 1])
    stretch = np.abs(stretch_of(e[:, 2:], places.shape)).max(axis=1)
    is_like = (off_radii < EXACTLY) & (stretch < EXACTLY) & (np.abs(ratio - plan.ratio) < EXACTLY)
    return np.asarray((at >= 0) & is_like)


def _unexplained(plan: TargetPlan, rings: Candidates, places: Places) -> Flags:
    """Rings at no place.  # (K,)"""
    free = np.ones(rings.count, dtype=np.bool_)
    at = _at(plan, rings, places)
    free[at[at >= 0]] = False
    return free


def _inside(plan: TargetPlan, placement: Placement, face: int, rings: Candidates) -> Flags:
    """Rings within the outline of a face, about as large as its own.  # (K,)"""
    on_face = placement.on_face(face, rings.ellipse[:, :2])
    outline = plan.target.outline_mm[face]
    return np.asarray((depth(outline, on_face) > 0).all(axis=0) & np.isfinite(on_face).all(axis=1))


def _one_step_outside(plan: TargetPlan, placement: Placement, faces: Rows, image_size: tuple[int, int]) -> Places:
    """Places of the lattice next to those that the target has, on some of the faces that show."""
    mine = np.flatnonzero(np.isin(plan.beyond_face, faces))
    face, radius = plan.beyond_face[mine], np.full(len(mine), plan.radius_mm)
    return imaged(plan, placement, face, np.full(len(mine), -1), plan.beyond_mm[mine], radius, image_size)


def _too_many(plan: TargetPlan, candidates: Candidates, grid: Grid, naming: Naming) -> int:
    """How many marks of a grid without names no face can hold; small rings look like dots, so that few may be sure."""
    sure = candidates.ratio[grid.row] > 0
    if sure.sum() < MIN_GRID or np.isin(grid.row, naming.candidate).any():
        return 0
    turns = np.concatenate([plan.lattice.turns, plan.lattice.mirrors])
    return len(grid.row) - largest_overlap(plan, grid.index, turns)


def _ratios(plan: TargetPlan, measured: Measured, places: Places) -> tuple[float, float]:
    """Skew and proportion of the rings measured: singular values of what takes predicted circles to those seen.

    Exposure and blur move both edges of the ink, the outer one inward and the inner one outward or the reverse, so the
    sum of the radii is what the print says.
    """
    ring = ~plan.target.is_dot[measured.ring]
    if not ring.any():
        return 0.0, 0.0
    row_of = np.full(plan.target.ring_count, -1)
    row_of[places.ring] = np.arange(len(places.ring))
    stretch = stretch_of(measured.shape[ring], places.shape[row_of[measured.ring[ring]]])
    size = (1 + measured.ratio[ring]) / (1 + plan.ratio)
    return float(np.median(stretch[:, 0] - stretch[:, 1])), float(np.median(stretch.mean(axis=1) + np.log(size)))
