"""NAME.as_built.json: how a print differs from its design, for its page, `calib measure --json` and other programs."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from calib.as_built.cross_validation import CrossValidation
from calib.as_built.deviations import (
    ORDER,
    Compensation,
    Verdict,
    WholePrint,
    bed_axes,
    compensation_percent,
    face_verdicts,
    next_skew_rad,
    whole_print,
)
from calib.as_built.lengths import FittedLength
from calib.as_built.result import AsBuilt
from calib.as_built.seats import Seats, seats_of
from calib.coupons.ink_of_rings import InkBleed
from calib.solver.calibration import Status
from designer.base.file_kind import FileKind
from designer.base.marks import (
    INLINE,
    OR_NULL,
    AtLeast,
    AtMost,
    Count,
    FewLines,
    Gap,
    Length,
    Number,
    Shape,
    Word,
)  # fmt: skip
from designer.base.units import Skew
from designer.tolerance.model import ErrorModel

MOST_FACES, MOST_RINGS = 2000, 100_000
LARGEST = 1e6
"""In mm, rad, or the square of these: nothing that is printed is off by as much."""

Array = NDArray[np.float64]
Sizes = Annotated[Array, OR_NULL, AtLeast(-LARGEST), AtMost(LARGEST)]
Flags = NDArray[np.bool_]


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
    rms_px: Gap


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
    observation_sigma: Gap
    size_is_known: bool
    size_sigma: Gap
    whole: Annotated[WholePrint, INLINE]
    bed_axes_from_target: Annotated[Array, Shape(3, 3)]
    made_with: Annotated[Compensation, INLINE]
    next_shrink_compensation_percent: Number | None
    next_skew_compensation_rad: Skew
    strain: Annotated[Sizes, Shape(3, 3)]
    strain_covariance: Annotated[Sizes, Shape(6, 6)]
    lengths: Annotated[tuple[FittedLength, ...], Length(0, 100)]
    face_views: Annotated[NDArray[np.int64], Shape("F"), Length(1, MOST_FACES)]
    face_is_determined: Annotated[Flags, Shape("F")]
    face_motion: Annotated[Sizes, Shape("F", 6)]  # rotation vector (rad), shift (mm), in the face's frame
    face_motion_covariance: Annotated[Sizes, Shape("6 F", "6 F")]
    face_verdict: Annotated[tuple[Verdict, ...], Length(0, MOST_FACES)]  # none for a single face
    face_bow_mm: Annotated[Sizes, Shape("F", 3)]
    face_bow_covariance: Annotated[Sizes, Shape("F", 3, 3)]
    ring_sigma_mm: tuple[Number, Number] | None
    ring_is_seen: Annotated[Flags, Shape("R"), Length(1, MOST_RINGS)]
    ring_offset_mm: Annotated[Sizes, Shape("R", 3)]  # in the ring's face's frame
    ring_offset_sigma_mm: Annotated[Sizes, Shape("R", 3)]
    cameras: Annotated[tuple[SolvedCamera, ...], Length(0, 100)]
    held_out: CrossValidation | None  # None: nobody asked
    weighted: bool = True  # by stated covariances, in which the standard deviation of an observation is told then
    seats: Seats | None = None  # how the pieces sit of a target that was put together; None: one print
    ink_bleed: InkBleed | None = None  # None: the rings do not tell

    def __post_init__(self) -> None:
        faces = len(self.face_motion)
        if len(self.face_motion_covariance) != 6 * faces:
            raise ValueError(f"face_motion_covariance must be of {6 * faces} numbers, as face_motion is")
        if len(self.face_verdict) not in (0, faces):
            raise ValueError(f"face_verdict must be of {faces} faces, as face_motion is, or empty")

    @property
    def motion(self) -> Array:
        """How each face lies: shift (mm), rotation vector (rad), in its frame.  # (F, 6)"""
        return self.face_motion[:, ORDER]

    @cached_property
    def motion_sigma(self) -> Array:
        """Standard deviations of these.  # (F, 6)"""
        variance = np.diagonal(self.face_motion_covariance)
        return np.sqrt(np.maximum(variance, 0.0)).reshape(-1, 6)[:, ORDER]


AS_BUILT = FileKind(AsBuiltRecord, "as_built", "the report on a measured print", "measure the print again")


def record_of(
    found: AsBuilt,
    held_out: CrossValidation | None,
    made_with: Compensation,
    *,
    bed_turn_rad: float,
    weighted: bool,
    remarks: tuple[str, ...],
    made: ErrorModel | None = None,
    ink_bleed: InkBleed | None = None,
    program: str,
    settings: Mapping[str, str],
) -> AsBuiltRecord:
    """All there is to say of a measured print.

    Args:
        found: the solution.
        held_out: what is gained on photos that take no part.
        made_with: which corrections the print was made with.
        bed_turn_rad: by which it was turned on the bed against `design`.
        weighted: by stated covariances.
        remarks: beside those of the solution.
        made: the errors of its way of making.
        ink_bleed: how much wider its ink is.
        program: name and version.
        settings: names and values of the options.
    """
    whole, seats = whole_print(found, bed_turn_rad), seats_of(found, made)
    if seats is not None:  # pieces that were printed one by one have no axes in common
        whole = WholePrint(whole.size, {}, {})
    size = whole.size
    return AsBuiltRecord(
        program=program,
        settings=settings,
        layout_id=found.nominal.layout_id,
        nominal_geometry_id=found.nominal.geometry_id,
        measured_geometry_id=found.target.geometry_id,
        status=found.status,
        remarks=(*found.remarks, *remarks),
        iterations=found.iterations,
        observation_sigma=found.scale,
        size_is_known=found.scale_known,
        size_sigma=found.scale_sigma,
        whole=whole,
        bed_axes_from_target=bed_axes(found.nominal, bed_turn_rad),
        made_with=made_with,
        next_shrink_compensation_percent=(
            None if size is None else compensation_percent(size.value, made_with.shrink_percent)
        ),
        next_skew_compensation_rad=next_skew_rad(whole, made_with.skew_rad),
        strain=found.strain,
        strain_covariance=found.strain_covariance,
        lengths=found.lengths,
        face_views=found.face_views,
        face_is_determined=found.is_determined,
        face_motion=found.motion,
        face_motion_covariance=found.motion_covariance,
        face_verdict=face_verdicts(found),
        face_bow_mm=found.bow_mm,
        face_bow_covariance=found.bow_covariance,
        ring_sigma_mm=found.ring_sigma_mm,
        ring_is_seen=found.is_ring_seen,
        ring_offset_mm=found.offset_mm,
        ring_offset_sigma_mm=found.offset_sigma_mm,
        cameras=tuple(_cameras(found)),
        held_out=held_out,
        seats=seats,
        weighted=weighted,
        ink_bleed=ink_bleed,
    )


def _cameras(found: AsBuilt) -> Iterator[SolvedCamera]:
    for camera, covariance, seen, residual, is_outlier in zip(
        found.cameras, found.param_covariance, found.observations, found.residual_px, found.is_outlier, strict=True
    ):
        used = residual[~is_outlier]
        rms_px = float(np.sqrt((used**2).sum(axis=1).mean())) if len(used) else math.nan
        yield SolvedCamera(
            camera.model, camera.image_size, camera.parameters, covariance, seen.view_count, len(seen.view),
            int(is_outlier.sum()), rms_px,
        )  # fmt: skip
