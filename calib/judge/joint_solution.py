"""A rig from what its cameras saw: how each lens is to be solved, all solved together, and judged.

A camera in a robot's hand, or beside the robot that holds the target: one adjustment with the robot's own errors.
"""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import cast

import numpy as np

from calib.cameras import COMMON, MODELS, free_form_models, learned_models, parameter_names, told_parameters
from calib.cameras.camera import Camera
from calib.cameras.rig import ALONE
from calib.core.se3 import invert, steps_between
from calib.core.types import Observations, RigObservations, keep_views
from calib.judge.folders import RigRun
from calib.judge.halves import RigHalves
from calib.judge.joint_halves import half_solver, rig_halves
from calib.judge.judge import judge_rig
from calib.judge.solutions import SolveTask, best_of, compared, solve_models
from calib.judge.verdict import Criteria
from calib.observe.calibration_file import Provenance
from calib.observe.rig_observations import alone_as_rig, with_remarks
from calib.observe.rig_search import RigSearch
from calib.observe.robot_poses import AROUND_S, STILL_MM, RobotPoses, poses_of, stream_times
from calib.rigs.accuracy import with_circle_doubt
from calib.rigs.pose_pairs import solve_pose_streams
from calib.rigs.problem import FREE_SIZE, CameraChoice, Mechanism, RigOptions
from calib.rigs.result import RigCalibration
from calib.rigs.robot_readings import why_size, why_wrong
from calib.rigs.shared_errors import with_shared_errors
from calib.rigs.solve import solve_rig
from calib.rigs.start import solve_alone
from calib.rigs.target_error import with_target_error
from calib.rigs.turned_names import named_alike
from calib.solver.plan import ALL, SolvePlan, models_of, plan_from_words
from calib.solver.priors import full_name, is_prior
from calib.solver.problem import SolveOptions
from designer.base.answer import program
from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.base.words import figure, several, shown, suggestion
from designer.page.progress import Progress
from designer.target import TargetGeometry
from designer.tolerance.made import Made, how_made

EXAMPLES = {"--fix": "k3=0", "--prior": "fx=1250+-10px"}
OF_ONE = ":"
"""Between a camera's name and what is asked of it alone, as in `left:k3=0`."""


@dataclass(frozen=True, eq=False)
class CameraWishes:
    """What a person asked for of the cameras."""

    model: str | Mapping[str, str]  # of all cameras, or of each by its name; `all` chooses
    given: Mapping[str, Camera]  # from earlier runs
    refined: bool | Collection[str]  # which of the given ones are solved on
    fix: tuple[str, ...]  # what is to be kept of parameters, and what is known of them
    options: SolveOptions  # what holds for all cameras

    def plan_of(self, name: str) -> SolvePlan:
        """How a camera is to be solved on its own.

        Raises:
            InputError: a model or a parameter that there is not.
        """
        model = self.given[name].model if name in self.given else self._model_of(name)
        known = {one.name for part in models_of(model) if part in MODELS for one in told_parameters(part)}
        asked = [
            text
            for owner, text in map(_split, self.fix)
            if owner == name or (not owner and full_name(_parameter(text), known) in known)
        ]
        one = self.options
        return plan_from_words(
            model, fix=[text for text in asked if not is_prior(text)], loss=one.loss, reject=one.reject_sigma,
            weighted=one.weighted, prior=[text for text in asked if is_prior(text)],
        )  # fmt: skip

    def _model_of(self, name: str) -> str:
        return self.model if isinstance(self.model, str) else self.model.get(name, ALL)

    def is_refined(self, name: str) -> bool:
        """Whether a camera's own parameters are unknowns."""
        return name not in self.given or (self.refined if isinstance(self.refined, bool) else name in self.refined)


