"""NAME.as_built.json, as its page reads it: how a print differs from its design."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from calib.as_built_report.deviations import Estimate, WholePrint
from calib.as_built_report.files import FORMAT, VERSION
from calib.as_built_report.held_out import Gain
from calib.report.stored_table import Count, FewLines, Line, Number, Stored, Word, checked, read_document
from designer.errors import InputError
from designer.skew import NO_SKEW, Skew
from designer.small_file import JsonValue

Array = NDArray[np.float64]

MOST_FACES, MOST_RINGS = 2000, 100_000
AGAIN = "measure the print again"
LARGEST_STRAIN = 0.5
"""A size, stretch or angle (rad) beyond this is no print's: nothing can be dialled in against it."""
LARGEST = 1e6
"""In mm, rad, or the square of these: nothing that is printed is off by as much."""
MOTION_ORDER = [3, 4, 5, 0, 1, 2]
"""Of the stored motions, which have rotations first, as `calib.as_built_report.deviations.FREE_PARAMETERS`."""

LongText = Annotated[str, Field(strict=True, max_length=100_000)]


class StoredEstimate(Stored):
    """A number with its standard deviation."""

    value: Number | None
    sigma: Number | None

    @property
    def estimate(self) -> Estimate:
        """Without a number: not known."""
        return Estimate(
            float("nan") if self.value is None else self.value, float("inf") if self.sigma is None else self.sigma
        )


class StoredLength(Stored):
    """A length that was given."""

    name: Word
    value_mm: Number
    sigma_mm: Number
    left_over_sigma: Number | None


class StoredCamera(Stored):
    """A camera that was solved beside."""

    model: Word
    views: Count
    observations: Count
    left_out: Count
    rms_px: Number | None


class StoredGain(Stored):
    """Errors of photos held out with both targets."""

    metric: Word
    unit: Word
    count: Count
    nominal: Number
    measured: Number
    least_factor: Number | None = None

    @property
    def gain(self) -> Gain:
        """As it was judged."""
        return Gain(self.metric, self.unit, self.count, self.nominal, self.measured, self.least_factor)


class StoredHeldOut(Stored):
    """What is gained on photos held out."""

    parts: Count
    is_better: bool | None = None
    gains: Annotated[tuple[StoredGain, ...], Field(max_length=20)]
    against_truth: Annotated[tuple[StoredGain, ...], Field(max_length=20)]
    remarks: FewLines


Axis = Literal["x", "y", "z"]
Angle = Literal["xy", "xz", "yz"]


class AsBuiltHead(Stored):
    """All but the arrays."""

    program: Word
    settings: Annotated[dict[Word, LongText], Field(max_length=100)]
    layout_id: Word
    measured_geometry_id: Word
    status: Literal["converged", "stopped", "degenerate"]
    remarks: FewLines
    observation_sigma: Number | None
    size: StoredEstimate | None
    axes: dict[Axis, StoredEstimate]
    skews_rad: dict[Angle, StoredEstimate]
    made_with_shrink_compensation_percent: Number
    made_with_skew_compensation_rad: Annotated[tuple[Number, ...], Field(max_length=3)]
    lengths: Annotated[tuple[StoredLength, ...], Field(max_length=100)]
    face_verdict: Annotated[tuple[Word, ...], Field(max_length=MOST_FACES)]
    ring_sigma_mm: tuple[Number, Number] | None
    cameras: Annotated[tuple[StoredCamera, ...], Field(max_length=100)]
    held_out: StoredHeldOut | None

    @property
    def whole(self) -> WholePrint:
        """Size and shape of the whole print."""
        return WholePrint(
            size=None if self.size is None or self.size.value is None else self.size.estimate,
            axes=tuple((name, one.estimate) for name, one in self.axes.items() if one.value is not None),
            skews=tuple((name, one.estimate) for name, one in self.skews_rad.items() if one.value is not None),
        )

    @property
    def made_with_skew(self) -> Skew:
        """The skew compensation of this print."""
        angles = self.made_with_skew_compensation_rad
        return (angles[0], angles[1], angles[2]) if len(angles) == 3 else NO_SKEW

    @property
    def can_be_corrected(self) -> bool:
        """Whether size and shape are numbers that a printer could make."""
        known = [one for one in (self.size, *self.axes.values(), *self.skews_rad.values()) if one is not None]
        dialled = abs(self.made_with_shrink_compensation_percent) / 100, *map(abs, self.made_with_skew)
        return max(dialled) < LARGEST_STRAIN and all(
            one.value is not None and one.sigma is not None and abs(one.value) < LARGEST_STRAIN for one in known
        )


