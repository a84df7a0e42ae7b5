"""All that is told of a measured print: `NAME.as_built.json`, and `NAME.as_built.csv` with a line a number."""

import csv
import io
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated

import numpy as np

from calib.core.linear_algebra import rms_length
from calib.core.se3 import exp_rotation
from calib.measure_target.cross_validation import CrossValidation, Gain
from calib.measure_target.deviations import (
    FREE_PARAMETERS,
    ORDER,
    Compensation,
    Estimate,
    Verdict,
    WholePrint,
    bed_axes,
    bent_mm,
    compensation_percent,
    face_verdicts,
    next_skew_rad,
    whole_print,
)
from calib.measure_target.lengths import FittedLength
from calib.measure_target.result import AsBuilt
from calib.measure_target.tile_fit import Seats, seats_of
from calib.solver.calibration import Status
from designer.base.arrays import Array, Flags, Rows
from designer.base.marks import INLINE, OR_NULL, Gap
from designer.base.units import Skew
from designer.target import TargetGeometry
from designer.tolerance.model import ErrorModel
from designer.tolerance.shape import face_middle_mm

Sizes = Annotated[Array, OR_NULL]


@dataclass(frozen=True, eq=False)
class SolvedCamera:
    """A camera that was solved beside."""

    model: str
    image_size: tuple[int, int]
    params: Mapping[str, float]
    param_covariance: Sizes
    views: int
    observations: int
    left_out: int
    rms_px: Gap


@dataclass(frozen=True, eq=False)
class AsBuiltRecord:
    """A measured print: F faces and R rings. Null is not known."""

    program: str
    settings: Mapping[str, str]
    layout_id: str
    nominal_geometry_id: str
    measured_geometry_id: str
    status: Status
    remarks: tuple[str, ...]
    iterations: int
    observation_sigma: Gap
    size_is_known: bool
    size_sigma: Gap
    whole: Annotated[WholePrint, INLINE]
    bed_axes_from_target: Array
    made_with: Annotated[Compensation, INLINE]
    next_shrink_compensation_percent: float | None
    next_skew_compensation_rad: Skew
    strain: Sizes
    strain_covariance: Sizes
    lengths: tuple[FittedLength, ...]
    face_views: Rows
    face_is_determined: Flags
    face_motion: Sizes  # rotation vector (rad), shift (mm), in the face's frame
    face_motion_covariance: Sizes
    face_verdict: tuple[Verdict, ...]  # none for a single face
    face_bow_mm: Sizes
    face_bow_covariance: Sizes
    ring_sigma_mm: tuple[float, float] | None
    ring_is_seen: Flags
    ring_offset_mm: Sizes  # in the ring's face's frame
    ring_offset_sigma_mm: Sizes
    cameras: tuple[SolvedCamera, ...]
    held_out: CrossValidation | None  # None: nobody asked
    weighted: bool = True  # by stated covariances, in which the standard deviation of an observation is told then
    seats: Seats | None = None  # how the pieces sit of a target that was put together; None: one print

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
    def judged_gain(self) -> Gain | None:
        """The error in cross-validation that says most."""
        return None if self.held_out is None else self.held_out.judged_by


def record_of(
    found: AsBuilt,
    held_out: CrossValidation | None,
    made_with: Compensation,
    *,
    bed_turn_rad: float,
    weighted: bool,
    remarks: tuple[str, ...],
    made: ErrorModel | None = None,
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
    )


