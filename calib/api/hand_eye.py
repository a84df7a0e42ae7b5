"""Where a camera sits on a robot, or beside a turntable: what `calib hand-eye` does."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calib.api.rig_choosing import CameraWishes, choices_of, require_wishes, wishes_of
from calib.api.rig_observing import RigSearch, search_one
from calib.api.rig_result import RigResult, RigWriter
from calib.api.rigging import RigSeen, judged_rig
from calib.app.inputs import (
    Place,
    camera_of,
    folder_of,
    load_observations,
    photos_of,
    require_photos_for_jobs,
    target_of,
)
from calib.cameras import COMMON
from calib.cameras.camera import Camera
from calib.core.se3 import invert
from calib.core.types import Observations, RigObservations, keep_views
from calib.observe.photos import Search
from calib.observe.rig_photos import RigPhoto, RigPhotos, tells_cameras
from calib.observe.rig_sightings import read_rig_sightings
from calib.rigs.bent import bent_alone
from calib.rigs.options import FREE_SIZE, CameraChoice, Carrier, RigOptions
from calib.rigs.robot_readings import why_size, why_wrong
from calib.rigs.start import solve_alone
from calib.rigs.turntable import turned_by
from calib.robot.poses import RobotPoses, poses_of, read_robot_poses
from calib.solver.costs import IMAGE
from calib.solver.plan import ALL, cost_of, plan_from_words
from calib.solver.plane_bend import PlaneBend
from calib.verdict.criteria import STANDARD, read_rig_criteria
from calib.verdict.verdict import Criteria
from designer.base.errors import InputError
from designer.base.small_file import place_of
from designer.base.words import shown
from designer.page.progress import Progress, unheard
from designer.target import TargetGeometry
from designer.tolerance.made import Made, how_made

Array = NDArray[np.float64]

CAMERA = "camera"
"""The name of the one that the robot carries, or looks at."""
FEWEST_POSES = 3
SURELY = 4.0
"""Standard deviations from which on a target was not made as it is said."""
ROBOT_LENGTHS = 1e-3
"""Standard deviation of a robot's own lengths, as a part of them."""
IN_HAND, TARGET_IN_HAND, TABLE = "robot, camera in hand", "robot, target in hand", "turntable"


