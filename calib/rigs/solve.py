"""From what the cameras of a rig saw to where they stand, and how sure that is.

With a slack of each photo (`calib.rigs.problem`) a frame that was not taken at once spoils nothing but itself, and each
camera's lens comes from its own photos. Where these hardly tell it, as a small board far away, the lens is lost with
what the other cameras said of it: four webcams of others place corners 1.2 mm off with slacks, and .92 mm without. So
photos have slack where they do not fit together and each camera tells its lens by itself.

A camera with few photos takes up their noise with its lens, and two cameras then place what was not photographed many
times farther off than all others. Where another camera of the rig has the same model and image size, and nothing that
the photos say speaks against lenses of one kind, that one's lens is an observation of this one's, as good as such
lenses are alike.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.special import chdtrc

from calib.cameras import linearise, parameter_names, rays
from calib.cameras.refit import image_grid
from calib.core.linear_algebra import symmetric_inverse
from calib.core.parallel import one_thread_with_scipy
from calib.core.types import Observations, RigObservations, keep_photos
from calib.rigs.adjust import adjusted
from calib.rigs.problem import CameraChoice, RigOptions
from calib.rigs.result import RigCalibration, as_given
from calib.rigs.start import Alone, solve_alone, view_rms
from calib.rigs.turned_names import named_alike
from calib.rigs.variance_components import DISAGREES
from calib.solver.accuracy import projected_sigma_px
from calib.solver.calibration import Calibration
from calib.solver.circles import through_circles
from calib.solver.costs import IMAGE
from calib.solver.free_bend import require_bendable
from calib.solver.in_space import require_planes
from calib.solver.priors import ParameterPrior
from calib.solver.problem import SolveOptions
from calib.solver.solve import solve
from designer.base.arrays import Array, Flags
from designer.base.errors import InputError
from designer.base.words import figure, printable

FAR_OFF, MOST_OFF, FEWEST_LEFT = 3.5, 0.1, 4
"""Times what most photos of a camera leave over, from which on one is left out; the part of them that may be; and how
many have to be left."""
LINEAR_PART = 4
"""Parameters of any model before those of its distortion."""
ALIKE_FOCAL, ALIKE_CENTRE, ALIKE = 0.01, 0.015, 2.5e-3
"""Standard deviations by which lenses of one kind differ: focal lengths, as parts of these; the principal point, as
parts of the image's longer side; and by each other parameter at the border of the image, likewise."""
UNLIKELY = 1e-3
"""Probability of a difference between two lenses, from which on they are not taken as of one kind."""
FAR_APART = 3.0
"""Standard deviations of a single parameter's difference, likewise."""
SURE = 3e-3
"""Standard deviation of a focal length, as a part of it, from which on a camera's own photos tell its lens."""


@dataclass(frozen=True, eq=False)
class _RigTask:
    """What is to be solved, and how."""

    observations: RigObservations
    choices: Sequence[CameraChoice]
    options: RigOptions

    @cached_property
    def alone(self) -> tuple[Alone, ...]:
        """Each camera by itself."""
        seen = self.observations
        return tuple(map(self.one_alone, seen.sightings, seen.camera_names, self.choices))

    def one_alone(self, seen: Observations, name: str, choice: CameraChoice) -> Alone:
        """One of them, or as if it were another choice."""
        return solve_alone(seen, name, choice, self.options)


@one_thread_with_scipy
def solve_rig(
    observations: RigObservations, choices: Sequence[CameraChoice], options: RigOptions | None = None
) -> RigCalibration:
    """`solve_rig(observations, [CameraChoice("opencv")] * 4).cam_from_rig`.

    Each camera is solved alone, frames that two saw join them, and Levenberg-Marquardt over all parameters, places and
    frames, these eliminated block by block, gives the most likely rig. What an observation of each camera is worth is
    estimated with it. The result does not depend on the order of frames or cameras but for rounding.

    Args:
        observations: what was seen; each view has a sighting.
        choices: how each camera is to be solved (C,).
        options: weights, losses, what carries the target.

    Raises:
        InputError: a camera cannot be solved, or not in space, no frames join some cameras to the others, frames of
            one would have to be shifted to fit, or options that do not fit.
    """
    task = _RigTask(observations, choices, options or RigOptions())
    if observations.points.turned is not None and (observations.camera_count > 1 or task.options.carrier is not None):
        observations = named_alike(observations, [one.cam_from_target for one in task.alone], task.options.carrier)
    found, said = through_circles(
        observations.sightings,
        lambda seen: _solved(replace(task, observations=replace(observations, sightings=tuple(seen)))),
        lambda rig: rig.alone,
    )
    return replace(found, remarks=(*found.remarks, *said)) if said else found