def wishes_of(
    model: str | Mapping[str, str], given: Mapping[str, Camera], refine: bool | Collection[str], fix: Sequence[str],
    options: SolveOptions, priors: Sequence[str] = (),
) -> CameraWishes:  # fmt: skip
    """What was asked for.

    Raises:
        InputError: a lens that no rig can have.
    """
    for name, camera in given.items():
        if camera.learned is not None or camera.model in free_form_models():
            raise InputError(
                f"camera {shown(name)}: model {camera.model} is solved alone; give a camera of another model, such as "
                f"{COMMON}"
            )
    refined = refine if isinstance(refine, bool) else tuple(map(str, several("--refine", refine)))
    fix = tuple(map(str, several("--fix", fix)))
    for option, texts, other in (("--fix", fix, "--prior"), ("--prior", priors, "--fix")):
        for text in texts:
            if is_prior(text) != (option == "--prior"):
                raise InputError(f"{option} {shown(text)}: give that with {other}, or as in {EXAMPLES[option]}")
    return CameraWishes(model, given, refined, (*fix, *priors), options)


def require_wishes(wishes: CameraWishes, names: Sequence[str]) -> None:
    """Refuse what is asked of a camera that there is not, and parameters that none has.

    Raises:
        InputError: the message has the name.
    """
    refined = () if isinstance(wishes.refined, bool) else wishes.refined
    models = () if isinstance(wishes.model, str) else tuple(wishes.model)
    owners = [(_option(text), (owner,)) for owner, text in map(_split, wishes.fix) if owner]
    for option, asked in (("--camera", wishes.given), ("--refine", refined), ("--model", models), *owners):
        for name in asked:
            if name not in names:
                hint = suggestion(name, list(names)) or f"; there are {', '.join(map(shown, names))}"
                raise InputError(f"{option} {shown(name)}: no such camera{hint}")
    without = [name for name in refined if name not in wishes.given]
    if without:
        raise InputError(f"--refine {shown(without[0])}: is solved anyway, as no camera was given for it; leave it out")
    named = set(names) if isinstance(wishes.model, str) and wishes.model != ALL else set(models)
    told_twice = [name for name in wishes.given if name in named]
    if told_twice and (models or len(wishes.given) == len(names)):
        raise InputError(
            f"--model: camera {shown(told_twice[0])} is of the model {wishes.given[told_twice[0]].model}, as its file "
            "says; leave out --model or --camera"
        )
    plans = [wishes.plan_of(name) for name in names if wishes.is_refined(name)]
    if wishes.fix and not plans:
        option = _option(wishes.fix[0])
        raise InputError(f"{option} {shown(wishes.fix[0])}: all cameras are kept as they were given; --refine them too")
    for plan in plans:
        _together(plan)
    used = {name for plan in plans for name, _ in plan.options.fixed}
    used |= {one.name for plan in plans for one in plan.options.priors}
    for owner, text in map(_split, wishes.fix):
        if not owner and full_name(_parameter(text), used) not in used:
            model = next((plan.models[0] for plan in plans), COMMON)
            plan_from_words(model, fix=[] if is_prior(text) else [text], prior=[text] if is_prior(text) else [])
        if owner and not wishes.is_refined(owner):
            raise InputError(
                f"{_option(text)} {shown(text)}: camera {shown(owner)} is kept as it was given; --refine {owner} too"
            )


def _split(text: str) -> tuple[str, str]:
    """The camera that a wish is of, "" for all, and the wish."""
    owner, colon, rest = text.rpartition(OF_ONE)
    return (owner.strip(), rest) if colon else ("", text)


def _option(text: str) -> str:
    return "--prior" if is_prior(text) else "--fix"


def _parameter(text: str) -> str:
    return text.partition("=")[0].strip()


def choices_of(
    observations: RigObservations, wishes: CameraWishes, progress: Progress
) -> tuple[tuple[CameraChoice, ...], tuple[str, ...]]:
    """How each camera is to be solved, and remarks on what was chosen."""
    choices, said = [], []
    for number, (name, seen) in enumerate(zip(observations.camera_names, observations.sightings, strict=True)):
        progress("choosing lenses", number, observations.camera_count)
        choice, remark = _choice(name, seen, wishes)
        choices.append(choice)
        said += [f"{name}: {remark}"] if remark else []
    return tuple(choices), tuple(said)


