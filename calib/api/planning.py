"""Photos to take of a camera, before any is taken: what `calib plan` does."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calib.api.page_shown import ShownAsPage
from calib.api.plan_setting import Carried, carried_by, front_of, hand_of, planned_camera
from calib.app.inputs import (
    Place,
    camera_of,
    folder_of,
    target_of,
)
from calib.cameras.camera import Camera
from calib.core.parallel import one_thread
from calib.guide.settings import GuideSettings, settings_of
from calib.records.hand_eye_file import HandEye
from calib.records.plan_file import (
    HAND,
    MOST_PLANNED,
    PLAN,
    PLAN_FILE,
    POSES_FILE,
    POSES_KIND,
    PlanRecord,
    plan_csv,
)
from calib.renderer.quantities import real, whole
from calib.show.parts.kept_target import keep_target, target_words
from calib.solver.calibration import Calibration
from calib.verdict.before_photos import calibration_before
from calib.verdict.criteria import STANDARD
from calib.verdict.next_view_words import gain_words
from calib.verdict.next_views import NextView
from calib.verdict.plan_tried import TriedPlan, tried_plan
from calib.verdict.planned_views import FEWEST, MOST, PlannedViews, planned_views
from calib.verdict.verdict import Criteria
from calib.verdict.views import TargetShape, shape_of
from designer.base.answer import program
from designer.base.errors import InputError
from designer.base.files import check_folder, named_in_files, write_files
from designer.base.number_text import figure
from designer.base.own_files import require_ours
from designer.page.progress import Progress, unheard
from designer.target import TargetGeometry

Array = NDArray[np.float64]

USUAL_NOISE_PX = 0.05
"""Of a coordinate of a ring's centre in good light."""
TRIES = 5
ROUNDS = 5
"""Of planning for less noise, where photos that were tried did not reach the goal."""
TIGHTER, SPARE = 0.5, 0.97
GOALS_PX, NOISES_PX = (1e-3, 100.0), (1e-3, 10.0)


@dataclass(frozen=True, eq=False)
class PlanResult(ShownAsPage):
    """Photos to take: `found.record.photos[0].sentence`, `found.record.worst_px`.

    In a notebook the result shows its page.
    """

    target: TargetGeometry
    record: PlanRecord  # all that is told
    kind = "plan"

    def save(self, folder: Place) -> tuple[Path, ...]:
        """Write `plan.json`, `plan.csv` and the target into a folder; return the files.

        Raises:
            InputError: the folder takes no files, or holds somebody else's.
        """
        place = folder_of(folder)
        check_plan_folder(place)
        is_again = (place / PLAN_FILE).exists()
        files = {place / POSES_FILE: plan_csv(self.record), place / PLAN_FILE: PLAN.text(self.record)}
        write_files(files)
        return (*files, *keep_target(place, self.target, is_again=is_again))


def check_plan_folder(folder: Path) -> None:
    """Refuse a folder that takes no plan, before any work is done.

    Raises:
        InputError: the message names it.
    """
    check_folder(folder)
    require_ours(folder / PLAN_FILE, kind=PLAN.format)
    require_ours(folder / POSES_FILE, kind=POSES_KIND)


