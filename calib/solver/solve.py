"""The solution: from observations, without prior knowledge, to a calibration."""

import time
from dataclasses import dataclass, replace

import numpy as np

from calib.cameras import MODELS, parameter_names
from calib.cameras.camera import Camera
from calib.cameras.surface import SurfaceModel, surface_model
from calib.core.types import Observations, keep_views
from calib.solver.accuracy import Accuracy, UndeterminedError, accuracy_of, long_lens_remedy, why_degenerate
from calib.solver.calibration import TERMS, Breathing, Calibration, PhotoSession, Status, plane_bend
from calib.solver.circles import with_circles
from calib.solver.costs import IMAGE
from calib.solver.descend import (
    Descended,
    descend,
    descend_again,
    descend_displaced,
    is_robust,
    shrunk,
    with_variance,
    without_lens,
)
from calib.solver.free_bend import NOT_TOLD, bend_sigma_mm, of_parameters, require_bendable, with_bend
from calib.solver.in_space import descend_in_space, require_planes
from calib.solver.outliers import shifted_photo, variance_power, whitened
from calib.solver.priors import contradictions
from calib.solver.problem import (
    Problem,
    SolveOptions,
    Tie,
    pack,
    prior_of,
    target_covariance,
    target_poses,
    tie_parameters,
)
from calib.solver.start import FirstPoses, coarse_camera, first_poses, turned_over
from calib.solver.varying import FOCAL, sessions_of, with_breathing, with_sessions
from designer.base.arrays import Array, Flags
from designer.base.errors import InputError

FAR_OFF = 6.0
FIRST_PX2 = 0.1**2
"""Variance of a coordinate that priors count by until photos that tell no camera without them tell theirs."""
MOST_SAID = 8
TURNS = 4
"""Of descending again with poses turned over that are better so."""


def solve(
    observations: Observations, model: str, options: SolveOptions | None = None, *, noise_px2: Array | None = None
) -> Calibration:
    """Solve a camera and the poses of all views.

    Levenberg-Marquardt on the distances in the image, from linear equations (homographies of planar views, direct
    linear transforms of others) as the start, and from there on the distances in space if `options.minimise` names
    them. The result does not depend on the order of the views but for rounding.

    Args:
        observations: what was seen; every view has four points or more that are not on a line.
        model: a camera model that is its parameters alone.
        options: weights, losses, fixed and shared parameters.
        noise_px2: of the observations (M, 2, 2), by which it is told what is far off, and which stand whatever the
            residuals say; None: the covariances they have, which may also stand for weights.

    Raises:
        InputError: fewer equations than unknowns, no view whose pose can be found, or options that do not fit.
    """
    begin = time.perf_counter()
    options = options or SolveOptions()
    _check(options)
    surface = surface_model(model)
    if surface is not None:
        from calib.solver.surface import require_image

        require_image(surface, options)
        if options.breathing_mm is not None or options.vary:
            raise InputError(
                f"--breathing, --vary: model {model} follows any lens; give another, as {surface.base.name}"
            )
        if options.priors:
            raise InputError(f"--prior: model {model} follows any lens; give it with another, as {surface.base.name}")
    if options.free_bend:
        require_bendable(observations.points, options.minimise)
    return with_circles(observations, lambda seen: _solved(seen, model, options, noise_px2, begin))


def _solved(
    observations: Observations, model: str, options: SolveOptions, noise_px2: Array | None, begin: float
) -> Calibration:
    """The solution from points as they are given."""
    surface = surface_model(model)
    require_planes(options.minimise, observations.points, observations.point)
    lens = model if surface is None else surface.base.name
    noise = observations.cov_px2 if noise_px2 is None else noise_px2
    photos = _Photos.of(observations, tie_parameters(model, options), options, noise)
    start, robust = _at_priors(model, options), is_robust(options)
    camera = coarse_camera(photos.problem, lens, start.row, start.value, options.focal_px, is_robust=robust)
    first = _poses(photos, camera)
    if not first.found.any():
        raise InputError("no view has a pose that shows its points; check that points and pixels belong together")
    remarks = _left_out(observations, first.found)
    if remarks:
        photos = photos.of_views(first.found)
    poses = first.cam_from_target[first.found]
    down = _down(photos, camera, poses, surface)
    while (is_lost := down.descended.is_lost).any() and not is_lost.all():
        remarks += _lost(photos.observations, down.descended)
        photos, poses = photos.of_views(~is_lost), poses[~is_lost]
        down = _down(photos, camera, poses, surface)
    if not down.descended.is_used.any():
        raise InputError(
            f"model {model} shows none of the {len(photos.observations.view)} observations together with the others; "
            "check that points and pixels belong together, or give another --model"
        )
    if noise_px2 is None:
        photos, down = _weighed(photos, down)
    if len(down.problem.amount) and not len(down.problem.shifts) and down.surface_accuracy is None:
        found = shrunk(down.problem, down.descended, photos.tie, options, photos.noise_px2)
        down = replace(down, descended=found, lens=found)
    return _calibration(photos, down, remarks, time.perf_counter() - begin)


