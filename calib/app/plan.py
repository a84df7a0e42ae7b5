"""Photos to take of a camera, before any is taken: `calib plan`, `calib.plan("ico.target.json", "webcam")`."""

import math
from dataclasses import dataclass, replace
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

from calib.app.options import Limits, Made, Target, exports_folder
from designer.base.answer import program
from designer.base.errors import InputError
from designer.base.files import named_in_files, place_of
from designer.base.marks import NOT_IN_FILE
from designer.base.options import option
from designer.base.words import capital, printable
from designer.base.words import figure as digits
from designer.kinds.presets import camera_templates
from designer.page.capability import capability
from designer.page.progress import Progress, unheard
from designer.page.result import Result

if TYPE_CHECKING:
    from calib.app.inputs import Place
    from calib.cameras.camera import Camera
    from calib.judge.hand_eye_file import HandEye
    from calib.judge.next_views import NextView
    from calib.judge.planned_views import TriedPlan
    from designer.base.arrays import Array
    from designer.base.files import JsonValue
    from designer.page.blocks import Page
    from designer.target import TargetGeometry

POSES_FILE = "plan.csv"
FEWEST, MOST = 6, 100
HAND = "hand"
"""What takes photos if nothing carries camera or target."""
TABLE_STEP_DEG = 5.0
ROUNDING = 1e-6
_FIRST_LINE = "# ringsolid plan-poses, version 1"
_HELD_COLUMNS: tuple[str, ...] = (*(f"target_{axis}_mm" for axis in "xyz"), *(f"target_q{axis}" for axis in "xyzw"))


@dataclass(frozen=True, eq=False)
class PhotoPlan(
    Result, kind="plan", title="Plan of photos",
    files={POSES_FILE: "the poses, or the turntable's angles, for a robot or a program"},
):  # fmt: skip
    """Photos to take of a camera, in their order: `found.photos[0].sentence`, `found.worst_px`."""

    geometry: Annotated["TargetGeometry", NOT_IN_FILE]
    camera: Annotated["Camera", NOT_IN_FILE]  # as it is taken to be
    program: str
    settings: dict[str, str]
    geometry_id: str
    target: str  # in words
    made: str  # how the target was, in words; "" if nobody knows
    taken_by: str  # "hand", or what carries camera or target
    noise_px: float  # of a coordinate
    goal_px: float  # that 95 % of the image is to stay within, 1 sigma
    goal_covered: float  # of the image
    photos: "tuple[NextView, ...]"  # deviations by the noise alone
    distance_mm: "Array"  # (V,) from the camera to the target's middle
    tilt_deg: "Array"  # (V,) of a flat target; nan of a solid
    base_from_flange: "Array | None"  # (V, 4, 4) of a robot
    table_deg: "Array | None"  # (V,) of a turntable
    tried: "tuple[TriedPlan, ...]"
    remarks: tuple[str, ...]

    @property
    def worst(self) -> "TriedPlan":
        """The worst try."""
        return max(self.tried, key=lambda one: one.stated_px)

    @property
    def worst_px(self) -> float:
        """What 95 % of the image stayed within at the worst try; infinite: it was not determined."""
        return self.worst.stated_px

    @property
    def covered(self) -> float:
        """Of the image, by all photos."""
        return self.photos[-1].covered_after

    @property
    def is_covered(self) -> bool:
        """Whether as much of the image is as is wanted."""
        return self.covered >= self.goal_covered - ROUNDING

    @property
    def is_reached(self) -> bool:
        """Whether the image is covered and, each time it was tried, known as well as wanted."""
        return self.worst_px <= self.goal_px and self.is_covered

    @property
    def is_limited_by_target(self) -> bool:
        """Whether only the target's making is in the way: the noise of the photos would reach what is wanted."""
        return self.is_covered and self.worst.by_noise_px <= self.goal_px < self.worst_px < math.inf

    @property
    def is_negative(self) -> bool:
        """Whether the goal is not reached."""
        return not self.is_reached

    @property
    def is_by_hand(self) -> bool:
        """Whether nothing carries camera or target."""
        return self.taken_by == HAND

    @property
    def photo_names(self) -> tuple[str, ...]:
        """What photos are called: photo-01 and so on."""
        digits = max(2, len(str(len(self.photos))))
        return tuple(f"photo-{number:0{digits}d}" for number in range(1, len(self.photos) + 1))

    @property
    def sentences(self) -> tuple[str, ...]:
        """The photos as a person takes them; what each is worth by the noise alone stands in a table."""
        return tuple(capital(printable(photo.sentence.partition(": ")[0] or photo.sentence)) for photo in self.photos)

    def document(self) -> "dict[str, JsonValue]":
        """Its fields without outlines, and what comes of them."""
        document = super().document()
        for photo in cast("list[dict[str, JsonValue]]", document["photos"]):
            del photo["outline_px"]
        worst_px = self.worst_px if math.isfinite(self.worst_px) else None
        return {**document, "is_reached": self.is_reached, "worst_px": worst_px, "covered": self.covered}

    def tables(self) -> dict[str, bytes]:
        """`plan.csv`: of a robot's flange as `calib hand-eye` reads it, of a turntable the angles.

        Of what a person holds it is the target's pose before the camera, in columns that no robot's table has.
        """
        import numpy as np

        from calib.observe.robot_poses import poses_to_csv
        from calib.observe.rotations import to_quaternion

        if self.base_from_flange is not None:
            head = _FIRST_LINE, "# base_from_flange of each photo"
            return {POSES_FILE: poses_to_csv(head, self.photo_names, self.base_from_flange)}
        if self.table_deg is not None:
            said, numbers = "angle of the turntable", self.table_deg[:, None]
            columns: tuple[str, ...] = ("table_deg",)
        else:
            pose = np.array([photo.cam_from_target for photo in self.photos])
            said, columns = "cam_from_target of each photo", _HELD_COLUMNS
            numbers = np.column_stack([pose[:, :3, 3], to_quaternion(pose[:, :3, :3])])
        rows = (
            ",".join([name, *(f"{value:.9g}" for value in row)])
            for name, row in zip(self.photo_names, numbers.tolist(), strict=True)
        )
        lines = _FIRST_LINE, f"# {said}", ",".join(["image", *columns]), *rows
        return {POSES_FILE: ("\n".join(lines) + "\n").encode()}

    def page(self) -> "Page":
        """Photos to take, each as it will look, and what they are worth."""
        from calib.app.plan_page import plan_page

        return plan_page(self)


