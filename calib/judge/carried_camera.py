"""A camera in a robot's hand, or beside the robot that holds the target: one adjustment with the robot's own errors."""

import math
from dataclasses import dataclass, replace

import numpy as np

from calib.cameras import COMMON
from calib.core.se3 import invert
from calib.core.types import keep_views
from calib.judge.rig_folder import RigRun
from calib.judge.rig_lenses import CameraWishes, choices_of
from calib.judge.rig_solution import RigSeen, judged_rig
from calib.judge.verdict import Criteria
from calib.observe.rig_observations import alone_as_rig
from calib.observe.rig_search import ALONE
from calib.observe.robot_poses import RobotPoses, poses_of
from calib.rigs.bent import bent_alone
from calib.rigs.options import FREE_SIZE, CameraChoice, Carrier, RigOptions
from calib.rigs.robot_readings import why_size, why_wrong
from calib.rigs.start import solve_alone
from calib.solver.plan import ALL
from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.page.progress import Progress

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
    is_bent: bool = False  # a flat target, as the photos show it
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
    seen, base_from_flange = _with_poses(seen, poses, wishes, is_camera_in_hand=not setting.is_target_in_hand)
    if setting.is_bent:
        progress("bending the target", 0, 0)
        (choice,), _ = choices_of(seen.observations, wishes, progress)
        one, bend = bent_alone(seen.observations.sightings[0], choice)
        bent = replace(alone_as_rig(ALONE, one), remarks=(*seen.observations.remarks, *one.remarks))
        seen = replace(seen, observations=bent, bend=bend)
    size_sigma = _size_sigma(seen) if setting.solves_size is None else FREE_SIZE * setting.solves_size
    carrier = Carrier(
        TARGET_IN_HAND if setting.is_target_in_hand else IN_HAND,
        base_from_flange if setting.is_target_in_hand else invert(base_from_flange),
        is_camera_in_hand=not setting.is_target_in_hand, sigma_rad=setting.sigma_rad, sigma_mm=setting.sigma_mm,
        size_sigma=size_sigma,
    )  # fmt: skip

    def solved(by: Carrier) -> tuple[RigRun, RigSeen]:
        options = RigOptions(carrier=by, minimise=wishes.options.minimise)
        return judged_rig(seen, wishes, options, limits, settings, progress)

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
) -> tuple[RigSeen, Array]:
    """The photos of which the robot's pose is known, and these poses, if they explain the photos as they are read."""
    one = seen.observations.sightings[0]
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
    given, model = wishes.given.get(ALONE), COMMON if wishes.model == ALL else str(wishes.model)
    choice = CameraChoice(model if given is None else given.model, given, is_refined=False)
    alone = solve_alone(kept.sightings[0], ALONE, choice, RigOptions())
    if why := why_wrong(alone.cam_from_target, poses, np.array(rows), is_camera_in_hand=is_camera_in_hand):
        raise InputError(f"{poses.origin}: {why}")
    return replace(seen, observations=kept), poses.base_from_flange[rows]


def _size_sigma(seen: RigSeen) -> float:
    """Standard deviation of a target's size against a robot's lengths, by how both were made."""
    if seen.target is None or seen.made is None:
        return FREE_SIZE
    prior = seen.made.prior
    return math.hypot(ROBOT_LENGTHS, 0.0 if prior is None else prior.size_sigma(seen.target.center_mm))