@dataclass(frozen=True, eq=False)
class _Photos:
    """What a camera is solved from, and how."""

    observations: Observations
    problem: Problem
    tie: Tie
    options: SolveOptions
    noise_px2: Array | None  # (M, 2, 2) by which it is told what is far off

    @classmethod
    def of(cls, observations: Observations, tie: Tie, options: SolveOptions, noise_px2: Array | None) -> "_Photos":
        """Packed; fewer equations than unknowns are refused, of some of which something is known."""
        problem = pack(observations, weighted=options.weighted)
        unknowns = int(tie.row.max(initial=-1)) + 1 + 6 * problem.view_count - len(options.priors)
        equations = 2 * int(problem.is_used.sum())
        if equations < unknowns or problem.view_count == 0:
            views = f"{problem.view_count} view{'s' * (problem.view_count != 1)}"
            raise UndeterminedError(
                f"{equations // 2} observations in {views}: too few for {unknowns} unknowns; take more photos, or fix "
                "parameters"
            )
        return cls(observations, problem, tie, options, noise_px2)

    def of_views(self, keep: Flags) -> "_Photos":
        """Some of them."""
        noise = None if self.noise_px2 is None else self.noise_px2[keep[self.observations.view]]
        return _Photos.of(keep_views(self.observations, keep), self.tie, self.options, noise)


def _weighed(photos: _Photos, down: "_Down") -> tuple[_Photos, "_Down"]:
    """The same with observations weighed by what their residuals say of stated sigmas, and the minimum there."""
    options, cov, found = photos.options, photos.observations.cov_px2, down.descended
    is_plain = options.loss == "squares" and options.minimise == IMAGE and down.surface_accuracy is None
    if cov is None or not options.weighted or not is_plain or not found.minimum.converged:
        return photos, down
    problem = down.problem
    square = (whitened(problem.whitener, found.minimum.blocks.residual_px) ** 2).sum(axis=0)
    size = -0.5 * np.log(problem.whitener[0] * problem.whitener[2])
    unknowns = int(photos.tie.row.max(initial=-1)) + 1 + 6 * problem.view_count
    factor = variance_power(square, size, found.is_used, unknowns)
    if factor is None:
        return photos, down
    problem = replace(problem, whitener=problem.whitener / factor)
    observations = replace(photos.observations, cov_px2=factor[:, None, None] ** 2 * cov)
    again = descend_again(problem, found, photos.tie, options)
    photos = replace(photos, observations=observations, problem=problem)
    return photos, replace(down, problem=problem, descended=again, lens=again)


@dataclass(frozen=True, eq=False)
class _Down:
    """A minimum, and the one by whose equations it is told whether the photos determine the camera."""

    problem: Problem  # with all unknowns
    descended: Descended
    lens: Descended  # the same, or that of the base of a surface
    lens_accuracy: Accuracy | None = None  # None: by its equations
    surface_accuracy: Accuracy | None = None
    remarks: tuple[str, ...] = ()