def _choice(name: str, seen: Observations, wishes: CameraWishes) -> tuple[CameraChoice, str]:
    """How one camera is to be solved, and a word on it."""
    camera = wishes.given.get(name)
    if camera is not None:
        if camera.image_size != seen.image_size:
            raise InputError(
                f"camera {shown(name)}: what it saw is of {seen.image_size[0]} x {seen.image_size[1]} px, its camera "
                f"file of {camera.image_size[0]} x {camera.image_size[1]} px; give the lens that took the photos"
            )
        if not wishes.is_refined(name):
            said = "its lens is kept as it was given; what that is off by is in no sigma here"
            return CameraChoice(camera.model, camera, is_refined=False), said
        return _refined(camera, wishes.plan_of(name).options), ""
    plan, suited = wishes.plan_of(name).suited(seen)
    said = "; ".join(remark for remark in suited.remarks if remark not in seen.remarks)
    model = _model_of(suited, plan)
    own = plan.options_of(model)
    return CameraChoice(model, fixed=own.fixed, priors=own.priors), said


def _refined(camera: Camera, options: SolveOptions) -> CameraChoice:
    """A given lens as the start, with the values at which parameters are to be kept."""
    names, params = parameter_names(camera.model), camera.params.copy()
    for name, value in options.fixed:
        if value is not None:
            params[names.index(name)] = value
    return CameraChoice(camera.model, replace(camera, params=params), fixed=options.fixed, priors=options.priors)


def _together(plan: SolvePlan) -> list[str]:
    """The models of a plan that a rig can have.

    Raises:
        InputError: it has none.
    """
    together = [model for model in plan.models if model not in {*learned_models(), *free_form_models()}]
    if not together:
        raise InputError(f"--model {plan.models[0]}: is solved alone, not in a rig; give another, such as {COMMON}")
    return together


def _model_of(seen: Observations, plan: SolvePlan) -> str:
    """The model of a camera: the one that other programs share, or of a wide lens what leaves least in photos held out.

    Raises:
        InputError: a model was asked for that is solved alone.
    """
    together = _together(plan)
    if len(together) == 1 or COMMON in together:
        return COMMON if COMMON in together else together[0]
    solved = compared(
        tuple(solve_models(SolveTask(seen, replace(plan, models=tuple(together), is_compared=False)))), plan
    )
    return best_of(solved).model if any(one.evaluation is not None for one in solved) else together[0]


@dataclass(frozen=True, eq=False)
class RigSeen:
    """What a rig is solved from, and what it was seen of."""

    observations: RigObservations
    target: TargetGeometry | None = None  # None: the points came from elsewhere
    search: RigSearch | None = None  # of the photos; None: solved from observations
    made: Made | None = None  # how the target was; None: nobody knows

    def with_made(self, made: str | None) -> "RigSeen":
        """With how the target was made: as it is said, or as photos and build tell.

        Raises:
            InputError: no such way.
        """
        rendered_id = "" if self.search is None else self.search.rendered_id
        return replace(self, made=how_made(self.target, made, rendered_id=rendered_id))