def hand_eye(
    target: TargetGeometry | Place | None,
    photos: Place | Iterable[Place] = (),
    *,
    robot: RobotPoses | Place,
    table: Observations | Place | None = None,
    points: str | None = None,
    diameter_mm: float | None = None,
    target_in_hand: bool = False,
    inverted: bool = False,
    unit: str | None = None,
    euler: str | None = None,
    camera: Camera | Place | None = None,
    refine: bool = False,
    model: str = ALL,
    fix: Sequence[str] = (),
    minimise: str = IMAGE,
    target_size: bool | None = None,
    free_bend: bool = False,
    robot_noise: tuple[float, float] | None = None,
    made: str | None = None,
    criteria: Criteria | Place = STANDARD,
    jobs: int | None = None,
    progress: Progress = unheard,
    out: Place | None = None,
    settings: Sequence[tuple[str, str]] = (),
) -> RigResult:
    """Solve where a camera sits on a robot: `hand_eye("ico.target.json", "photos", robot="poses.csv")`.

    >>> found = calib.hand_eye("ico.target.json", "photos", robot="poses.csv")
    >>> found.hand_eye.flange_from_cam, found.hand_eye.robot_sigma_mm

    All in one adjustment: the camera, where it sits, where the target stands, the robot's own noise and, as a robot's
    ways are lengths, the target's size.

    Args:
        target: what the photos show, a geometry or its file; None: a table has points.
        photos: files, folders or patterns.
        robot: base_from_flange of each photo, or the file that holds it.
        table: instead of photos: observations, or their file (`detections.csv`, or image,u,v,X,Y,Z).
        points: what the table's points are: `corner`, `ring` or `circle`; None: as it says itself.
        diameter_mm: of circles.
        target_in_hand: the robot holds the target, the camera stands beside it.
        inverted: the robot's file holds flange_from_base.
        unit: of its columns that do not name it: `mm`, `m,deg`.
        euler: convention of its Euler angles, such as `xyz-extrinsic` or `kuka`.
        camera: the lens from an earlier run, which is kept.
        refine: solve it on.
        model: of the camera; `all` chooses.
        fix: parameters to keep.
        minimise: distances in the image, or in space.
        target_size: solve the target's size by the robot's ways alone, or keep it; None: as sure as it was made so.
        free_bend: solve the bend of a flat target, by the photos alone: two curvatures, along its sides.
        robot_noise: standard deviations of a coordinate of the robot's errors, rad and mm; None: estimated.
        made: how the target was made.
        criteria: limits of the verdict.
        jobs: photos at a time; None: one per core.
        progress: is told what is being done.
        out: a folder to write everything to.
        settings: names and values to keep in the record.

    Raises:
        InputError: files or options that break a rule, or poses that look inverted or in another unit.
        BlindCameraError: no photo shows the target.
    """
    writer = None if out is None else RigWriter(folder_of(out))
    if isinstance(robot, RobotPoses) and (inverted or unit is not None or euler is not None):
        raise InputError("inverted, unit, euler: tell how a file of robot poses is read; these poses are read already")
    poses = robot if isinstance(robot, RobotPoses) else read_robot_poses(
        place_of(robot, "a file of robot poses"), unit=unit, euler=euler, is_inverted=inverted
    )  # fmt: skip
    wish = _Wish(camera, refine, model, tuple(fix), cost_of(minimise), made, criteria, tuple(settings))
    limits, seen = _limits(wish), _seen(target, photos, table, (points, diameter_mm), wish, jobs, progress)
    way = _made(seen, wish)
    seen, rows = _with_poses(seen, poses)
    base_from_flange = poses.base_from_flange[rows]
    _require_right(seen.observations, wish, poses, rows, is_camera_in_hand=not target_in_hand)
    if free_bend:
        seen = _bent(seen, wish, progress)
    noise = (None, None) if robot_noise is None else robot_noise
    carrier = Carrier(
        TARGET_IN_HAND if target_in_hand else IN_HAND,
        base_from_flange if target_in_hand else invert(base_from_flange),
        is_camera_in_hand=not target_in_hand, sigma_rad=noise[0], sigma_mm=noise[1],
        size_sigma=_size_sigma(seen.target, way) if target_size is None else FREE_SIZE * target_size,
    )  # fmt: skip
    result = _solved(seen, way, wish, carrier, limits, progress)
    fit = result.calibration.carrier
    if fit is not None and abs(fit.size - 1) > SURELY * carrier.size_sigma > 0:
        # The robot's ways belie how the target was made: then they alone tell.
        result = _solved(seen, way, wish, replace(carrier, size_sigma=FREE_SIZE), limits, progress)
        fit = result.calibration.carrier
    if fit is not None and (why := why_size(poses, fit.size)):
        raise InputError(f"{poses.origin}: {why}")
    return _written(result, progress, writer)


def _size_sigma(target: TargetGeometry | None, made: Made | None) -> float:
    """Standard deviation of a target's size against a robot's lengths, by how both were made."""
    if target is None or made is None:
        return FREE_SIZE
    return math.hypot(ROBOT_LENGTHS, 0.0 if made.prior is None else made.prior.size_sigma(target.center_mm))


def turntable(
    target: TargetGeometry | Place | None,
    photos: Place | Iterable[Place] = (),
    *,
    step_deg: float | None = None,
    table: Observations | Place | None = None,
    points: str | None = None,
    diameter_mm: float | None = None,
    camera: Camera | Place | None = None,
    refine: bool = False,
    model: str = ALL,
    fix: Sequence[str] = (),
    minimise: str = IMAGE,
    made: str | None = None,
    criteria: Criteria | Place = STANDARD,
    jobs: int | None = None,
    progress: Progress = unheard,
    out: Place | None = None,
    settings: Sequence[tuple[str, str]] = (),
) -> RigResult:
    """Solve where a camera stands beside a turntable: `turntable("ico.target.json", "photos", step_deg=10)`.

    Args:
        target: that stands on the table.
        photos: in the order in which they were taken.
        step_deg: the table's turn from photo to photo; None: all angles are unknowns.
        table: instead of photos: observations, or their file.
        points: what the table's points are: `corner`, `ring` or `circle`; None: as it says itself.
        diameter_mm: of circles.
        camera: the lens from an earlier run, which is kept.
        refine: solve it on.
        model: of the camera; `all` chooses.
        fix: parameters to keep.
        minimise: distances in the image, or in space.
        made: how the target was made.
        criteria: limits of the verdict.
        jobs: photos at a time; None: one per core.
        progress: is told what is being done.
        out: a folder to write everything to.
        settings: names and values to keep in the record.

    Raises:
        InputError: files or options that break a rule.
        BlindCameraError: no photo shows the target.
    """
    if step_deg is not None and not 0 < abs(step_deg) <= 180:
        raise InputError(f"step {step_deg:g} deg: must be more than 0 and at most 180")
    writer = None if out is None else RigWriter(folder_of(out))
    wish = _Wish(camera, refine, model, tuple(fix), cost_of(minimise), made, criteria, tuple(settings))
    limits, seen = _limits(wish), _seen(target, photos, table, (points, diameter_mm), wish, jobs, progress)
    number = np.array([seen.order[name] for name in seen.observations.frame_names], dtype=np.float64)
    angle = np.deg2rad(0.0 if step_deg is None else step_deg) * number
    carrier = Carrier(TABLE, turned_by(angle), is_turntable=True, has_free_angles=step_deg is None)
    return _written(_solved(seen, _made(seen, wish), wish, carrier, limits, progress), progress, writer)