def _down(photos: _Photos, camera: Camera, poses: Array, surface: SurfaceModel | None) -> _Down:
    """Down to the minimum in the image, and from there to that in space or with a surface if this is asked for."""
    observations, problem, tie, options = photos.observations, photos.problem, photos.tie, photos.options
    noise_px2 = photos.noise_px2
    if surface is not None:
        from calib.solver.surface import bend, require_points, without_rejection

        forgiving = without_rejection(options)
        lens = descend(problem, camera, poses, tie, forgiving, noise_px2)
        problem, lens, said = _with_more(replace(photos, options=forgiving), lens)
        if lens.is_lost.any():
            return _Down(problem, lens, lens)
        require_points(problem, surface)
        smooth, accuracy = bend(problem, lens, surface, tie, options, noise_px2)
        return _Down(problem, smooth, lens, surface_accuracy=accuracy, remarks=said)
    known = problem
    if options.priors:
        variance = 1.0 if options.weighted and observations.cov_px2 is not None else FIRST_PX2
        known = replace(problem, prior=prior_of(options.priors, parameter_names(camera.model), variance))
    lens = descend(problem, camera, poses, tie, options, noise_px2)
    # Photos that determine a camera without what is known of it tell their noise whatever that is.
    is_there = lens.minimum.converged and not lens.is_lost.any()
    if options.priors and not (is_there and not _why_open(photos, lens)):
        problem, lens = known, descend(known, camera, poses, tie, options, noise_px2)
    for _ in range(TURNS):  # a long lens tells the two poses of a plane apart only when it is nearly known
        camera, poses = lens.minimum.camera, lens.minimum.cam_from_target
        turned = None if lens.is_lost.any() else turned_over(problem, camera, poses, is_robust=is_robust(options))
        if turned is None:
            break
        again = descend(problem, camera, turned, tie, options, noise_px2)
        if not again.minimum.blocks.cost.sum() < lens.minimum.blocks.cost.sum():
            break
        lens = again
    problem, lens, said = _with_more(replace(photos, problem=known), lens)
    found = descend_in_space(problem, observations.points, observations.point, lens, tie, options, noise_px2)
    if found is None:
        return _Down(problem, lens, lens, remarks=said)
    descended, accuracy, remark = found
    return _Down(problem, descended, descended, accuracy, remarks=(remark,))


def _at_priors(model: str, options: SolveOptions) -> Tie:
    """The free parameters to start with, where those are kept of which something is known."""
    alike = {name: group for group in options.shared for name in group}
    kept = {name: one.value for one in options.priors for name in alike.get(one.name, (one.name,))}
    shared = tuple(group for group in options.shared if not kept.keys() & set(group))
    return tie_parameters(model, replace(options, fixed=(*options.fixed, *kept.items()), shared=shared, priors=()))


def _with_more(photos: _Photos, flat: Descended) -> tuple[Problem, Descended, tuple[str, ...]]:
    """The problem with what is known, and the target's bend if it is to be an unknown, its minimum, and a word on that.

    Where photos hardly tell the camera, a bend would take from it what they do.
    """
    observations, problem, tie, options = photos.observations, photos.problem, photos.tie, photos.options
    noise_px2, varies = photos.noise_px2, options.breathing_mm is not None or bool(options.vary)
    if not (options.free_bend or options.priors or varies) or flat.is_lost.any():
        return problem, flat, ()
    said: tuple[str, ...] = ()
    if options.free_bend and not _why_open(photos, flat):
        bent = with_bend(problem, observations, options, len(tie.row))
        found = descend_displaced(bent, flat, tie, options, noise_px2)
        if found.is_lost.any() or _why_open(replace(photos, problem=bent), found):
            said = (NOT_TOLD,)
        elif varies:
            problem = bent
        else:
            return with_variance(bent, found, tie, options), found, ()
    if options.breathing_mm is not None:
        return *with_breathing(problem, flat, tie, options, options.breathing_mm, noise_px2), said
    if options.vary:
        return *with_sessions(problem, flat, tie, options, observations.view_names, noise_px2), said
    if options.priors:
        return problem, descend_displaced(problem, flat, tie, options, noise_px2), said
    return problem, flat, said


def _accuracy_at(problem: Problem, found: Descended, tie: Tie) -> Accuracy:
    """Of amounts of displacements, the camera's parameters, and the poses, at a minimum in the image."""
    blocks = found.minimum.blocks
    return accuracy_of(blocks.products, problem.rows(tie.row), int(found.is_used.sum()), found.robust, blocks.prior)