@one_thread
def plan(
    target: TargetGeometry | Place,
    camera: Camera | Place,
    *,
    within_px: float | None = None,
    criteria: Criteria | str = STANDARD,
    noise_px: float = USUAL_NOISE_PX,
    distance_mm: tuple[float, float] | None = None,
    most: int = MOST,
    made: str | None = None,
    hand_eye: HandEye | Place | None = None,
    progress: Progress = unheard,
) -> PlanResult:
    """Plan the fewest photos that make a camera known as well as wanted: `plan("ico.target.json", "camera.json")`.

    >>> found = calib.plan("ico.target.json", "action-camera", within_px=0.05)
    >>> [photo.sentence for photo in found.record.photos]

    Photos are chosen one after the other by what they tell, then left out and exchanged. Each plan is tried: photos
    are simulated as a person holds the target (a robot exactly), and the camera is solved from them.

    Args:
        target: that will be photographed: a geometry, or its file.
        camera: about as it is: a camera, its file, or a template.
        within_px: what 95 % of the image is to stay within (1 sigma); None: as the criteria have it.
        criteria: when a camera is good: a template's name, a file, or limits.
        noise_px: standard deviation of a coordinate of a large ring's centre.
        distance_mm: nearest and farthest that the target may be; None: so that it fills a good part of the image.
        most: photos at most.
        made: how the target was made; None: assumed from the target.
        hand_eye: what `calib hand-eye` or `calib turntable` found, its file, or its folder: poses are the robot's then,
            or the table's angles.
        progress: is told that plans are tried.

    Raises:
        InputError: a file that cannot be read, options that break a rule, or a target that cannot be held so that it
            is read.
    """
    geometry, given = target_of(target, "rings"), camera_of(camera)
    settings = settings_of(geometry, criteria, made=made)
    goal_px = settings.criteria["uncertainty"].good if within_px is None else real("--within", within_px, *GOALS_PX)
    hand = hand_of(hand_eye)
    planned, said = planned_camera(given, goal_px)
    points = front_of(geometry, settings.points)
    before = calibration_before(planned, points, real("--noise", noise_px, *NOISES_PX, " px"))
    shape = shape_of(before)
    if shape is None:
        raise InputError("the target's points lie on no known plane, so what a photo shows of it is not known")
    carried = carried_by(hand, before, shape, distance_mm)
    wish = _PlanWish(settings, before, shape, carried, goal_px, whole("--most", most, FEWEST, MOST_PLANNED))
    found, tried = _worked_out(wish, progress)
    record = _record(geometry, wish, found, tried, _named(target, camera, hand_eye), said)
    return PlanResult(geometry, record)


@dataclass(frozen=True, eq=False)
class _PlanWish:
    """What is asked for."""

    settings: GuideSettings
    before: Calibration
    shape: TargetShape
    carried: Carried
    goal_px: float
    most: int

    @property
    def goal_covered(self) -> float:
        """Of the image, 0 to 1; a table shows the target where it stands."""
        return 0.0 if self.carried.at is not None else self.settings.criteria["coverage"].good / 100


def _worked_out(wish: _PlanWish, progress: Progress) -> tuple[PlannedViews, tuple[TriedPlan, ...]]:
    """The shortest of a few plans that reach the goal each time they are tried; the last one if none does.

    Plans are made for goals between one that was too easy and one that was hard enough.
    """
    goal_px, passed_px, failed_px = wish.goal_px, 0.0, 0.0
    for _ in range(ROUNDS):
        progress("trying plans", 0, 0)
        found = _planned(wish, goal_px)
        tried = _tried(wish, found)
        if max(one.stated_px for one in tried) <= wish.goal_px:
            best, passed_px = (found, tried), goal_px
            if not failed_px:
                break
        else:
            failed_px = goal_px
            if not passed_px:
                best = found, tried
                if not found.is_accurate:
                    break
        goal_px = math.sqrt(passed_px * failed_px) if passed_px else _tighter(wish, found, tried, goal_px)
    return best


def _tighter(wish: _PlanWish, found: PlannedViews, tried: tuple[TriedPlan, ...], goal_px: float) -> float:
    """By the noise alone, what leaves as much for the target's making as it took."""
    by_target_px = max(one.by_target_px for one in tried)
    room_px = math.sqrt(max(wish.goal_px**2 - by_target_px**2, 0.0))
    done_px = min(goal_px, found.views[-1].sigma_px_after)
    return done_px * max(TIGHTER, SPARE * room_px / max(one.by_noise_px for one in tried))


def _planned(wish: _PlanWish, goal_px: float) -> PlannedViews:
    found = planned_views(
        wish.before, wish.carried.held, goal_px=goal_px, goal_covered=wish.goal_covered, most=wish.most,
        at=wish.carried.at,
    )  # fmt: skip
    if found is None or not found.views:
        raise InputError(_why_nothing(wish))
    return found


