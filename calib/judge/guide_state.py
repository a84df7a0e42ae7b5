"""What the photos so far tell of a camera, how good that is, and which view would make it better.

Each solution starts from the photos alone, so that what was first believed of a camera does no harm later. Where the
photos do not determine all of a model, a part of its parameters is solved with the others as of a camera without
distortion, and what is open of all of them is told by a guess of what cameras are like
(`calib.judge.information.knowledge_of`).
"""

import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from calib.cameras import ABILITIES, COMMON, WIDE, solved_models, told_parameters
from calib.cameras.camera import Camera
from calib.cameras.refit import image_grid
from calib.cameras.surface import surface_model
from calib.core.parallel import one_thread
from calib.core.types import LEAST_POINTS, Detections, KnownPoints, Observations, keep_views
from calib.judge.checks import STANDARD, read_criteria
from calib.judge.coverage import Coverage, coverage, coverage_of, lit_part, sigma_over_lit_px
from calib.judge.evidence import LensEvidence, evidence_of, lens_evidence, rms_px, uncertainty_of
from calib.judge.halves import half_split
from calib.judge.information import knowledge_of
from calib.judge.judge import judge
from calib.judge.verdict import Criteria, Verdict
from calib.judge.views import TargetShape, shape_of_points
from calib.observe.observations import known_points, observations_from_detections
from calib.solver.accuracy import NO_FIT, UNSURE_FOCAL, projected_sigma_px, share_px
from calib.solver.blocks import RobustLoss, view_blocks
from calib.solver.calibration import Calibration
from calib.solver.capture_error import with_capture_error
from calib.solver.outliers import shift_of_photo
from calib.solver.plan import SolvePlan, lens_kind
from calib.solver.problem import SolveOptions, origin_poses, pack, tie_parameters
from calib.solver.solve import solve
from calib.solver.target_error import LeftOpen, target_told
from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.base.words import shown, suggestion
from designer.target import TargetGeometry
from designer.tolerance.made import Made, how_made

FOCAL_CENTRE = ("fx_px", "fy_px", "cx_px", "cy_px")
ROUGH_SHARE = 0.02
"""Of the image's longer side: a camera that is less sure than that over its image is solved with fewer parameters."""
UNSURE = 2 * UNSURE_FOCAL
"""Standard deviation of a focal length, as a part of it, with which there is no camera yet."""
NOISY = 2.0
"""Times the stated noise that are left over, beyond which another kind of lens is thought of."""
MOST_OF_LENS = 1.5
"""A coefficient of a lens of which a part is solved."""
CONTRADICTS, LEAST_FAR_PX = 5.0, 0.3
"""Times the others' residuals that a photo leaves, and pixels, if something is wrong with it."""
FEWEST_OTHERS = 3
"""Photos that must agree before another one is said to contradict them."""
FEWEST_PHOTOS = 6
"""Halves of four photos agree by chance too often for their word to be taken: the true error of cameras that were good
after so few was beyond twice the stated one in 2 of 9 (`bench_guidance`)."""
MAP = (24, 16)
"""Columns and rows of the map of an image."""


ALL = "all"


@dataclass(frozen=True, eq=False)
class GuideSettings:
    """What is asked."""

    target: TargetGeometry
    points: KnownPoints  # of the target
    made: Made | None  # how it was; None: nobody knows
    criteria: Criteria
    model: str  # that cameras are solved by
    may_be_wide: bool  # the model was not asked for: a wide lens gets one of its own
    camera: Camera | None  # a first guess

    @cached_property
    def plan(self) -> SolvePlan:
        """How cameras are solved: as they will be of all photos, with the bend of a flat target if it is likely."""
        return SolvePlan((self.model,), SolveOptions()).for_target(self.made, self.points)

    @cached_property
    def shape(self) -> TargetShape:
        """Of the target, whose file says which of its sides carry the rings."""
        return shape_of_points(self.points, self.points.plane[:, :3])


def settings_of(
    target: TargetGeometry, criteria: Criteria | str = STANDARD, model: str = ALL, made: str | None = None,
    camera: Camera | None = None,
) -> GuideSettings:  # fmt: skip
    """What is asked, from words.

    Raises:
        InputError: a word that means nothing; the message says what may stand there.
    """
    limits = criteria if isinstance(criteria, Criteria) else read_criteria(criteria)
    return GuideSettings(
        target, known_points(target), how_made(target, made), limits, _guiding_model(model), model == ALL, camera
    )


def _guiding_model(model: str) -> str:
    """The formula that photos are guided by: of a map or a surface, which take many photos, one that takes few."""
    choices = solved_models()
    if model != ALL and model not in choices:
        hint = suggestion(model, [*choices, ALL]) or f"; there are {', '.join(choices)} and {ALL}"
        raise InputError(f"model {shown(model)}: none that is solved{hint}")
    if model == ALL or ABILITIES[model].is_learned:
        return COMMON
    surface = surface_model(model)
    return model if surface is None else surface.base.name


@dataclass(frozen=True, eq=False)
class Standing:
    """What is to be said of a camera that the photos determine whole."""

    evidence: LensEvidence
    verdict: Verdict