def _why_open(photos: _Photos, found: Descended) -> str:
    """Why a minimum determines no camera; "" if it does."""
    accuracy = of_parameters(_accuracy_at(photos.problem, found, photos.tie), len(found.minimum.amount))
    return why_degenerate(photos.observations, found.minimum, found.sigma_px, accuracy, photos.tie)


def _check(options: SolveOptions) -> None:
    """Refuse numbers that mean nothing."""
    if options.reject_sigma is not None and not 0 < options.reject_sigma < np.inf:
        raise InputError(f"reject {options.reject_sigma:g}: give more than 0 standard deviations, such as 4")
    if options.priors and options.minimise != IMAGE:
        raise InputError(f"--prior: goes with distances in the image only; leave --minimise {options.minimise} out")
    varied = "--breathing" if options.breathing_mm is not None else "--vary" if options.vary else ""
    if options.breathing_mm is not None and options.vary:
        raise InputError("--breathing, --vary: are not solved together; leave one of them out")
    if varied and options.minimise != IMAGE:
        raise InputError(f"{varied}: goes with distances in the image only; leave --minimise {options.minimise} out")
    differ = {"fx", "fy", *options.vary} if FOCAL in options.vary else set(options.vary)
    told = [(f"--prior {one.text}", one.name) for one in options.priors]
    told += [(f"--fix {name}" + ("" if value is None else f"={value:g}"), name) for name, value in options.fixed]
    if (known := next((text for text, name in told if name.removesuffix("_px") in differ), None)) is not None:
        raise InputError(
            f"{known}: with --vary {','.join(options.vary)} it differs between sessions, and no one value "
            "of it is known; leave one of them out"
        )
    if options.focal_px is not None and not 0 < options.focal_px < np.inf:
        raise InputError(f"focal length {options.focal_px:g} px: must be more than 0")


def _poses(photos: _Photos, camera: Camera) -> FirstPoses:
    """First poses; where the first camera's lens has no rays for a view, those without a lens."""
    robust = is_robust(photos.options)
    first = first_poses(photos.problem, camera, is_robust=robust)
    if first.found.all():
        return first
    plain = first_poses(photos.problem, without_lens(camera, photos.tie), is_robust=robust)
    poses = np.where(first.found[:, None, None], first.cam_from_target, plain.cam_from_target)
    return FirstPoses(poses, first.found | plain.found)


