"""What is measured before anything is judged, of one camera or of several: no limits here."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from calib.cameras import project, rays
from calib.cameras.refit import image_grid
from calib.core.linear_algebra import rms_length, sums_by
from calib.core.se3 import transform
from calib.judge.coverage import Coverage, coverage_of, lit_part, sigma_over_lit_px
from calib.judge.difference import Known, apart, sigma_over
from calib.judge.halves import HalfSplit, HalvesApart, NoHalves, RigHalves, halves_apart
from calib.judge.reading import reading_of
from calib.judge.target_shape import ShapeEffect, shape_effect
from calib.solver.accuracy import share_px
from calib.solver.calibration import Calibration, CaptureError, CircleDoubt, ImageField, PhotoError, Status, TargetError
from calib.solver.metrics.errors import Errors, summarise
from calib.solver.metrics.evaluation import evaluate
from calib.solver.metrics.residual_cells import LEAST_PER_CELL, cells_of_residuals, residuals_of
from calib.solver.outliers import deviations
from calib.solver.priors import contradictions
from designer.base.words import printable

if TYPE_CHECKING:
    from calib.rigs.figures import CameraTie, PairFigures
    from calib.rigs.relative import CarriedError, MiddleError
    from calib.rigs.result import MechanismFit, RigCalibration

LEAST_SHARE, MOST_SHARE = 0.25, 0.5
"""Of the residuals: a smaller systematic part blames nobody."""
FAR_OFF = 4.0
"""Robust standard deviations beyond which a sighting is far off; normal noise has 1 of 3000 there."""


@dataclass(frozen=True)
class Uncertainty:
    """Standard deviation of the camera's pixels, along its worse axis: by noise, target, and a field over the image."""

    image_px: float | None  # 95 % of the image's lit part is at most so uncertain; None: of less is anything known
    covered_px: float | None  # 95 % of what the sightings cover
    noise_px: float | None  # of the image, by noise alone as the solution states it
    target_px: float  # of the image, by the target alone
    target_error: TargetError | None  # how the target is taken to be made; None: nobody knows
    known: float  # of the image, 0 to 1: where the model has rays
    is_estimated: bool  # at least one parameter was
    is_map_exact: bool  # the error of a learned map is not in it
    factor: float = 1.0  # by which halves of the photos enlarge the part of the noise
    image_field: ImageField | None = None  # None: nothing shows that there is one
    field_px: float = 0.0  # of the image, by that field alone
    capture_error: CaptureError | None = None  # what is alike in all photos; None: not asked, or not told
    capture_px: float = 0.0  # of the image, by that alone
    photo_error: PhotoError | None = None  # what the centres of a photo share; it stands for the factor of the halves
    circle_doubt: CircleDoubt | None = None  # None: what the points are is known
    circle_px: float = 0.0  # of the image, by that doubt alone

    @property
    def by_target(self) -> bool:
        """Whether most of it is the target's."""
        return self.image_px is not None and 2 * self.target_px**2 > self.image_px**2

    @property
    def by_field(self) -> bool:
        """Whether more of it is the field's than the noise's."""
        return self.noise_px is None or self.field_px > self.factor * self.noise_px

    @property
    def by_circles(self) -> bool:
        """Whether more of it is by the doubt about what the points are than by the noise."""
        return self.circle_doubt is not None and self.circle_px > self.factor * (self.noise_px or 0.0)


@dataclass(frozen=True)
class ModelApart:
    """How another model, solved from the same photos, differs over the covered area."""

    model: str
    percentile_95_px: float | None  # None: nothing to compare, `reason` says why
    reason: str
    shared: float  # of the covered area, 0 to 1: where both are known
    is_learned: bool
    rmse_px: float = math.nan  # what it leaves over


@dataclass(frozen=True, eq=False, kw_only=True)
class CameraEvidence:
    """What one camera leaves over, and what it saw."""

    name: str  # "" of the only one
    frames: int  # in which it sees the target
    sightings: int  # that count
    left_out: int
    rms_px: float  # root mean square length of the residuals that count
    times_stated: float | None  # the noise over what the detector states; None: it states nothing, or is not asked
    coverage: Coverage | None  # None: its lens was given