@dataclass(frozen=True, eq=False)
class Insight:
    """What is known."""

    observations: Observations | None  # of the photos that count; None: there are none
    left_out: tuple[tuple[str, str], ...]  # photos that do not count, and why
    calibration: Calibration | None  # "converged": the whole model; else what is open is a guess; None: no camera yet
    opened: LeftOpen | None = None  # of the target's shape, beside the camera; None: nothing, or no camera
    standing: Standing | None = None  # None: not judged, or the photos do not determine all of the model

    @property
    def photos(self) -> int:
        """How many count."""
        return 0 if self.observations is None else self.observations.view_count

    @property
    def is_good(self) -> bool:
        """Whether nothing is left to be wished for but more photos."""
        return self.standing is not None and self.standing.verdict.grade == "good"

    @property
    def is_enough(self) -> bool:
        """Whether so few photos as there are may be trusted to be good."""
        return self.is_good and self.photos >= FEWEST_PHOTOS

    @cached_property
    def coverage(self) -> Coverage | None:
        """What the sightings surround; None without any."""
        if self.standing is not None:
            return self.standing.evidence.coverage
        if self.calibration is not None:
            return coverage_of(self.calibration)
        seen = self.observations
        if seen is None:
            return None
        return coverage(seen.image_size, seen.center_px, seen.view, seen.points.face[seen.point])

    @property
    def covered(self) -> float:
        """Of the image, 0 to 1."""
        return 0.0 if self.coverage is None else self.coverage.share

    @cached_property
    def sigma_px(self) -> float:
        """What 95 % of the image stays within; infinite if less is known."""
        if self.calibration is None:
            return math.inf
        if self.standing is not None:
            known = self.standing.evidence.uncertainty.image_px
            return math.inf if known is None else known
        lit = lit_part(self.calibration)
        pixel = image_grid(self.calibration.camera.image_size, *MAP).reshape(-1, 2)
        return share_px(projected_sigma_px(lit.camera, self.covariance_of(self.calibration), pixel[lit.is_lit(pixel)]))

    def covariance_of(self, calibration: Calibration) -> Array:
        """The parameters' as it is told; where the photos leave some open, with a guess of those.  # (P, P)"""
        if self.standing is None:
            basis = knowledge_of(calibration).basis
            return np.asarray(basis @ basis.T)
        more = self.standing.evidence.uncertainty.factor**2 - 1
        return calibration.stated_covariance + more * calibration.param_covariance


@one_thread
def insight_of(photos: Sequence[Detections], settings: GuideSettings) -> Insight:
    """Solve what can be solved."""
    used, left_out = _usable(photos, settings)
    seen = None
    if used:
        try:
            seen = observations_from_detections(used, settings.target, origin="the photos")
        except InputError as error:
            return Insight(None, (*left_out, *((one.image, str(error)) for one in used)), None)
        kept = set(seen.view_names)
        why = "its points are mirrored, all on a line, or those of another photo once more"
        left_out += [(one.image, why) for one in used if one.image not in kept]
    if seen is None or not seen.view_count:
        return Insight(None, tuple(left_out), None)
    return _without_odd(seen, tuple(left_out), settings)


def _without_odd(seen: Observations, left_out: tuple[tuple[str, str], ...], settings: GuideSettings) -> Insight:
    """What is known without the photos that do not go with the others."""
    found, opened = _camera(seen, settings)
    if found is None:
        return Insight(seen, left_out, None)
    lost = set(seen.view_names) - set(found.observations.view_names)
    left_out += tuple((name, "nowhere could the target show its points so") for name in seen.view_names if name in lost)
    odd = odd_photo(found)
    if odd is None or len(left_out) > seen.view_count:
        return Insight(found.given, left_out, found, opened)
    others = keep_views(found.given, np.array(found.observations.view_names) != odd[0])
    return _without_odd(others, (*left_out, odd), settings)


def _usable(photos: Sequence[Detections], settings: GuideSettings) -> tuple[list[Detections], list[tuple[str, str]]]:
    """Photos of the target with points enough, of the size that most have, the first of them if there is a tie."""
    left_out: list[tuple[str, str]] = []
    named = []
    for one in photos:
        if one.layout_id != settings.target.layout_id:
            left_out.append((one.image, "shows another target"))
        elif len(one.ring) < LEAST_POINTS:
            why = "; ".join(one.remarks) if not len(one.ring) else f"only {len(one.ring)} points"
            left_out.append((one.image, why or "nothing was named in it"))
        else:
            named.append(one)
    sizes = [one.image_size for one in named]
    size = max(sizes, key=sizes.count, default=(0, 0))  # the first of those with the most
    left_out += [
        (one.image, f"is of {one.image_size[0]} x {one.image_size[1]} px, the others of {size[0]} x {size[1]}")
        for one in named
        if one.image_size != size
    ]
    return [one for one in named if one.image_size == size], left_out