def judged_rig(
    seen: RigSeen, wishes: CameraWishes, options: RigOptions, limits: Criteria, settings: tuple[tuple[str, str], ...],
    progress: Progress, moved: Mechanism | None = None,
) -> tuple[RigRun, RigSeen]:  # fmt: skip
    """Solve a rig and judge it, whatever moves it or its target; what it was seen by, with a word on each lens.

    Args:
        seen: by the cameras.
        wishes: what was asked for of them.
        options: how they are solved together.
        limits: of the verdict.
        settings: for the record.
        progress: is told what is being done.
        moved: what moves them, with one standard deviation more of what is alike in all its poses; None: nothing is.

    Raises:
        InputError: cameras that no frames tie together, or that cannot be solved.
    """
    choices, said = choices_of(seen.observations, wishes, progress)
    plan, points = SolvePlan((COMMON,), wishes.options), seen.observations.points
    said = (*said, *filter(None, (plan.flat_remark(seen.made, points),)))
    seen = replace(seen, observations=with_remarks(seen.observations, said))
    bend = plan.for_target(seen.made, points).options_of(COMMON)
    options = replace(options, free_bend=bool(bend.free_bend), bend_sigma_mm=bend.bend_sigma_mm)
    progress("solving", 0, 0)
    solved = solve_rig(seen.observations, choices, options)
    if moved is not None:
        by_it = _unknowns_apart(solved, solve_rig(seen.observations, choices, replace(options, carrier=moved)))
        solved = replace(solved, covariance=solved.covariance + np.outer(by_it, by_it))
    stated = with_circle_doubt(with_target_error(solved, seen.made))
    found = with_shared_errors(stated)
    progress("judging", 0, 0)
    halves = rig_halves(found, half_solver(found, choices, options))
    if isinstance(halves, RigHalves) and halves.has_moved:  # which may look like anything that photos share
        found = replace(found, remarks=stated.remarks)
    origin = Provenance(
        program(), "" if seen.target is None else seen.target.layout_id, seen.observations.points.geometry_id,
        options=wishes.options, settings=(*settings, *((_option(text)[2:], text) for text in wishes.fix)),
    )  # fmt: skip
    return RigRun(found, origin, judge_rig(found, halves, limits), seen.target), seen


def _unknowns_apart(first: RigCalibration, second: RigCalibration) -> Array:
    """What leads from one solution's cameras to another's, in the rows of their covariance.  # (N,)"""
    step = steps_between(first.cam_from_rig, second.cam_from_rig)
    parts = zip(first.cameras, second.cameras, step, strict=True)
    return np.concatenate([np.concatenate([other.params - one.params, by]) for one, other, by in parts])


FEWEST_POSES = 3
SURELY = 4.0
"""Standard deviations from which on a target was not made as it is said."""
ROBOT_LENGTHS = 1e-3
"""Standard deviation of a robot's own lengths, as a part of them."""
IN_HAND, TARGET_IN_HAND = "robot, camera in hand", "robot, target in hand"


@dataclass(frozen=True)
class RobotSetting:
    """How a robot, its camera and its target go together."""

    is_target_in_hand: bool = False  # else it holds the camera
    solves_size: bool | None = None  # of the target, by the robot's ways alone; None: as sure as it was made so
    sigma_rad: float | None = None  # of a coordinate of the robot's errors; None: estimated
    sigma_mm: float | None = None


def judged_on_robot(
    seen: RigSeen, poses: RobotPoses, setting: RobotSetting, wishes: CameraWishes, limits: Criteria,
    settings: tuple[tuple[str, str], ...], progress: Progress,
) -> tuple[RigRun, RigSeen]:  # fmt: skip
    """Solve where a camera sits on a robot, or beside it, and judge that.

    Args:
        seen: by the one camera, a frame a photo.
        poses: base_from_flange of its photos.
        setting: what the robot holds, and what is known of it.
        wishes: what was asked for of the camera.
        limits: of the verdict.
        settings: for the record.
        progress: is told what is being done.

    Raises:
        InputError: too few photos have a pose, or poses look inverted or in another unit.
    """
    seen, base_from_flange, later = _with_poses(seen, poses, wishes, is_camera_in_hand=not setting.is_target_in_hand)
    size_sigma = FREE_SIZE * (setting.solves_size is not False)
    if setting.solves_size is None and seen.target is not None and seen.made is not None:
        # Of a target against a robot's lengths, by how both were made.
        prior = seen.made.prior
        size_sigma = math.hypot(ROBOT_LENGTHS, 0.0 if prior is None else prior.size_sigma(seen.target.center_mm))
    carrier = Mechanism(
        TARGET_IN_HAND if setting.is_target_in_hand else IN_HAND,
        base_from_flange if setting.is_target_in_hand else invert(base_from_flange),
        is_camera_in_hand=not setting.is_target_in_hand, sigma_rad=setting.sigma_rad, sigma_mm=setting.sigma_mm,
        size_sigma=size_sigma,
    )  # fmt: skip

    def solved(by: Mechanism) -> tuple[RigRun, RigSeen]:
        options = RigOptions(carrier=by, minimise=wishes.options.minimise)
        there = later if setting.is_target_in_hand or later is None else invert(later)
        moved = None if there is None else replace(by, rig_from_mechanism=there)
        return judged_rig(seen, wishes, options, limits, settings, progress, moved)

    run, told = solved(carrier)
    fit = run.found.carrier
    if fit is not None and abs(fit.size - 1) > SURELY * size_sigma > 0:
        # The robot's ways belie how the target was made: then they alone tell.
        run, told = solved(replace(carrier, size_sigma=FREE_SIZE))
        fit = run.found.carrier
    if fit is not None and (why := why_size(poses, fit.size)):
        raise InputError(f"{poses.origin}: {why}")
    return run, told