def _solved(task: _RigTask) -> RigCalibration:
    """The rig from points as they are given."""
    _check(task.observations, task.choices, task.options)
    rms = [
        one.view_rms if one.view_rms is not None else np.full((len(one.cam_from_target), 2), np.nan)
        for one in task.alone
    ]
    if is_off := _far_off(task.observations, rms):
        return _solved_without(is_off, rms, task)
    found = _of_all(task, task.alone)
    if task.options.carrier is not None or found.status != "converged" or len(found.cameras) < 2:
        return found
    used = as_given(found)
    rms = [view_rms(seen, left) for seen, left in zip(used.sightings, found.residual_px, strict=True)]
    if not (is_off := _far_off(used, rms)):
        return _with_lenses_alike(found, task)
    is_off = _worst_of_frames(used, is_off, rms)
    again = _solved_without(is_off, rms, replace(task, observations=used))
    return again if again.status == "converged" else found


def _of_all(task: _RigTask, alone: Sequence[Alone]) -> RigCalibration:
    """The rig of all photos, with slack of single ones where they do not fit together."""
    options = task.options
    if options.allows_offsets is not None or options.carrier is not None:
        allows = options.allows_offsets is not False
        return _settled(replace(task, options=replace(options, allows_offsets=allows)), alone)
    found = _settled(replace(task, options=replace(options, allows_offsets=False)), alone)
    if found.alone_scale is None or not (found.scale > DISAGREES * found.alone_scale).any():
        return found
    if not all(_tells_its_lens(*one) for one in zip(task.observations.sightings, task.choices, alone, strict=True)):
        return found
    return adjusted(task.observations, replace(options, allows_offsets=True), [alone])


def _with_lenses_alike(found: RigCalibration, task: _RigTask) -> RigCalibration:
    """The rig with lenses that its photos leave open near the surest other one of their kind; as it was if none is."""
    observations, open_px = task.observations, []
    for number, one in enumerate(found.cameras):
        own, pixel = found.rig.params_rows(number), image_grid(one.image_size).reshape(-1, 2)
        sigma_px = projected_sigma_px(one, found.covariance[own, own], pixel)
        open_px.append(float(np.median(np.nan_to_num(sigma_px, nan=max(one.image_size)))))
    wanted, begun, said = list(task.choices), list(task.alone), []
    for number, (one, choice) in enumerate(zip(found.cameras, task.choices, strict=True)):
        if not choice.is_refined or choice.priors or open_px[number] <= ALIKE * max(one.image_size):
            continue
        like = [
            (open_px[row], row)
            for row, other in enumerate(found.cameras)
            if other.model == one.model and other.image_size == one.image_size and open_px[row] < open_px[number] / 2
        ]
        if not like or len(one.params) != len(parameter_names(one.model)):
            continue
        row, name = min(like)[1], observations.camera_names[number]
        priors = _priors_from(found, number, row)
        if not priors:
            continue
        start = task.one_alone(observations.sightings[number], name, replace(choice, given=found.cameras[row]))
        wanted[number] = replace(choice, priors=priors)
        begun[number] = replace(
            begun[number], camera=start.camera, cam_from_target=start.cam_from_target, priors=priors
        )
        said.append(
            f"{printable(name)}: its photos leave its lens open ({open_px[number]:.2g} px over half of the image), so "
            f"it is held as near to that of {printable(observations.camera_names[row])} as lenses of one kind are: "
            "take more photos with it, or give what is known (--prior)"
        )
    if not said:
        return found
    again = _of_all(replace(task, choices=wanted), begun)
    return replace(again, remarks=(*said, *again.remarks)) if again.status == "converged" else found


