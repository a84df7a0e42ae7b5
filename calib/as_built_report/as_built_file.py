"""NAME.as_built.json: how a print differs from its design, for its page and other programs."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from calib.as_built_report.deviations import ORDER, Estimate, WholePrint
from calib.as_built_report.held_out import Gain
from calib.solver.calibration import Status
from designer.base.file_kind import FileKind
from designer.base.marks import (
    OR_NULL,
    AtLeast,
    AtMost,
    Count,
    FewLines,
    Length,
    Number,
    OneOf,
    Shape,
    Word,
)  # fmt: skip
from designer.base.units import Skew

MOST_FACES, MOST_RINGS = 2000, 100_000
LARGEST_STRAIN = 0.5
"""A size, stretch or angle (rad) beyond this is no print's: nothing can be dialled in against it."""
LARGEST = 1e6
"""In mm, rad, or the square of these: nothing that is printed is off by as much."""

Array = NDArray[np.float64]
Axis = Annotated[str, OneOf(("x", "y", "z"))]
Angle = Annotated[str, OneOf(("xy", "xz", "yz"))]
Sizes = Annotated[Array, OR_NULL, AtLeast(-LARGEST), AtMost(LARGEST)]
Flags = NDArray[np.bool_]


@dataclass(frozen=True)
class LengthRecord:
    """A length that was given."""

    name: Word
    value_mm: Number
    sigma_mm: Number
    left_over_sigma: Number | None


@dataclass(frozen=True, eq=False)
class SolvedCamera:
    """A camera that was solved beside."""

    model: Word
    image_size: tuple[int, int]
    params: Mapping[Word, Number]
    param_covariance: Annotated[Array, Shape("P", "P"), OR_NULL]
    views: Count
    observations: Count
    left_out: Count
    rms_px: Number | None


@dataclass(frozen=True)
class HeldOutRecord:
    """What is gained on photos held out."""

    parts: Count
    gains: Annotated[tuple[Gain, ...], Length(0, 20)]
    against_truth: Annotated[tuple[Gain, ...], Length(0, 20)]
    remarks: FewLines
    is_better: bool | None = None


@dataclass(frozen=True, eq=False)
class AsBuiltRecord:
    """A measured print: F faces and R rings. Null is not known."""

    program: Word
    settings: Annotated[Mapping[Word, Annotated[str, Length(0, 100_000)]], Length(0, 100)]
    layout_id: Word
    nominal_geometry_id: Word
    measured_geometry_id: Word
    status: Status
    remarks: FewLines
    iterations: Count
    observation_sigma: Number | None
    size_is_known: bool
    size_sigma: Number | None
    size: Estimate | None
    axes: Mapping[Axis, Estimate]
    skews_rad: Mapping[Angle, Estimate]
    bed_axes_from_target: Annotated[Array, Shape(3, 3)]
    made_with_shrink_compensation_percent: Number
    next_shrink_compensation_percent: Number | None
    made_with_skew_compensation_rad: tuple[Number, Number, Number]  # xy, xz, yz
    next_skew_compensation_rad: tuple[Number, Number, Number]
    strain: Annotated[Sizes, Shape(3, 3)]
    strain_covariance: Annotated[Sizes, Shape(6, 6)]
    lengths: Annotated[tuple[LengthRecord, ...], Length(0, 100)]
    face_views: Annotated[NDArray[np.int64], Shape("F"), Length(1, MOST_FACES)]
    face_is_determined: Annotated[Flags, Shape("F")]
    face_motion: Annotated[Sizes, Shape("F", 6)]  # rotation vector (rad), shift (mm), in the face's frame
    face_motion_covariance: Annotated[Sizes, Shape("6 F", "6 F")]
    face_verdict: Annotated[tuple[Word, ...], Length(0, MOST_FACES)]
    face_bow_mm: Annotated[Sizes, Shape("F", 3)]
    face_bow_covariance: Annotated[Sizes, Shape("F", 3, 3)]
    ring_sigma_mm: tuple[Number, Number] | None
    ring_is_seen: Annotated[Flags, Shape("R"), Length(1, MOST_RINGS)]
    ring_offset_mm: Annotated[Sizes, Shape("R", 3)]  # in the ring's face's frame
    ring_offset_sigma_mm: Annotated[Sizes, Shape("R", 3)]
    cameras: Annotated[tuple[SolvedCamera, ...], Length(0, 100)]
    held_out: HeldOutRecord | None

    def __post_init__(self) -> None:
        if len(self.face_motion_covariance) != 6 * len(self.face_motion):
            raise ValueError(
                f"face_motion_covariance must be of {6 * len(self.face_motion)} numbers, as face_motion is"
            )

    @property
    def whole(self) -> WholePrint:
        """Size and shape of the whole print."""
        return WholePrint(
            size=None if self.size is None or not self.size.is_known else self.size,
            axes=tuple((name, one) for name, one in self.axes.items() if one.is_known),
            skews=tuple((name, one) for name, one in self.skews_rad.items() if one.is_known),
        )

    @property
    def made_with_skew(self) -> Skew:
        """The skew compensation of this print."""
        return self.made_with_skew_compensation_rad

    @property
    def can_be_corrected(self) -> bool:
        """Whether size and shape are numbers that a printer could make."""
        known = [one for one in (self.size, *self.axes.values(), *self.skews_rad.values()) if one is not None]
        dialled = abs(self.made_with_shrink_compensation_percent) / 100, *map(abs, self.made_with_skew)
        return max(dialled) < LARGEST_STRAIN and all(
            np.isfinite(one.sigma) and abs(one.value) < LARGEST_STRAIN for one in known
        )

    @property
    def face_count(self) -> int:
        """F."""
        return len(self.face_motion)

    @property
    def motion(self) -> Array:
        """How each face lies: shift (mm), rotation vector (rad), in its frame.  # (F, 6)"""
        return self.face_motion[:, ORDER]

    @cached_property
    def motion_sigma(self) -> Array:
        """Standard deviations of these.  # (F, 6)"""
        variance = np.diagonal(self.face_motion_covariance)
        return np.sqrt(np.maximum(variance, 0.0)).reshape(-1, 6)[:, ORDER]

    @property
    def verdicts(self) -> tuple[str, ...]:
        """Whether each face moved; nothing for a single one, of which that is the pose."""
        return self.face_verdict if len(self.face_verdict) == self.face_count else ()


AS_BUILT = FileKind(AsBuiltRecord, "as_built", "the report on a measured print", "measure the print again")


def settings_of(record: AsBuiltRecord) -> Mapping[str, str]:
    """The options of the command, those that were given."""
    return {name: value for name, value in record.settings.items() if value.strip()}