@dataclass(frozen=True, eq=False, kw_only=True)
class LensEvidence(CameraEvidence):
    """Of a camera that was solved by itself, also how sure its lens is."""

    coverage: Coverage
    model: str
    halves: HalvesApart | NoHalves
    uncertainty: Uncertainty
    stated_sigma_px: float | None  # of a coordinate, as the detector states it
    far_share: float  # of the sightings, 0 to 1: that count and are beyond `FAR_OFF`
    left_out_share: float
    image_px: float | None  # root mean square of the cells' means less what noise gives; None: too few sightings
    target_px: float | None  # the same of the rings' means, moved to the target and back to pixels
    shape: ShapeEffect | None  # what a target of another shape would change; None: cannot be told
    models: tuple[ModelApart, ...]
    reading: str = ""  # what else the observations are, as a sentence, if that explains all

    @property
    def is_of_target(self) -> bool:
        """Whether the target's points have most of the residuals in common in all photos, however it was held."""
        return self.target_px is not None and self.target_px > MOST_SHARE * self.rms_px

    @property
    def may_be_lens(self) -> bool:
        """Whether the lens is to blame as likely as the target for what is systematic.

        A target that bends also explains a part of what a model leaves over that does not fit the lens. But if it were
        the cause, bending would explain at least what is the same at a place in the image in all photos.
        """
        over_image, on_target = self.image_px or 0.0, self.target_px or 0.0
        if self.shape is None or over_image <= max(on_target, LEAST_SHARE * self.rms_px):
            return False
        return self.shape.explained < (over_image / self.rms_px) ** 2


@dataclass(frozen=True)
class ByCircles:
    """What a place in space may be off as nobody said what the points are."""

    doubt: CircleDoubt
    sigma_mm: float
    noise_mm: float  # by the noise alone
    away_mm: float  # from the camera


@dataclass(frozen=True, eq=False, kw_only=True)
class Evidence:
    """All that a verdict on C cameras rests on."""

    status: Status
    status_reason: str  # of a status other than converged
    frames: int
    cameras: tuple[CameraEvidence, ...]  # (C,)
    contradicted: tuple[str, ...] | None = None  # a word on each prior that the photos contradict; None: no priors

    @property
    def lens(self) -> LensEvidence | None:
        """Of the one camera that was solved by itself; None: it was solved with what moved it, or with others."""
        one = self.cameras[0]
        return one if isinstance(one, LensEvidence) else None

    @property
    def names(self) -> tuple[str, ...]:
        """Of the cameras.  # (C,)"""
        return tuple(one.name for one in self.cameras)


@dataclass(frozen=True, eq=False, kw_only=True)
class JointEvidence(Evidence):
    """Of several cameras, or of what moved one, also how places in space are known: as halves of the frames tell."""

    halves: RigHalves | NoHalves
    pairs: "tuple[PairFigures, ...]"
    ties: "tuple[CameraTie, ...]"  # (C,) or none
    middle: "MiddleError | None"  # None: no two cameras see the middle
    carrier: "MechanismFit | None"  # what carried the cameras or the target; None: nothing that says how
    carried: "CarriedError | None"  # None: no such, or more cameras than one
    delay_px: tuple[float, ...]  # (C,) what the delays' standard deviations move a sighting by; (): no delays
    by_circles: ByCircles | None = None  # None: what the points are is known


def lens_evidence(calibrations: Sequence[Calibration], best: int, halves: HalfSplit) -> LensEvidence:
    """Measure a camera that was solved by itself.

    Args:
        calibrations: of the same photos by different models.
        best: row of the one that is judged.
        halves: of that one.
    """
    judged = calibrations[best]
    seen, covered, evaluation = judged.observations, coverage_of(judged), evaluate(judged)
    views, errors, compared = seen.view_count, evaluation.of("reprojection"), halves_apart(halves, covered)
    if errors is None:
        raise ValueError("a calibration without reprojection errors cannot be judged")
    summary, cells = summarise(errors), cells_of_residuals(residuals_of(evaluation))
    far = deviations(judged.residual_px.T, seen.cov_px2) > FAR_OFF
    stated = None
    if seen.cov_px2 is not None and len(seen.cov_px2):
        stated = math.sqrt(float(np.trace(seen.cov_px2, axis1=1, axis2=2).mean()) / 2)
    return LensEvidence(
        name="", frames=views, sightings=summary.count, left_out=int(judged.is_outlier.sum()), rms_px=summary.rmse,
        times_stated=judged.scale / (1.0 if judged.weighted else stated) if stated else None, coverage=covered,
        model=judged.camera.model, halves=compared, uncertainty=uncertainty_of(judged, covered, compared.factor),
        stated_sigma_px=stated,
        far_share=float((far & ~judged.is_outlier).sum()) / max(len(far), 1),
        left_out_share=float(judged.is_outlier.sum()) / max(len(far), 1),
        image_px=_beyond_noise(cells.rms_of_means_px, cells.rms_by_noise_px),
        target_px=_on_target(evaluation.of("intersection"), summary.rmse), shape=shape_effect(judged, covered),
        models=tuple(_model_apart(judged, one, covered) for row, one in enumerate(calibrations) if row != best),
        reading=reading_of(judged),
    )  # fmt: skip