def _priors_from(found: RigCalibration, camera: int, other: int) -> tuple[ParameterPrior, ...]:
    """What another lens of one kind tells of a camera's; nothing if the two differ by more than chance and kind do."""
    one, like = found.cameras[camera], found.cameras[other]
    ray = rays(like, image_grid(like.image_size).reshape(-1, 2))
    by_params = linearise(like, np.ascontiguousarray(ray[np.isfinite(ray).all(axis=1)].T)).by_params
    width = max(like.image_size)
    scatter = ALIKE * width / np.nanpercentile(np.hypot(*by_params), 95, axis=1)
    scatter[:LINEAR_PART] = *ALIKE_FOCAL * like.params[:2], ALIKE_CENTRE * width, ALIKE_CENTRE * width
    own, its = found.rig.params_rows(camera), found.rig.params_rows(other)
    covariance = found.covariance[own, own] + found.covariance[its, its] + np.diag(scatter**2)
    covariance -= found.covariance[own, its] + found.covariance[its, own]
    sigma = np.hypot(scatter, np.sqrt(np.diagonal(found.covariance)[its]))
    free = np.flatnonzero(np.diagonal(found.covariance)[own] > 0)
    off = (one.params - like.params)[free]
    among = covariance[np.ix_(free, free)]
    square = off @ symmetric_inverse(among).inverse @ off
    if chdtrc(len(free), square) < UNLIKELY or (np.abs(off) > FAR_APART * np.sqrt(np.diagonal(among))).any():
        return ()
    names = parameter_names(one.model)
    return tuple(ParameterPrior(names[k], float(like.params[k]), float(sigma[k])) for k in free.tolist())


def _far_off(observations: RigObservations, rms: Sequence[Array]) -> tuple[Flags, ...]:
    """Single photos (C,) of (V_c,) that fit far worse than most of their camera's; none if there are many such."""
    is_off = tuple(
        np.nan_to_num(one[:, 0]) > FAR_OFF * (np.nanmedian(one[:, 0]) if np.isfinite(one).any() else np.inf)
        for one in rms
    )
    few = all(off.sum() <= MOST_OFF * len(off) and len(off) - off.sum() >= FEWEST_LEFT for off in is_off if off.any())
    return is_off if few and any(off.any() for off in is_off) else ()


def _worst_of_frames(observations: RigObservations, is_off: Sequence[Flags], rms: Sequence[Array]) -> tuple[Flags, ...]:
    """Of each frame that has such a photo the worst; both if two cameras alone see it: which is wrong nobody knows."""
    worst, seen_by = np.zeros(observations.frame_count), np.zeros(observations.frame_count, dtype=np.int64)
    for frames, off, own in zip(observations.frame, is_off, rms, strict=True):
        seen_by[frames] += 1
        worst[frames[off]] = np.maximum(worst[frames[off]], own[off, 1])
    return tuple(
        (off & (own[:, 1] == worst[frames])) | ((worst > 0) & (seen_by == 2))[frames]
        for frames, off, own in zip(observations.frame, is_off, rms, strict=True)
    )


def _solved_without(is_off: Sequence[Flags], rms: Sequence[Array], task: _RigTask) -> RigCalibration:
    """The rig without some photos, which are named."""
    observations, remarks = task.observations, []
    for name, seen, off, own in zip(observations.camera_names, observations.sightings, is_off, rms, strict=True):
        remarks += [
            f"{printable(name)}, {printable(seen.view_names[row])}: left out: {figure(own[row, 1], 2)} px RMS, most of "
            f"its photos {figure(float(np.nanmedian(own[:, 1])), 2)} px: is it a false detection, or of another moment?"
            for row in np.flatnonzero(off).tolist()
        ]
    kept = keep_photos(observations, [~off for off in is_off])
    found = solve_rig(kept, task.choices, task.options)
    return replace(found, remarks=(*remarks, *found.remarks))