def _calibration(photos: _Photos, down: _Down, remarks: list[str], seconds: float) -> Calibration:
    observations, problem, tie, options = photos.observations, photos.problem, photos.tie, photos.options
    descended, lens, remarks = down.descended, down.lens.minimum, [*down.remarks, *remarks]
    found, is_used, accuracy = descended.minimum, descended.is_used, down.lens_accuracy
    amounts, products = len(found.amount), lens.blocks.products
    if accuracy is None:
        accuracy = _accuracy_at(down.problem, down.lens, tie)
    joint = (down.surface_accuracy or accuracy).param_covariance
    heights_mm2 = joint[:amounts, :amounts]
    accuracy = of_parameters(accuracy, amounts)
    reason = why_degenerate(observations, lens, down.lens.sigma_px, accuracy, tie)
    status: Status = "degenerate" if reason else "converged" if found.converged else "stopped"
    if reason:
        remarks = [reason, *remarks]
    elif not found.converged:
        remedy = long_lens_remedy(found.camera, tie)
        said = f"stopped after {found.iterations} steps, short of the minimum" + (f": {remedy}" if remedy else "")
        remarks = [said, *remarks]
    else:
        sigma = np.sqrt(np.diagonal(accuracy.param_covariance)).tolist()
        told = dict(zip(parameter_names(lens.camera.model), sigma, strict=True))
        remarks = [*contradictions(options.priors, found.camera.parameters, told), *remarks]
        remarks = [*remarks, *shifted_photo(products[:, amounts:, amounts:], tie, observations.view_names)]
    if down.surface_accuracy is not None:
        accuracy = of_parameters(down.surface_accuracy, amounts)
    if reason and down.surface_accuracy is not None:
        accuracy = replace(accuracy, param_covariance=np.full_like(accuracy.param_covariance, np.nan))
    beyond, left_out = descended.is_beyond, int((~is_used & ~descended.is_beyond).sum())
    remarks = [*remarks, *_beyond(observations, descended)]
    if not is_robust(options):
        remarks = [*remarks, *far_off(observations, found.blocks.residual_px, descended.deviation)]
    if left_out:
        views = len(np.unique(observations.view[~is_used & ~beyond]))
        limit = f"beyond {options.reject_sigma:g} robust standard deviations"
        remarks = [*remarks, f"{left_out} of {len(is_used)} observations in {views} views left out: {limit}"]
    bend, own = None, TERMS if down.problem.modes_mm[:TERMS].any() else 0
    if own:
        sigma_mm = bend_sigma_mm(observations.points, options.bend_sigma_mm)
        bend = plane_bend(observations.points).told(found.amount[:TERMS], heights_mm2[:TERMS, :TERMS], sigma_mm)
        observations, remarks = bend.bent(observations), [bend.sentence, *remarks]
    breathing: Breathing | None = None
    sessions: tuple[PhotoSession, ...] = ()
    camera, linear = found.camera, down.problem.at(found.amount).linear(found.camera)
    if options.breathing_mm is not None and amounts > own:
        breathing = Breathing(float(found.amount[own]), float(np.sqrt(joint[own, own])), options.breathing_mm)
        remarks = [breathing.sentence, *remarks]
    if options.vary and amounts > own:
        sessions, camera, covariance = sessions_of(
            camera, down.problem, options, observations.view_names, found.amount[own:], joint[own:, own:]
        )
        accuracy = replace(accuracy, param_covariance=covariance)
        more = [f"{len(sessions) - MOST_SAID} more sessions are in calibration.json"] * (len(sessions) > MOST_SAID)
        remarks = [*(one.told(camera) for one in sessions[:MOST_SAID]), *more, *remarks]
    return Calibration(
        camera=camera, observations=observations, cam_from_target=target_poses(problem, found.cam_from_target),
        residual_px=found.blocks.residual_px.T, is_outlier=~is_used, scale=accuracy.scale,
        param_covariance=accuracy.param_covariance,
        pose_covariance=target_covariance(problem, found.cam_from_target, accuracy.pose_covariance), fixed=tie.fixed,
        weighted=options.weighted and observations.cov_px2 is not None, status=status, remarks=tuple(remarks),
        iterations=found.iterations, seconds=seconds, target_bend=bend, linear=linear, breathing=breathing,
        sessions=sessions, priors=options.priors,
    )  # fmt: skip


def _beyond(observations: Observations, descended: Descended) -> list[str]:
    """A word on observations that the model does not show."""
    beyond = descended.is_beyond
    if not beyond.any():
        return []
    model = MODELS[descended.minimum.camera.model]
    return [
        f"{int(beyond.sum())} of {len(beyond)} observations in {len(np.unique(observations.view[beyond]))} views lie "
        f"beyond what the {model.name} model can show together with the others, and are left out; {model.remedy}"
    ]


def far_off(seen: Observations, residual_px: Array, deviation: Array) -> list[str]:
    """A word on observations that noise does not explain, if they were neither left out nor weighed down.

    By residuals (2, M), and their lengths in robust standard deviations (M,).
    """
    far = np.flatnonzero(deviation > FAR_OFF)
    if not len(far):
        return []
    worst = int(far[np.argmax(deviation[far])])
    off = float(np.hypot(*residual_px[:, worst]))
    return [
        f"{len(far)} of {len(deviation)} observations are off by more than {FAR_OFF:g} robust standard deviations, the "
        f"worst by {off:.3g} px in {seen.view_names[seen.view[worst]]}; look at them, or reject them"
    ]


def _left_out(observations: Observations, found: Flags) -> list[str]:
    """What to say of views without a pose."""
    return [
        f"{observations.view_names[view]}: left out: no pose shows its points where they were seen"
        for view in np.flatnonzero(~found).tolist()
    ]


def _lost(observations: Observations, descended: Descended) -> list[str]:
    """What to say of views of which too little counts."""
    beyond = np.bincount(observations.view[descended.is_beyond], minlength=observations.view_count) > 0
    return [
        f"{observations.view_names[view]}: left out: nearly all of its observations are outliers"
        + (" or lie beyond what the model can show" if beyond[view] else "")
        for view in np.flatnonzero(descended.is_lost).tolist()
    ]