@dataclass(frozen=True, eq=False)
class _Wish:
    """What a person asked for of the camera and the verdict."""

    camera: Camera | Place | None
    refine: bool
    model: str
    fix: tuple[str, ...]
    minimise: str
    made: str | None
    criteria: Criteria | Place
    settings: tuple[tuple[str, str], ...]

    @property
    def given(self) -> dict[str, Camera]:
        """The lens of an earlier run, by the camera's name."""
        return {} if self.camera is None else {CAMERA: camera_of(self.camera)}


@dataclass(frozen=True, eq=False)
class _Seen:
    """What one camera saw, a frame a photo, and the place of each photo among all that were taken."""

    target: TargetGeometry | None
    observations: RigObservations
    order: Mapping[str, int]
    search: RigSearch | None = None  # of photos
    bend: PlaneBend | None = None  # by which the points were moved


def _seen(
    target: TargetGeometry | Place | None, photos: Place | Iterable[Place], table: Observations | Place | None,
    kind: tuple[str | None, float | None], wish: _Wish, jobs: int | None, progress: Progress,
) -> _Seen:  # fmt: skip
    """What the camera saw, from photos or a table."""
    if wish.refine and wish.camera is None:
        raise InputError("--refine: there is no lens to solve on from; give --camera, or leave it out")
    require_wishes(_wishes(wish), (CAMERA,))
    if kind != (None, None) and (table is None or isinstance(table, Observations)):
        raise InputError("--points: says what the points of a table are; leave it out")
    found = photos_of(photos)
    if table is not None:
        require_photos_for_jobs(jobs)
        if found.paths or found.failures:
            first = found.failures[0] if found.failures else shown(found.paths[0].name)
            raise InputError(f"--table: says what was seen in the photos; leave these out: {first}")
        geometry = None if target is None else target_of(target)
        one = table if isinstance(table, Observations) else _table_of(table, geometry, *kind)
        return _Seen(geometry, _rig_of(one), {name: row for row, name in enumerate(one.view_names)})
    if target is None:
        raise InputError("no target; give the target file of what the photos show, or a table of observations")
    geometry = target_of(target, "rings")
    if not found.paths:
        raise InputError(found.failures[0] if found.failures else "no photos; give files or a folder")
    plan = None if wish.given else plan_from_words(
        wish.model, fix=wish.fix, share=(), focal_px=None, loss="squares", reject=None, weighted=True
    )  # fmt: skip
    search, one = search_one(geometry, found, wish.given.get(CAMERA), plan, jobs, progress)
    order = {result.photo.name: row for row, result in enumerate(search.results)}
    return _Seen(geometry, _rig_of(one), order, _rig_search(search))


def _table_of(
    table: Place, geometry: TargetGeometry | None, points: str | None, diameter_mm: float | None
) -> Observations:
    """What one camera saw, of a table of one camera, or of the sightings that this wrote."""
    path = place_of(table, "a table of observations")
    if not (path.is_file() and tells_cameras(path)):
        return load_observations(path, geometry, points=points, diameter_mm=diameter_mm)
    seen = read_rig_sightings(path, geometry, points=points, diameter_mm=diameter_mm, fewest=1)
    if len(seen.sightings) > 1:
        raise InputError(f"{path}: holds the sightings of {len(seen.sightings)} cameras; give those of one")
    return seen.sightings[0]