def evidence_of(calibration: Calibration, lens: LensEvidence) -> Evidence:
    """What a verdict on a camera that was solved by itself rests on."""
    reason = calibration.remarks[0] if calibration.remarks else ""
    return Evidence(
        status=calibration.status, status_reason=reason, frames=lens.frames, cameras=(lens,),
        contradicted=_contradicted(calibration),
    )  # fmt: skip


def _contradicted(one: Calibration) -> tuple[str, ...] | None:
    """What the photos say against a camera's priors, by noise alone as the solver does; None: nothing is known."""
    if not one.priors or one.status != "converged":
        return None
    sigma = dict(zip(one.camera.parameters, np.sqrt(np.diagonal(one.param_covariance)).tolist(), strict=True))
    return tuple(contradictions(one.priors, one.camera.parameters, sigma))


def uncertainty_of(calibration: Calibration, covered: Coverage, factor: float) -> Uncertainty:
    """How uncertain a camera is.

    Args:
        calibration: of it, with what its target may be off and what is fixed in the image if that is known.
        covered: by its sightings.
        factor: that halves of the photos enlarge the standard deviations of the noise by.
    """
    by_photo = calibration.photo_error
    if by_photo is not None:
        factor = 1.0  # both tell what differs between photos
    lit = lit_part(calibration)
    pixel = image_grid(calibration.camera.image_size).reshape(-1, 2)
    is_estimated = bool((np.diagonal(calibration.param_covariance) > 0).any())
    known = float(np.isfinite(rays(lit.camera, pixel[lit.is_lit(pixel)])).all(axis=1).mean())
    image = inside = noise = math.nan
    camera = calibration.camera
    by = dict.fromkeys(("target_error", "image_field", "capture_error", "photo_error", "circle_doubt"), 0.0)
    if is_estimated and np.isfinite(calibration.param_covariance).all():
        # Halves show what differs between photos; what target and lens are off is the same in all.
        covariance = factor**2 * calibration.param_covariance
        for name, part in calibration.errors.items():
            covariance = covariance + part.param_covariance
            by[name] = _if_known(sigma_over_lit_px(lit, part.param_covariance)) or 0.0
        image, noise = (sigma_over_lit_px(lit, one) for one in (covariance, calibration.param_covariance))
        inside = share_px(sigma_over(Known(camera, covariance), covered))
        if calibration.image_field is not None:  # no parameter follows what the model leaves of it
            left_px = calibration.image_field.left_px
            image, inside, by["image_field"] = (math.hypot(px, left_px) for px in (image, inside, by["image_field"]))
    is_exact = camera.learned is not None
    return Uncertainty(
        _if_known(image), _if_known(inside), _if_known(noise), by["target_error"], calibration.target_error, known,
        is_estimated, is_exact, factor, calibration.image_field, by["image_field"], calibration.capture_error,
        by["capture_error"], by_photo, calibration.circle_doubt, by["circle_doubt"],
    )  # fmt: skip


def _if_known(share: float) -> float | None:
    """What 95 % of a part of the image stays within; None if less of it is known."""
    return share if math.isfinite(share) else None


def _beyond_noise(rms: float, by_noise: float) -> float | None:
    """The part of a root mean square that noise does not explain; None if it is not known."""
    if not math.isfinite(rms) or not math.isfinite(by_noise):
        return None
    return math.sqrt(max(rms**2 - by_noise**2, 0.0))


def _on_target(errors: Errors | None, rmse_px: float) -> float | None:
    """Root mean square of what each ring is off on the target in all views, less what noise gives, in px."""
    if errors is None or errors.point is None:
        return None
    counted = errors.is_counted
    vector, point = errors.vector[counted], errors.point[counted]
    count = np.bincount(point)
    total = sums_by(point, vector, len(count))
    enough = count >= LEAST_PER_CELL
    freedom = len(point) - int((count > 0).sum())
    if not enough.any() or freedom <= 0:
        return None
    mean = total / np.maximum(count, 1)[:, None]
    variance = float(((vector - mean[point]) ** 2).sum()) / freedom
    rms = rms_length(mean[enough])
    by_noise = math.sqrt(variance * float((1 / count[enough]).mean()))
    rmse_mm = rms_length(vector)
    beyond = _beyond_noise(rms, by_noise)
    return None if beyond is None else beyond * rmse_px / rmse_mm if rmse_mm > 0 else 0.0