@capability(folder=lambda given: exports_folder(cast(Path, given["target"])) / "plan")
def plan(
    target: Target,
    camera: Annotated[
        "Camera | Place", option("about as it is: its file, or a template such as webcam", complete=camera_templates)
    ],
    *,
    within_px: Annotated[
        float | None,
        option("what 95 % of the image is to stay within: 0.05px (default: as the criteria say)", 1e-3, 100),
    ] = None,
    criteria: Limits = "standard",
    noise_px: Annotated[float, option("of a coordinate of a large mark", 1e-3, 10)] = 0.05,
    distance_mm: Annotated[
        tuple[float, float] | None,
        option("where the target may be: 0.3m..0.8m (default: where it fills 30 to 90 %)", 1.0, 1e4),
    ] = None,
    most: Annotated[int, option("photos at most", FEWEST, MOST)] = 40,
    made: Made = None,
    hand_eye: Annotated[
        "HandEye | Place | None",
        option("what calib hand-eye or calib turntable wrote: poses are the robot's, or the table's angles"),
    ] = None,
    progress: Progress = unheard,
) -> PhotoPlan:
    """Plan the fewest photos that make a camera known as well as wanted: `plan("ico.target.json", "camera.json")`.

    Without a camera at hand. The exit code is 1 if they do not reach it.

    >>> found = calib.plan("ico.target.json", "action-camera", within_px=0.05)
    >>> [photo.sentence for photo in found.photos]

    Photos are chosen one after the other by what they tell, then left out and exchanged. Each plan is tried: photos
    are simulated as a person holds the target (a robot exactly), and the camera is solved from them.

    Raises:
        InputError: a file that cannot be read, options that break a rule, or a target that cannot be held so that it
            is read.
    """
    import numpy as np

    from calib.app.cameras_told import remarks_on
    from calib.app.inputs import opened_camera, target_of
    from calib.judge.guide_state import settings_of
    from calib.judge.planned_views import (
        PlanWish,
        calibration_before,
        front_of,
        plan_that_holds,
        planned_camera,
        usual_hold,
    )
    from calib.judge.verdict import Criteria
    from calib.judge.views import shape_of

    geometry, read = target_of(target, "rings"), opened_camera(camera).read
    settings = settings_of(geometry, criteria if isinstance(criteria, Criteria) else fspath(criteria), made=made)
    goal_px = settings.criteria["uncertainty"].good if within_px is None else within_px
    hand = _hand_of(hand_eye)
    planned, of_lens = planned_camera(read.camera, goal_px)
    before = calibration_before(planned, front_of(geometry, settings.points), noise_px)
    shape = shape_of(before)
    if shape is None:
        raise InputError("the target's points lie on no known plane, so what a photo shows of it is not known")
    held, angle_deg, at = usual_hold(before, shape, distance_mm), None, None
    if hand is not None and hand.frame == "table":
        if distance_mm is not None:
            raise InputError("--distance: a turntable's target stays where it stands; leave it out")
        angle_deg = np.arange(0.0, 360.0, TABLE_STEP_DEG)
        at = hand.cam_from_target_on_table(np.radians(angle_deg))
        away_mm = np.linalg.norm(at[:, :3, :3] @ shape.center_mm + at[:, :3, 3], axis=1)
        held = replace(held, distance_mm=(float(away_mm.min()), float(away_mm.max())))
    # A table shows the target where it stands.
    goal_covered = settings.criteria["coverage"].good / 100 if at is None else 0.0
    progress("trying plans", 0, 0)
    worked_out = plan_that_holds(
        PlanWish(before, shape, held, goal_px, goal_covered, most, settings.made, at, is_held_exactly=hand is not None)
    )
    if worked_out is None:
        raise InputError(_why_nothing(held.distance_mm, is_on_table=at is not None))
    found, tried = worked_out
    poses, table_deg = np.stack([one.cam_from_target for one in found.views]), None
    if at is not None and angle_deg is not None:
        table_deg = angle_deg[np.abs(at - poses[:, None]).sum(axis=(2, 3)).argmin(axis=1)]
    files = {"target": target, "camera": camera, "hand-eye": hand_eye}
    remarks = (
        (of_lens, True),
        ("photos are of the front of the board; what its back would tell is not counted",
         geometry.is_plate and not geometry.is_planar),
        ("how the target was made is not known: its errors come on top; --made says how it was", settings.made is None),
        ("whether the robot reaches a pose without touching anything is not known: look before it moves",
         hand is not None and at is None),
    )  # fmt: skip
    return PhotoPlan(
        geometry=geometry, camera=planned, program=program(),
        settings={what: named_in_files(Path(one)) for what, one in files.items() if isinstance(one, str | PathLike)},
        geometry_id=geometry.geometry_id, target=geometry.words,
        made="" if settings.made is None else settings.made.sentence, taken_by=HAND if hand is None else hand.carried,
        noise_px=noise_px, goal_px=goal_px, goal_covered=goal_covered,
        photos=_worded(found.views, table_deg, is_by_hand=hand is None), distance_mm=found.distance_mm,
        tilt_deg=found.tilt_deg, base_from_flange=hand.base_from_flange(poses) if hand and at is None else None,
        table_deg=table_deg, tried=tried,
        remarks=(*remarks_on("the camera", read), *(text for text, is_so in remarks if is_so)),
    )  # fmt: skip