def _cameras(found: AsBuilt) -> Iterator[SolvedCamera]:
    for camera, covariance, seen, residual, is_outlier in zip(
        found.cameras, found.param_covariance, found.observations, found.residual_px, found.is_outlier, strict=True
    ):
        yield SolvedCamera(
            camera.model, camera.image_size, camera.parameters, covariance, seen.view_count, len(seen.view),
            int(is_outlier.sum()), rms_length(residual[~is_outlier]),
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Deviations:
    """Where each of R rings lies against the design, the stretch of the whole print taken off."""

    in_face_mm: Array  # (R, 3) in the axes of its face; nan: not known
    size_mm: Array  # (R,)

    @property
    def known(self) -> Rows:
        """Rings of which it is known."""
        return np.flatnonzero(np.isfinite(self.size_mm))


def deviations_of(record: AsBuiltRecord, target: TargetGeometry) -> Deviations:
    """What offsets, bow and motion of its face do to each ring.

    A ring designed at c lies at exp(w) (c + o + z b) + t, see `calib.measure_target.unknowns`. For c stands where
    it was measured, less offset and bow: what that changes is a product of two deviations.
    """
    face = target.ring_face
    bent = bent_mm(target, record.ring_offset_mm, record.face_bow_mm)
    design = target.center_in_face_mm - bent
    design[:, 2] = 0.0
    motion = told_motion(record, target)
    turn = exp_rotation(np.nan_to_num(motion[:, 3:]))
    moved = np.einsum("rij,rj->ri", turn[face], design + bent) + motion[face, :3]
    in_face = moved - design
    in_face[~(record.ring_is_seen & record.face_is_determined[face])] = np.nan
    return Deviations(in_face, np.linalg.norm(in_face, axis=1))


def told_motion(record: AsBuiltRecord, target: TargetGeometry) -> Array:
    """How each face lies, as the tables tell it: shift (mm), rotation vector (rad), in its frame.  # (F, 6)

    Of pieces it is the motion about the middle of the face, against those that sit well: shift t there and rotation R
    about the middle m are R and t + m - R m about the frame's origin.
    """
    if record.seats is None:
        return record.motion
    numbers = [
        (one.shift_x_mm, one.shift_y_mm, one.height_mm, one.tilt_x_rad, one.tilt_y_rad, one.turn_rad)
        for one in sorted(record.seats.seats, key=lambda one: one.face)
    ]
    motion = np.array([[each.value for each in one] for one in numbers])
    middle = np.pad(face_middle_mm(target), ((0, 0), (0, 1)))
    motion[:, :3] += middle - np.einsum("fij,fj->fi", exp_rotation(np.nan_to_num(motion[:, 3:])), middle)
    return motion


COLUMNS = ("part", "number", "face", "i", "j", "quantity", "value", "sigma", "significance", "unit", "is_known")
TABLE_FORMAT = "ringsolid.as-built"
_KIND_LINE = "# ringsolid as-built deviations, version 1\n"


def table_to_csv(record: AsBuiltRecord, bleed_mm: Estimate | None, nominal: TargetGeometry) -> str:
    """A line a number, with its standard deviation and how many of them it is from zero."""
    stream = io.StringIO(newline="")
    stream.write(_KIND_LINE)
    stream.write("# faces and rings in the axes of their face, z outwards; the stretch of the whole print taken off\n")
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(COLUMNS)
    for place, quantity, one, unit, is_known in _rows(record, bleed_mm, nominal):
        significance = f"{one.significance:.3g}" if math.isfinite(one.significance) else ""
        writer.writerow((*place, quantity, f"{one.value:.9g}", f"{one.sigma:.4g}", significance, unit, int(is_known)))
    return stream.getvalue()


_Place = tuple[str | int, ...]
_Row = tuple[_Place, str, Estimate, str, bool]


def _seat_rows(seats: Seats) -> Iterator[_Row]:
    """As the table of the page has them."""
    if seats.common_height_mm is not None:
        yield ("print", "", "", "", ""), "common height", seats.common_height_mm, "mm", True
    for one in seats.seats:
        numbers = (one.shift_x_mm, one.shift_y_mm, one.height_mm, one.tilt_x_rad, one.tilt_y_rad, one.turn_rad)
        for name, number in zip(FREE_PARAMETERS, numbers, strict=True):
            unit = "mm" if name.startswith("shift") else "rad"
            yield ("face", one.face, one.face, "", ""), name, number, unit, one.verdict != "not known"


def _rows(record: AsBuiltRecord, bleed_mm: Estimate | None, nominal: TargetGeometry) -> Iterator[_Row]:
    whole, of_print = record.whole, ("print", "", "", "", "")
    if whole.size is not None:
        yield of_print, "size", whole.size, "1", True
    for name, one in whole.axes.items():
        yield of_print, f"axis {name}", one, "1", True
    for name, one in whole.skews_rad.items():
        yield of_print, f"skew {name}", one, "rad", True
    if bleed_mm is not None:
        yield of_print, "ink bleed", bleed_mm, "mm", True
    if record.seats is not None:
        yield from _seat_rows(record.seats)
    for face, verdict in enumerate(record.face_verdict if record.seats is None else ()):
        for name, value, sigma in zip(FREE_PARAMETERS, record.motion[face], record.motion_sigma[face], strict=True):
            unit, place = "mm" if name.startswith("shift") else "rad", ("face", face, face, "", "")
            yield place, name, Estimate(float(value), float(sigma)), unit, verdict != "not known"
    if record.ring_sigma_mm is None and not record.face_bow_mm.any():
        return
    offset_mm = bent_mm(nominal, record.ring_offset_mm, record.face_bow_mm)
    for ring in np.flatnonzero(record.ring_is_seen & record.face_is_determined[nominal.ring_face]).tolist():
        place = ("ring", ring, int(nominal.ring_face[ring]), *nominal.ring_index[ring].tolist())
        for axis, value, sigma in zip("xyz", offset_mm[ring], record.ring_offset_sigma_mm[ring], strict=True):
            yield place, f"offset {axis}", Estimate(float(value), float(sigma)), "mm", True