def _rig_search(search: Search) -> RigSearch:
    """The search of one camera's photos as that of a rig: a frame a photo."""
    photos = tuple(RigPhoto(CAMERA, result.photo.path, result.photo.name) for result in search.results)
    return RigSearch(search.target, RigPhotos(photos, tuple(photo.frame for photo in photos)), (search,))


def _rig_of(seen: Observations) -> RigObservations:
    """One camera as a rig: a frame a view."""
    frames = np.arange(seen.view_count)
    return RigObservations((CAMERA,), seen.view_names, (replace(seen, remarks=()),), (frames,), None, seen.remarks)


def _with_poses(seen: _Seen, poses: RobotPoses) -> tuple[_Seen, list[int]]:
    """The photos of which the robot's pose is known, and the rows of these."""
    one = seen.observations.sightings[0]
    matched = poses_of(poses, one.view_names)
    keep = np.array([row is not None for row in matched.row])
    lost = [name for name, ok in zip(one.view_names, keep.tolist(), strict=True) if not ok]
    if int(keep.sum()) < FEWEST_POSES:
        raise InputError(
            f"{poses.origin}: {int(keep.sum())} of {len(keep)} photos have a pose; {FEWEST_POSES} or more are needed: "
            "name the poses as the photos' files are"
        )
    said = [matched.remark] if matched.remark else []
    if lost:
        said.append(f"{len(lost)} photos have no robot pose and are left out, the first is {lost[0]}")
    if matched.unused:
        said.append(f"{len(matched.unused)} robot poses are of no photo in use, the first is {matched.unused[0]}")
    kept = _rig_of(keep_views(one, keep))
    remarks = (*seen.observations.remarks, *said)
    return replace(seen, observations=replace(kept, remarks=remarks)), [row for row in matched.row if row is not None]


def _require_right(
    observations: RigObservations, wish: _Wish, poses: RobotPoses, rows: list[int], *, is_camera_in_hand: bool
) -> None:
    """Refuse poses that explain the photos in another reading alone, or in none."""
    given = wish.given.get(CAMERA)
    model = COMMON if wish.model == ALL else wish.model
    choice = CameraChoice(model if given is None else given.model, given, is_refined=False)
    alone = solve_alone(observations.sightings[0], CAMERA, choice, RigOptions())
    why = why_wrong(alone.cam_from_target, poses, np.array(rows), is_camera_in_hand=is_camera_in_hand)
    if why:
        raise InputError(f"{poses.origin}: {why}")


def _bent(seen: _Seen, wish: _Wish, progress: Progress) -> _Seen:
    """With the points of a flat target moved as the camera's photos show it bent."""
    progress("bending the target", 0, 0)
    (choice,), _ = choices_of(seen.observations, _wishes(wish), progress)
    one, bend = bent_alone(seen.observations.sightings[0], choice)
    said = (*seen.observations.remarks, *one.remarks)
    return replace(seen, observations=replace(_rig_of(one), remarks=said), bend=bend)


def _wishes(wish: _Wish) -> CameraWishes:
    """What was asked for of the camera."""
    plan = plan_from_words(
        ALL, fix=(), share=(), focal_px=None, loss="squares", reject=None, weighted=True, minimise=wish.minimise
    )
    return wishes_of(wish.model, wish.given or None, wish.refine, wish.fix, plan.options)


def _made(seen: _Seen, wish: _Wish) -> Made | None:
    return how_made(seen.target, wish.made, rendered_id="" if seen.search is None else seen.search.rendered_id)


def _limits(wish: _Wish) -> Criteria:
    return wish.criteria if isinstance(wish.criteria, Criteria) else read_rig_criteria(str(wish.criteria))


def _solved(
    seen: _Seen, made: Made | None, wish: _Wish, carrier: Carrier, limits: Criteria, progress: Progress
) -> RigResult:
    """One adjustment, judged."""
    whole = RigSeen(seen.target, seen.search, seen.observations, made, seen.bend)
    options = RigOptions(carrier=carrier, minimise=wish.minimise)
    return judged_rig(whole, _wishes(wish), options, limits, progress, wish.settings)


def _written(result: RigResult, progress: Progress, writer: RigWriter | None) -> RigResult:
    """Written, if there is a folder."""
    if writer is not None:
        progress("writing", 0, 0)
        writer.write(result)
        if remark := writer.write_page(result, ""):
            raise InputError(remark)
    return result