def _hand_of(hand_eye: "HandEye | Place | None") -> "HandEye | None":
    """What holds camera or target, or that of a file or a folder; None: a person does."""
    from calib.judge.hand_eye_file import HAND_EYE, HAND_EYE_FILE, HandEye

    if hand_eye is None or isinstance(hand_eye, HandEye):
        return hand_eye
    place = place_of(hand_eye, "a hand_eye.json, or its folder")
    return HAND_EYE.read(place / HAND_EYE_FILE if place.is_dir() else place)


def _why_nothing(distance_mm: tuple[float, float], *, is_on_table: bool) -> str:
    near, far = (digits(one, 3) for one in distance_mm)
    if is_on_table:
        return (
            f"the turntable's target, {near} to {far} mm away, is not read at any angle: its marks are too small in "
            "the image, or outside; give the hand_eye.json of this camera where it stands now"
        )
    return (
        f"no photo from {near} to {far} mm away shows enough of the target's marks; give other distances with "
        "--distance, or a larger target"
    )


def _worded(
    views: "tuple[NextView, ...]", table_deg: "Array | None", *, is_by_hand: bool
) -> "tuple[NextView, ...]":  # fmt: skip
    """The photos as they are told: of a turntable by its angle, and no two with the same words."""
    told, photos = set[str](), []
    for number, view in enumerate(views):
        first, colon, gain = view.sentence.partition(": ")
        head = first if is_by_hand else first.replace("hold the", "show the", 1)
        if head in told and is_by_hand:
            head = head.replace("any side", "another side") if "any side" in head else f"{head}, a little otherwise"
        told.add(first)
        head = head if table_deg is None else f"turn the table to {float(table_deg[number]):g} deg"
        photos.append(replace(view, sentence=f"{head}{colon}{gain}"))
    return tuple(photos)