def _why_nothing(wish: _PlanWish) -> str:
    near, far = (figure(one, 3) for one in wish.carried.held.distance_mm)
    if wish.carried.at is not None:
        return (
            f"the turntable's target, {near} to {far} mm away, is not read at any angle: its rings are too small in "
            "the image, or outside; give the hand_eye.json of this camera where it stands now"
        )
    return (
        f"no photo from {near} to {far} mm away shows enough rings of the target; give other distances with "
        "--distance, or a larger target"
    )


def _tried(wish: _PlanWish, found: PlannedViews) -> tuple[TriedPlan, ...]:
    poses = np.stack([one.cam_from_target for one in found.views])
    before, carried = wish.before, wish.carried
    return tuple(
        tried_plan(
            before.camera, before.observations.points, wish.shape, carried.held, poses, before.scale,
            wish.settings.made, np.random.default_rng(number), is_held_exactly=carried.hand is not None,
        )
        for number in range(TRIES)
    )  # fmt: skip


def _record(
    target: TargetGeometry, wish: _PlanWish, found: PlannedViews, tried: tuple[TriedPlan, ...],
    settings: Mapping[str, str], of_lens: str,
) -> PlanRecord:  # fmt: skip
    """What is told of a plan."""
    carried, made = wish.carried, wish.settings.made
    poses = np.stack([one.cam_from_target for one in found.views])
    table_deg, flange = None, None
    if carried.table_deg is not None and carried.at is not None:
        rows = np.abs(carried.at - poses[:, None]).sum(axis=(2, 3)).argmin(axis=1)
        table_deg = carried.table_deg[rows]
    elif carried.hand is not None:
        flange = carried.hand.base_from_flange(poses)
    record = PlanRecord(
        program=program(), settings=settings, geometry_id=target.geometry_id, target=target_words(target),
        camera=wish.before.camera, made="" if made is None else made.sentence,
        taken_by=HAND if carried.hand is None else carried.hand.carried, noise_px=wish.before.scale,
        goal_px=wish.goal_px, goal_covered=wish.goal_covered,
        photos=_photos(found, carried.hand, table_deg), distance_mm=found.distance_mm, tilt_deg=found.tilt_deg,
        base_from_flange=flange, table_deg=table_deg, tried=tried, remarks=(),
    )  # fmt: skip
    return replace(record, remarks=(of_lens, *_remarks(target, record)))


def _photos(found: PlannedViews, hand: HandEye | None, table_deg: Array | None) -> tuple[NextView, ...]:
    """The photos as they are told: of a turntable by its angle, and no two with the same words."""
    if table_deg is not None:
        return tuple(
            replace(view, sentence=f"turn the table to {angle:g} deg: {gain_words(gain)}")
            for view, gain, angle in zip(found.views, found.gains, table_deg.tolist(), strict=True)
        )
    told, photos = set[str](), []
    for view in found.views:
        head, colon, gain = view.sentence.partition(": ")
        if hand is not None:
            head = head.replace("hold the", "show the", 1)
        if head in told and hand is None:
            head = head.replace("any side", "another side") if "any side" in head else f"{head}, a little otherwise"
        told.add(view.sentence.partition(": ")[0])
        photos.append(replace(view, sentence=f"{head}{colon}{gain}"))
    return tuple(photos)


def _remarks(target: TargetGeometry, record: PlanRecord) -> tuple[str, ...]:
    """What a person must know of the numbers, beside the lens."""
    said = []
    if target.is_plate and not target.is_planar:
        said.append("photos are of the front of the board; what its back would tell is not counted")
    if not record.made:
        said.append("how the target was made is not known: its errors come on top; --made says how it was")
    if record.base_from_flange is not None:
        said.append("whether the robot reaches a pose without touching anything is not known: look before it moves")
    return tuple(said)


def _named(target: object, camera: object, hand_eye: object) -> Mapping[str, str]:
    """The files that were given, for the record."""
    given = (("target", target), ("camera", camera), ("hand-eye", hand_eye))
    return {name: named_in_files(Path(one)) for name, one in given if isinstance(one, str | PathLike)}