def _with_poses(
    seen: RigSeen, poses: RobotPoses, wishes: CameraWishes, *, is_camera_in_hand: bool
) -> tuple[RigSeen, Array, Array | None]:
    """The photos of which the robot's pose is known, and these poses, if they explain the photos as they are read.

    Of a stream also those by clocks with a standard deviation more of an offset; None: nothing of that matters.
    """
    one, stamps = seen.observations.sightings[0], seen.observations.time_s
    time_s = stream_times(poses, one.view_names, None if stamps is None else stamps[0])
    if time_s is not None:
        return _with_stream(seen, poses, time_s, wishes, is_camera_in_hand=is_camera_in_hand)
    matched = poses_of(poses, one.view_names)
    keep = np.array([row is not None for row in matched.row])
    rows = [row for row in matched.row if row is not None]
    lost = [name for name, ok in zip(one.view_names, keep.tolist(), strict=True) if not ok]
    if len(rows) < FEWEST_POSES:
        raise InputError(
            f"{poses.origin}: {len(rows)} of {len(keep)} photos have a pose; {FEWEST_POSES} or more are needed: "
            "name the poses as the photos' files are"
        )
    said = [matched.remark] if matched.remark else []
    if lost:
        said.append(f"{len(lost)} photos have no robot pose and are left out, the first is {lost[0]}")
    if matched.unused:
        said.append(f"{len(matched.unused)} robot poses are of no photo in use, the first is {matched.unused[0]}")
    kept = replace(alone_as_rig(ALONE, keep_views(one, keep)), remarks=(*seen.observations.remarks, *said))
    kept, cam_from_target = _alone(kept, wishes, poses.base_from_flange[rows])
    if why := why_wrong(cam_from_target, poses, np.array(rows), is_camera_in_hand=is_camera_in_hand):
        raise InputError(f"{poses.origin}: {why}")
    return replace(seen, observations=kept), poses.base_from_flange[rows], None


def _alone(kept: RigObservations, wishes: CameraWishes, base_from_flange: Array) -> tuple[RigObservations, Array]:
    """The one camera's photos, named as the robot's motions tell, and its own cam_from_target.  # (V, 4, 4)"""
    given, model = wishes.given.get(ALONE), COMMON if wishes.model == ALL else str(wishes.model)
    choice = CameraChoice(model if given is None else given.model, given, is_refined=False)
    alone = solve_alone(kept.sightings[0], ALONE, choice, RigOptions())
    if kept.sightings[0].points.turned is not None:
        kept = named_alike(kept, [alone.cam_from_target], Mechanism("robot", base_from_flange))
        alone = solve_alone(kept.sightings[0], ALONE, choice, RigOptions())
    return kept, alone.cam_from_target


