"""What a guide tells while photos are taken: how well the camera is known, where to hold the target, what a frame adds.

Each is a value, told anew: `Guidance` after a photo was taken or deleted, `Look` for every frame.

What a guide is asked: of which target, which camera model, and how good.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Literal

import numpy as np

from calib.cameras import ABILITIES, COMMON, solved_models
from calib.cameras.camera import Camera
from calib.cameras.surface import surface_model
from calib.core.types import KnownPoints, freeze
from calib.judge.checks import STANDARD, read_criteria
from calib.judge.verdict import Criteria, Grade
from calib.judge.views import TargetShape, shape_of_points
from calib.observe.observations import known_points
from designer.base.arrays import Array, Flags
from designer.base.errors import InputError
from designer.base.marks import OR_NULL, Gap
from designer.base.words import shown, suggestion
from designer.target import TargetGeometry
from designer.tolerance.made import Made, how_made

Line = Array

Stage = Literal["first", "guiding", "good", "exhausted"]
"""No camera is known yet; it is, and photos are proposed; it is good; more photos would not make it better."""


@dataclass(frozen=True)
class Bar:
    """How far one of the verdict's checks is."""

    name: str  # of the check: "uncertainty"
    title: str  # "uncertainty"
    text: str  # "0.31 px, 0.05 px wanted"
    share: float  # of what is wanted, 0 to 1
    grade: Grade | Literal["unknown"]


@dataclass(frozen=True, eq=False)
class SensorMap:
    """What is known of each part of an image."""

    sigma_px: Annotated[Array, OR_NULL]  # (R, C) along the worse axis; nan: nothing is known
    is_covered: Flags  # (R, C) surrounded by sightings
    wanted_px: float

    def __post_init__(self) -> None:
        freeze(self, "sigma_px")
        freeze(self, "is_covered", dtype=np.bool_)


@dataclass(frozen=True, eq=False)
class Ghost:
    """Where to hold the target next."""

    cam_from_target: Array  # (4, 4); in a rig of the first camera that is to see it
    sentence: str  # all that is to be said: where, how tilted, how far, and what it gives
    short: str  # to be read from three metres: "bottom left, right side back, 0.45 m"
    distance_mm: float
    tilt_deg: Gap  # of a flat target; nan: a solid
    gain: str  # "0.21 -> 0.13 px"
    is_rough: bool  # the camera is hardly known: only about here


@dataclass(frozen=True, eq=False)
class CameraGuidance:
    """What concerns one camera of a rig, or the only one."""

    name: str
    image_size: tuple[int, int]  # width, height in px
    map: SensorMap | None  # None: the camera is not known yet
    ghost_px: tuple[Line, ...]  # (K, 2) closed lines around the ghost's faces in its image; none: not to be seen there


@dataclass(frozen=True, eq=False)
class TakenPhoto:
    """A photo that was taken; of a rig one of its frames."""

    name: str
    rings: int  # named in it, over all cameras
    is_counted: bool  # the camera is solved from it
    remark: str  # why not, or what to know of it; "" for nothing
    outline_px: tuple[Line, ...]  # (K, 2) around what it shows, in the first camera's image


@dataclass(frozen=True, eq=False)
class Guidance:
    """All that the page shows between two photos."""

    stage: Stage
    headline: str  # "0.31 px in 95 % of the image, 0.05 px wanted; 5 photos"
    bars: tuple[Bar, ...]
    cameras: tuple[CameraGuidance, ...]
    ghost: Ghost | None  # None: nothing is proposed
    photos: tuple[TakenPhoto, ...]  # in the order they were taken
    remarks: tuple[str, ...]


@dataclass(frozen=True)
class FrameNote:
    """Something to say of a frame at once."""

    name: str  # "motion"
    sentence: str  # "hold still: blurred by 4 px"
    forbids: bool  # a frame is not taken by itself with it


@dataclass(frozen=True, eq=False)
class Look:
    """What one frame shows, and whether it is worth taking; stillness is another matter (`calib.judge.live_frame`)."""

    cam_from_target: Array | None  # (4, 4) by the camera as it is known; None: not to be told
    outline_px: tuple[Line, ...]  # (K, 2) around what was found
    worth: float  # what it would add, of what the ghost would: 0 to 1
    is_match: bool  # as the ghost, near enough
    hint: str  # how to come to the ghost from here: "closer, and tilt the right side away"; "" if there
    notes: tuple[FrameNote, ...]
    is_wanted: bool  # worth taking if it is still: a match or of worth, and nothing forbids it


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
