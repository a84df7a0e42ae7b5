"""budget.json: what a rig can be expected to measure, for its page, `--json` and other programs; and the grid."""

import csv
import io
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from calib.cameras.rig import MOST_CAMERAS, Rig
from calib.space.budget import Expected, KnownExactly
from calib.space.budget_views import DepthCurve, ErrorSlice
from calib.space.error_size import PointErrors, rms_error_mm
from calib.space.volume import WorkingVolume
from calib.space.what_if import ChangedRig
from designer.base.answer import program
from designer.base.file_kind import FileKind
from designer.base.marks import AtLeast, AtMost, Count, FewLines, Gap, Length, Line, Shape, Word

Array = NDArray[np.float64]

BUDGET_FILE, GRID_FILE = "budget.json", "grid.csv"
MOST_DRAWN = 300
FARTHEST_MM = 1e9
_AXES = ("XX", "XY", "XZ", "YY", "YZ", "ZZ")
COLUMNS = (
    "X", "Y", "Z", "cameras", "sigma_mm", "noise_mm", "calibration_mm", "shape_mm",
    *(f"{part}_{axes}" for part in ("c", "noise", "calibration") for axes in _AXES),
)  # fmt: skip
EXPLAINED = (
    "# ringsolid budget, version 1",
    "# X Y Z: in the rig's frame, mm; sigma_mm: root mean square of the error's length in space; noise_mm, "
    "calibration_mm: its parts",
    "# shape_mm: the same with the best rigid motion of all points taken off",
    "# c_: covariance in mm^2; noise_: its part by the pixels; calibration_: by the rig's errors; empty: not known",
)


@dataclass(frozen=True)
class LengthErrors:
    """Standard deviations of a length in space, of many places."""

    direction: Word
    total: PointErrors
    by_noise: PointErrors
    by_calibration: PointErrors


@dataclass(frozen=True, eq=False)
class BudgetRecord:
    """What a rig can be expected to measure. Null is not known."""

    program: Word
    settings: Annotated[Mapping[Word, Line], Length(0, 100)]
    rig: Rig  # without its covariance
    volume: WorkingVolume
    share: Gap  # of the volume that enough cameras see
    seen_by: Count
    noise_px: Annotated[Array, Shape("C"), AtLeast(0), Length(1, MOST_CAMERAS)]
    points: Count  # that were looked at
    position: PointErrors  # in the rig's frame, by all that is known
    by_noise: PointErrors
    by_calibration: PointErrors
    shape: PointErrors  # with the best rigid motion of all points taken off
    shape_by_calibration: PointErrors
    length_mm: Gap
    lengths: Annotated[tuple[LengthErrors, ...], Length(0, 3)]
    known: Annotated[tuple[KnownExactly, ...], Length(0, 1000)]
    changes: Annotated[tuple[ChangedRig, ...], Length(0, 100)]
    depth: DepthCurve | None
    slices: Annotated[tuple[ErrorSlice, ...], Length(0, 3)]
    drawn_mm: Annotated[
        Array, Shape("D", 3), Length(0, MOST_DRAWN), AtLeast(-FARTHEST_MM), AtMost(FARTHEST_MM)
    ]  # some of the points
    drawn_mm2: Annotated[Array, Shape("D", 3, 3), AtLeast(-(FARTHEST_MM**2)), AtMost(FARTHEST_MM**2)]
    remarks: FewLines


BUDGET = FileKind(BudgetRecord, "budget", "a budget.json", "make the budget again: calib budget")


@dataclass(frozen=True, eq=False)
class BudgetParts:
    """What a budget is put together from."""

    rig: Rig
    volume: WorkingVolume
    share: float
    seen_by: int
    noise_px: Array  # (C,)
    expected: Expected
    shape_mm: Array  # (N,) root mean square by the rig's errors, the rigid motion taken off; nan: not known
    length_mm: float
    lengths: tuple[LengthErrors, ...]
    known: tuple[KnownExactly, ...]
    changes: tuple[ChangedRig, ...]
    depth: DepthCurve | None
    slices: tuple[ErrorSlice, ...]


def budget_record(
    parts: BudgetParts, settings: Mapping[str, str], errors: Mapping[str, PointErrors], remarks: tuple[str, ...]
) -> BudgetRecord:
    """What is told of a budget; `errors` are the fields of the record by their names."""
    expected = parts.expected
    drawn = slice(None, None, -(-len(expected.point_mm) // MOST_DRAWN))
    return BudgetRecord(
        program=program(), settings=dict(settings), rig=replace(parts.rig, covariance=None), volume=parts.volume,
        share=parts.share, seen_by=parts.seen_by, noise_px=parts.noise_px, points=len(expected.point_mm),
        position=errors["position"], by_noise=errors["by_noise"], by_calibration=errors["by_calibration"],
        shape=errors["shape"], shape_by_calibration=errors["shape_by_calibration"], length_mm=parts.length_mm,
        lengths=parts.lengths, known=parts.known, changes=parts.changes, depth=parts.depth, slices=parts.slices,
        drawn_mm=expected.point_mm[drawn], drawn_mm2=expected.covariance_mm2[drawn], remarks=remarks,
    )  # fmt: skip


def grid_csv(expected: Expected, shape_mm: Array) -> bytes:
    """The lattice of the volume as a table, a line a point; what is not known is empty."""
    stream = io.StringIO(newline="")
    stream.writelines(f"{line}\n" for line in EXPLAINED)
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(COLUMNS)
    shared = expected.calibration_mm2
    shared = np.full_like(expected.noise_mm2, np.nan) if shared is None else shared
    parts = (expected.covariance_mm2, expected.noise_mm2, shared)
    upper = np.triu_indices(3)
    shape = np.sqrt(np.trace(expected.noise_mm2, axis1=1, axis2=2) + shape_mm**2)
    numbers = np.column_stack([
        expected.point_mm, expected.cameras, *(rms_error_mm(part) for part in parts), shape,
        *(part[:, upper[0], upper[1]] for part in parts),
    ])  # fmt: skip
    for row in numbers.tolist():
        cells = [f"{value:.9g}" if np.isfinite(value) else "" for value in row]
        writer.writerow(cells)
    return stream.getvalue().encode()