@dataclass(frozen=True, eq=False)
class AsBuiltRecord:
    """A measured print: F faces and R rings."""

    head: AsBuiltHead
    face_views: Array  # (F,)
    is_known: NDArray[np.bool_]  # (F,) the photos tell where the face is
    motion: Array  # (F, 6) shift (mm), rotation vector (rad), in the face's frame
    motion_sigma: Array  # (F, 6)
    bow_mm: Array  # (F, 3)
    is_ring_seen: NDArray[np.bool_]  # (R,)
    offset_mm: Array  # (R, 3) in the ring's face's frame
    offset_sigma_mm: Array  # (R, 3)

    @property
    def face_count(self) -> int:
        """F."""
        return len(self.motion)

    @property
    def verdicts(self) -> tuple[str, ...]:
        """Whether each face moved; nothing for a single one, of which that is the pose."""
        return self.head.face_verdict if len(self.head.face_verdict) == self.face_count else ()


def read_as_built(path: Path) -> AsBuiltRecord | None:
    """The numbers of a measured print; None if there is no such file.

    Raises:
        InputError: not JSON, of another format or version, or a key or array that breaks a rule.
    """
    document = read_document(path, FORMAT, VERSION, AGAIN)
    if document is None:
        return None
    head = checked(document, path, AsBuiltHead, AGAIN)
    try:
        return _record(head, document)
    except ValueError as error:
        reason = " ".join(str(error).split())[:200]
        raise InputError(f"{path}: {reason}; {AGAIN}") from None


def _record(head: AsBuiltHead, document: Mapping[str, JsonValue]) -> AsBuiltRecord:
    views = _array(document, "face_views", 1)
    faces = len(views)
    offset = _array(document, "ring_offset_mm", 2)
    rings = len(offset)
    if not 0 < faces <= MOST_FACES or not 0 < rings <= MOST_RINGS:
        raise ValueError(f"{faces} faces and {rings} rings; 1 to {MOST_FACES} and 1 to {MOST_RINGS} can be shown")
    motion = _array(document, "face_motion", 2, (faces, 6))
    variance = np.diagonal(_array(document, "face_motion_covariance", 2, (6 * faces, 6 * faces)))
    sigma = np.sqrt(np.maximum(variance, 0.0)).reshape(faces, 6)
    return AsBuiltRecord(
        head, views, _array(document, "face_is_determined", 1, (faces,)) > 0,
        motion[:, MOTION_ORDER], sigma[:, MOTION_ORDER], _array(document, "face_bow_mm", 2, (faces, 3)),
        _array(document, "ring_is_seen", 1, (rings,)) > 0, _array(document, "ring_offset_mm", 2, (rings, 3)),
        _array(document, "ring_offset_sigma_mm", 2, (rings, 3)),
    )  # fmt: skip


def _array(
    document: Mapping[str, JsonValue], name: str, dimensions: int, shape: tuple[int, ...] | None = None
) -> Array:
    """An array of numbers; null is nan."""
    try:
        values = np.array(document.get(name), dtype=np.float64)
    except (ValueError, TypeError, OverflowError) as error:
        raise ValueError(f"{name}: {error}") from None
    if values.ndim != dimensions or (shape is not None and values.shape != shape):
        wanted = f"{dimensions} dimensions" if shape is None else " x ".join(map(str, shape))
        raise ValueError(f"{name} has the shape {values.shape}; it must be {wanted}")
    if (np.abs(values) > LARGEST).any():
        raise ValueError(f"{name} holds a number beyond {LARGEST:g}")
    return values


def settings_of(head: AsBuiltHead) -> Mapping[str, Line]:
    """The options of the command, those that were given."""
    return {name: value for name, value in head.settings.items() if value.strip()}
