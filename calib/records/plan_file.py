"""plan.json and plan.csv: photos to take of a camera, for its page, people, robots and other programs."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from calib.cameras.camera import Camera
from calib.core.se3 import rigid_fault
from calib.core.types import freeze
from calib.robot.poses import poses_to_csv
from calib.robot.rotations import to_quaternion
from calib.verdict.next_views import NextView
from calib.verdict.plan_tried import TriedPlan
from designer.base.file_kind import FileKind
from designer.base.marks import OR_NULL, AtLeast, AtMost, FewLines, Length, Line, Shape, Word

Array = NDArray[np.float64]

PLAN_FILE, POSES_FILE = "plan.json", "plan.csv"
POSES_KIND = "ringsolid.plan-poses"
MOST_PLANNED = 100
HAND = "hand"
"""What takes photos if nothing carries camera or target."""
ROUNDING = 1e-6
FARTHEST_MM = 1e9
_FIRST_LINE = "# ringsolid plan-poses, version 1"
_TURN = ("target_qx", "target_qy", "target_qz", "target_qw")


@dataclass(frozen=True, eq=False)
class PlanRecord:
    """Photos to take of a camera, in their order, and what they are worth: `record.photos[0].sentence`."""

    program: Word
    settings: Annotated[Mapping[Word, Line], Length(0, 100)]
    geometry_id: Word  # of the target
    target: Line  # the same in words
    camera: Camera  # as it is taken to be
    made: Line  # how the target was, in words; "" if nobody knows
    taken_by: Word  # "hand", or what carries camera or target
    noise_px: Annotated[float, AtLeast(0), AtMost(100)]  # of a coordinate
    goal_px: Annotated[float, AtLeast(1e-9), AtMost(1e6)]  # that 95 % of the image is to stay within, 1 sigma
    goal_covered: Annotated[float, AtLeast(0), AtMost(1)]  # of the image
    photos: Annotated[tuple[NextView, ...], Length(1, MOST_PLANNED)]  # deviations by the noise alone
    distance_mm: Annotated[Array, Shape("V"), AtLeast(0), AtMost(FARTHEST_MM)]  # from the camera to the target's middle
    tilt_deg: Annotated[Array, Shape("V"), OR_NULL, AtLeast(0), AtMost(180)]  # of a flat target
    base_from_flange: Annotated[Array, Shape("V", 4, 4)] | None  # of a robot
    table_deg: Annotated[Array, Shape("V"), AtLeast(-360), AtMost(360)] | None  # of a turntable
    tried: Annotated[tuple[TriedPlan, ...], Length(1, 100)]
    remarks: FewLines

    def __post_init__(self) -> None:
        freeze(self, "distance_mm", "tilt_deg")
        for name in ("base_from_flange", "table_deg"):
            if getattr(self, name) is not None:
                freeze(self, name)
        for name in ("distance_mm", "tilt_deg", "base_from_flange", "table_deg"):
            rows: Array | None = getattr(self, name)
            if rows is not None and len(rows) != len(self.photos):
                raise ValueError(f"{name} has {len(rows)} rows for {len(self.photos)} photos")
        if self.base_from_flange is not None:
            if self.table_deg is not None:
                raise ValueError("base_from_flange and table_deg: a robot or a turntable, not both")
            if fault := rigid_fault(self.base_from_flange):
                raise ValueError(f"base_from_flange {fault[1]}")

    @property
    def worst_px(self) -> float:
        """What 95 % of the image stayed within at the worst try; infinite: it was not determined."""
        return max(one.stated_px for one in self.tried)

    @property
    def covered(self) -> float:
        """Of the image, by all photos."""
        return self.photos[-1].covered_after

    @property
    def is_reached(self) -> bool:
        """Whether the image is covered and, each time it was tried, known as well as wanted."""
        return self.worst_px <= self.goal_px and self.covered >= self.goal_covered - ROUNDING

    @property
    def is_limited_by_target(self) -> bool:
        """Whether only the target's making is in the way: the noise of the photos would reach what is wanted."""
        worst = max(self.tried, key=lambda one: one.stated_px)
        is_covered = self.covered >= self.goal_covered - ROUNDING
        return is_covered and worst.by_noise_px <= self.goal_px < worst.stated_px < math.inf


PLAN = FileKind(PlanRecord, "plan", "a plan.json", "make the plan again: calib plan", largest_bytes=16 * 2**20)


def photo_names(count: int) -> tuple[str, ...]:
    """What photos of a plan are called: photo-01 and so on."""
    digits = max(2, len(str(count)))
    return tuple(f"photo-{number:0{digits}d}" for number in range(1, count + 1))


def plan_csv(record: PlanRecord) -> bytes:
    """The poses as a table: of a robot's flange as `calib hand-eye` reads them, of a turntable the angles.

    Of what a person holds it is the target's pose before the camera, in columns that no robot's table has.
    """
    names = photo_names(len(record.photos))
    if record.base_from_flange is not None:
        return poses_to_csv((_FIRST_LINE, "# base_from_flange of each photo"), names, record.base_from_flange)
    columns: tuple[str, ...] = ("table_deg",)
    if record.table_deg is not None:
        said, numbers = "angle of the turntable", record.table_deg[:, None]
    else:
        pose = np.array([photo.cam_from_target for photo in record.photos])
        said, columns = "cam_from_target of each photo", ("target_x_mm", "target_y_mm", "target_z_mm", *_TURN)
        numbers = np.column_stack([pose[:, :3, 3], to_quaternion(pose[:, :3, :3])])
    rows = (
        ",".join([name, *(f"{value:.9g}" for value in row)]) for name, row in zip(names, numbers.tolist(), strict=True)
    )
    return ("\n".join([_FIRST_LINE, f"# {said}", ",".join(["image", *columns]), *rows]) + "\n").encode()