def _camera(seen: Observations, settings: GuideSettings) -> tuple[Calibration | None, LeftOpen | None]:
    """The camera that the observations determine as far as they do, None if not even its focal length; what is open."""
    found = _solved(seen, settings.model, settings.plan)
    # The whole of a model that leaves no more over than the noise that is stated suits the lens.
    is_of_noise = found is not None and found.status == "converged" and found.weighted and found.scale < NOISY
    if settings.may_be_wide and not is_of_noise and lens_kind(seen).is_wide:
        found = _solved(seen, WIDE, settings.plan)
    if found is None or not (math.isfinite(found.scale) and found.scale > 0):
        return None, None
    if not rms_px(found) < NO_FIT * max(found.camera.image_size):  # points are not about where they were seen
        return None, None
    if found.status == "converged":
        return target_told(found, settings.made)
    basis = knowledge_of(found).basis
    focal = math.sqrt(float(basis[0] @ basis[0])) / float(found.camera.params[0])
    return (found if focal < UNSURE else None), None


def _solved(seen: Observations, model: str, plan: SolvePlan) -> Calibration | None:
    """The model with as many parameters as the photos determine; with a part of them its status is "degenerate"."""
    for options in _fewer_and_fewer(model, plan):
        with suppress(InputError):
            found = solve(seen, model, options)
            rough_px = ROUGH_SHARE * max(seen.image_size)
            if found.status == "converged" and sigma_over_lit_px(lit_part(found), found.param_covariance) < rough_px:
                if not options.fixed:
                    return found
                if _is_usual(found):  # that the rest is not known is told by a covariance that is not
                    unknown = np.full_like(found.param_covariance, np.nan)
                    return replace(found, status="degenerate", fixed=(), param_covariance=unknown)
    return None


def _is_usual(found: Calibration) -> bool:
    """Whether the lens is one of those that the guess of what is open is of.

    With the centre held where it is not, boards that face the camera seem to be far away and tilted, and the lens
    bends what remains.
    """
    parameters = told_parameters(found.camera.model)
    off = [
        abs(value - parameter.neutral)
        for parameter, value in zip(parameters, found.camera.params.tolist(), strict=True)
        if parameter.name not in FOCAL_CENTRE
    ]
    return max(off, default=0.0) < MOST_OF_LENS


def _fewer_and_fewer(model: str, plan: SolvePlan) -> Iterator[SolveOptions]:
    """All parameters; without the centre and with ever fewer of the lens; at last the focal length alone."""
    lens = tuple(parameter.name for parameter in told_parameters(model) if parameter.name not in FOCAL_CENTRE)
    square = (FOCAL_CENTRE[:2],)
    yield plan.options_of(model)
    for kept, centre in ((2, ()), (1, FOCAL_CENTRE[2:]), (0, FOCAL_CENTRE[2:])):
        if len(lens) >= kept:
            yield SolveOptions(fixed=tuple((name, None) for name in (*centre, *lens[kept:])), shared=square)


def odd_photo(found: Calibration) -> tuple[str, str] | None:
    """The photo that does not go with the others, and why: damaged, or of a target that moved, or with another zoom."""
    if found.observations.view_count <= FEWEST_OTHERS:
        return None
    return _far_off(found) or _shifted(found)


def _far_off(found: Calibration) -> tuple[str, str] | None:
    """The photo whose residuals are far beyond those of all others."""
    seen = found.observations
    count = np.bincount(seen.view, minlength=seen.view_count)
    square = np.bincount(seen.view, (found.residual_px**2).sum(axis=1), seen.view_count) / np.maximum(count, 1)
    worst = int(square.argmax())
    usual = float(np.median(np.delete(square, worst)))
    if not square[worst] > max(CONTRADICTS**2 * usual, LEAST_FAR_PX**2):
        return None
    return seen.view_names[worst], "contradicts the other photos: damaged, or the target moved or bent"


def _shifted(found: Calibration) -> tuple[str, str] | None:
    """The photo whose picture is shifted against the others'."""
    if found.status != "converged":
        return None
    problem = pack(found.observations, weighted=found.weighted)
    products = view_blocks(problem, found.camera, origin_poses(problem, found.cam_from_target), RobustLoss()).products
    shift = shift_of_photo(products, tie_parameters(found.camera.model, SolveOptions()))
    if shift is None:
        return None
    why = f"is shifted by about {np.hypot(shift.right_px, shift.down_px):.2g} px: another zoom, focus or stabiliser"
    return found.observations.view_names[shift.view], why


@one_thread
def judged(known: Insight, settings: GuideSettings) -> Insight:
    """With the verdict on the camera, if the photos determine all of it."""
    found = known.calibration
    if found is None or found.status != "converged":
        return known
    evidence = lens_evidence([found], 0, half_split(found, settings.plan.options_of(found.camera.model)))
    standing = Standing(evidence, judge(evidence_of(found, evidence), settings.criteria))
    if standing.verdict.grade != "good":
        return replace(known, standing=standing)
    # What is alike in all photos or fixed in the image takes as long as the rest, and may only make worse what is good.
    found = with_capture_error(found)
    uncertain = uncertainty_of(found, evidence.coverage, evidence.uncertainty.factor)
    evidence = replace(evidence, uncertainty=uncertain)
    standing = Standing(evidence, judge(evidence_of(found, evidence), settings.criteria))
    return replace(known, calibration=found, standing=standing)