def _with_stream(
    seen: RigSeen, poses: RobotPoses, time_s: Array, wishes: CameraWishes, *, is_camera_in_hand: bool
) -> tuple[RigSeen, Array, Array | None]:
    """The same of a stream: interpolated at the photos' stamps, less the offset of the clocks where that matters."""
    poses = poses.sorted_by_time()
    one, all_known = seen.observations.sightings[0], poses.is_known(time_s)
    if all_known.sum() < FEWEST_POSES:
        begin, end = (0.0, 0.0) if poses.time_s is None else (poses.time_s[0], poses.time_s[-1])
        raise InputError(
            f"{poses.origin}: {all_known.sum()} of {len(time_s)} photos are of times with a pose; {FEWEST_POSES} or "
            f"more are needed: the photos are of {time_s.min():.3f} to {time_s.max():.3f} s, the poses of {begin:.3f} "
            f"to {end:.3f} s"
        )
    kept, time_s = alone_as_rig(ALONE, keep_views(one, all_known)), time_s[all_known]
    lost = int((~all_known).sum())
    kept, cam_from_target = _alone(kept, wishes, poses.at(time_s))
    offset_s, sigma_s, said = _clock_offset(poses, time_s, cam_from_target, is_camera_in_hand=is_camera_in_hand)
    known = poses.is_known(time_s - offset_s)
    lost += int((~known).sum())
    if lost:
        said = f"{said}; {lost} photos are left out, as their times have no robot pose, or lie in a gap of these"
    kept = replace(
        alone_as_rig(ALONE, keep_views(kept.sightings[0], known)), remarks=(*seen.observations.remarks, said)
    )
    there = poses.sampled(kept.sightings[0].view_names, time_s[known] - offset_s)
    rows = np.arange(int(known.sum()))
    if why := why_wrong(cam_from_target[known], there, rows, is_camera_in_hand=is_camera_in_hand):
        raise InputError(f"{poses.origin}: {why}")
    later = poses.at(time_s[known] - offset_s - sigma_s) if sigma_s > 0 else None
    return replace(seen, observations=kept), there.base_from_flange, later


def _clock_offset(
    poses: RobotPoses, time_s: Array, cam_from_target: Array, *, is_camera_in_hand: bool
) -> tuple[float, float, str]:
    """By how much the camera's clock is ahead of the robot's, how sure that is, and a word on it; 0: it matters not."""
    moves_mm = poses.moves_mm(time_s)
    paired = f"robot poses are interpolated at the {len(time_s)} photos' time stamps"
    if moves_mm.max() <= STILL_MM:
        most = f"{figure(moves_mm.max(), 2)} mm at most in {1e3 * AROUND_S:g} ms"
        return 0.0, 0.0, f"{paired}, where the robot moves by {most}: an offset of the clocks matters nothing"
    order = np.flatnonzero(np.diff(np.sort(time_s), prepend=-np.inf) > 0)
    order = np.argsort(time_s, kind="stable")[order]
    robot = poses.base_from_flange if not is_camera_in_hand else invert(poses.base_from_flange)
    try:
        found = solve_pose_streams(
            time_s[order], cam_from_target[order], cast(Array, poses.time_s), robot,
            "camera" if is_camera_in_hand else "target",
        )  # fmt: skip
    except InputError as error:
        return 0.0, 0.0, f"{paired}, as if the clocks were one: their offset is not told: {error}"
    if found.undetermined:
        return 0.0, 0.0, f"{paired}, as if the clocks were one: their offset is not told: {found.undetermined[0]}"
    off_mm = found.offset_sigma_s * float(np.median(moves_mm)) / AROUND_S
    return (
        found.offset_s,
        found.offset_sigma_s,
        (
            f"{paired}, by clocks of which the camera's is ahead by {1e3 * found.offset_s:.2f} ± "
            f"{figure(1e3 * found.offset_sigma_s, 2)} ms, as the motion tells; that moves the robot's poses by "
            f"{figure(off_mm, 2)} mm (1 sigma), which is part of all standard deviations"
        ),
    )