def _model_apart(judged: Calibration, other: Calibration, covered: Coverage) -> ModelApart:
    model, is_learned = other.camera.model, other.camera.learned is not None
    if other.status != "converged":
        return ModelApart(model, None, f"is {other.status}", 0.0, is_learned)
    found = apart(Known.exactly(judged.camera), Known.exactly(other.camera), covered)
    if found is None:
        return ModelApart(model, None, "is known nowhere in the covered area", 0.0, is_learned)
    shared = float(found.is_known.sum()) / max(int(found.is_covered.sum()), 1)
    return ModelApart(model, found.percentile_95_px, "", shared, is_learned, rms_px(other))


def rms_px(calibration: Calibration) -> float:
    """Root mean square length of the residuals that count; nan of none."""
    return rms_length(calibration.residual_px[~calibration.is_outlier])


def joint_evidence(found: "RigCalibration", halves: RigHalves | NoHalves) -> JointEvidence:
    """What a rig and halves of its frames tell."""
    from calib.judge.joint_halves import enlarged
    from calib.rigs.figures import pair_figures, ties_of
    from calib.rigs.relative import carried_error, middle_error

    told, seen, is_known = enlarged(found, halves), found.observations, found.status != "degenerate"
    return JointEvidence(
        status=found.status,
        status_reason=found.remarks[0] if found.remarks else "",
        frames=len(found.rig_from_target),
        cameras=tuple(
            CameraEvidence(
                name=name,
                frames=one.observations.view_count,
                sightings=int((~one.is_outlier).sum()),
                left_out=int(one.is_outlier.sum()),
                rms_px=rms_length(one.residual_px[~one.is_outlier]),
                times_stated=one.scale if one.weighted and one.observations.cov_px2 is not None else None,
                coverage=coverage_of(one) if is_refined else None,
            )
            for name, one, is_refined in zip(seen.camera_names, found.alone, found.is_refined, strict=True)
        ),
        pairs=pair_figures(told),
        ties=ties_of(told.rig, seen.shared),
        halves=halves,
        contradicted=_contradicted_together(found),
        middle=middle_error(told) if is_known else None,
        carrier=found.carrier,
        carried=carried_error(enlarged(found, halves, as_target=True)) if is_known else None,
        delay_px=_delay_px(told),
        by_circles=_by_circles(found),
    )


def _contradicted_together(found: "RigCalibration") -> tuple[str, ...] | None:
    """The same of all cameras of a rig."""
    said: list[str] | None = None
    rig = found.rig
    for row, (name, one) in enumerate(zip(found.observations.camera_names, found.alone, strict=True)):
        rows = rig.params_rows(row)
        own = _contradicted(replace(one, param_covariance=found.covariance[rows, rows]))
        if own is not None:
            said = [*(said or ()), *(f"{printable(name)}: {line}" for line in own)]
    return None if said is None else tuple(said)


def _by_circles(found: "RigCalibration") -> ByCircles | None:
    """The error of the carried target, or of a point in the middle, by that doubt and by noise."""
    from calib.rigs.relative import carried_error, middle_error

    doubt = found.circle_doubt
    if doubt is None or found.status == "degenerate":
        return None
    sigmas = []
    for covariance in (doubt.param_covariance, found.covariance):
        one = replace(found, covariance=covariance, target_covariance=None, circle_doubt=None)
        carried, middle = carried_error(one), middle_error(one)
        if carried is not None:
            away_mm, sigma_mm = carried.away_mm, carried.sigma_mm
        elif middle is not None:
            away_mm, sigma_mm = middle.away_mm, middle.rig_mm
        else:
            return None
        sigmas.append(sigma_mm)
    return ByCircles(doubt, sigmas[0], sigmas[1], away_mm)


def _delay_px(found: "RigCalibration") -> tuple[float, ...]:
    """Standard deviations of delays times how fast the target moved through each image, its median speed."""
    seen = found.observations
    if found.delay_sigma_s is None or seen.time_s is None:
        return ()
    moved = []
    for row, (camera, sigma) in enumerate(zip(found.cameras, found.delay_sigma_s.tolist(), strict=True)):
        place = transform(found.cam_from_rig[row] @ found.rig_from_target[seen.frame[row]], seen.points.middle_mm)
        step = np.linalg.norm(np.diff(project(camera, place), axis=0), axis=1)
        time = np.diff(seen.time_s[row])
        speed = step[time > 0] / time[time > 0]
        known = speed[np.isfinite(speed)]
        moved.append(sigma * float(np.median(known)) if len(known) else math.nan)
    return tuple(moved)