def _check(observations: RigObservations, choices: Sequence[CameraChoice], options: RigOptions) -> None:
    """Refuse what does not fit together."""
    for seen in observations.sightings:
        require_planes(options.minimise, seen.points, seen.point)
    if options.free_bend:
        require_bendable(observations.points, options.minimise)
    if len(choices) != observations.camera_count:
        raise ValueError("a choice for each camera is needed")
    if not 0 <= options.reference < observations.camera_count:
        raise InputError(f"reference {options.reference}: the rig has cameras 0 to {observations.camera_count - 1}")
    carrier = options.carrier
    if carrier is not None and len(carrier.rig_from_mechanism) != observations.frame_count:
        raise ValueError("a pose of the carrier for each frame is needed")
    if options.minimise != IMAGE and any(one.priors for one in choices):
        raise InputError(f"--prior: goes with distances in the image only; leave --minimise {options.minimise} out")
    if options.estimates_delays and observations.time_s is None:
        raise InputError("time offsets need time stamps; give each photo's, or leave the offsets out")


def _settled(task: _RigTask, alone: Sequence[Alone]) -> RigCalibration:
    """The most likely rig of the starts that there are; if that ends short of a minimum, from lenses of no distortion.

    Cameras whose own photos leave their lenses open begin with wild ones, which of them by chance: the order of photos
    decides. So a second start has the lens of the camera that tells it best in their place.
    """
    is_open = [one.solved is not None and one.solved.status != "converged" for one in alone]
    starts = [alone]
    if task.options.carrier is None and any(is_open):
        starts.append(_begun_anew(is_open, task, alone))
    found = adjusted(task.observations, task.options, starts)
    if found.status != "stopped":
        return found
    is_free = [choice.is_refined for choice in task.choices]
    try:
        again = adjusted(task.observations, task.options, [_begun_anew(is_free, task, alone)])
    except InputError:
        return found
    return again if again.status == "converged" else found


def _begun_anew(anew: Sequence[bool], task: _RigTask, alone: Sequence[Alone]) -> list[Alone]:
    """The start with other lenses of some cameras: that of the surest other one of their kind, else no distortion."""
    observations, choices, start = task.observations, task.choices, list(alone)
    for number in np.flatnonzero(anew).tolist():
        seen, choice, own = observations.sightings[number], choices[number], alone[number]
        like = [
            (_focal_sigma(one.solved), one.camera)
            for other, one in enumerate(alone)
            if one.solved is not None and not anew[other] and choices[other] == choice and not choice.fixed
            and one.camera.image_size == own.camera.image_size
        ]  # fmt: skip
        lens = replace(choice, given=min(like, key=lambda pair: pair[0])[1]) if like else _without_lens(choice)
        begun = task.one_alone(seen, observations.camera_names[number], lens)
        start[number] = replace(own, camera=begun.camera, cam_from_target=begun.cam_from_target)
    return start


def _without_lens(choice: CameraChoice) -> CameraChoice:
    """The same with all but focal lengths and centre as they begin."""
    kept = {name for name, _ in choice.fixed} | {one.name for one in choice.priors}
    more = tuple((name, None) for name in parameter_names(choice.model)[LINEAR_PART:] if name not in kept)
    return replace(choice, fixed=(*choice.fixed, *more))


def _tells_its_lens(seen: Observations, choice: CameraChoice, one: Alone) -> bool:
    """Whether a camera's own photos do."""
    if choice.given is not None and not choice.is_refined:
        return True
    try:
        alone = one.solved or solve(seen, choice.model, SolveOptions(fixed=choice.fixed, priors=choice.priors))
    except InputError:
        return False
    return alone.status == "converged" and _focal_sigma(alone) <= SURE


def _focal_sigma(alone: Calibration) -> float:
    """The larger standard deviation of the two focal lengths, as a part of them."""
    sigma = np.sqrt(np.diagonal(alone.param_covariance)[:2]) / np.abs(alone.camera.params[:2])
    return float(np.nan_to_num(sigma, nan=np.inf).max())
