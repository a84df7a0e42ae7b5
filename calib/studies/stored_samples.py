"""Samples of a case as arrays, and as the rows of a study file, which are checked as any input."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import chain, islice
from pathlib import Path
from typing import cast, get_args

import numpy as np
from numpy.typing import NDArray

from calib.solver.calibration import Status
from calib.studies.sample_metrics import SampleResult
from calib.studies.statistics import Case
from designer.base.arrays import Array, Rows
from designer.base.errors import InputError

STATUSES = (*get_args(Status), "failed")
MAX_PARAMS = 1000
CASE_TYPES = (str, str, int, int, str, str, str, int, bytes)
"""Of the columns of a case."""
LONGEST_MESSAGE = 10_000
ROWS_AT_A_TIME = 10_000
"""Checked and packed before the next are read, so that a file of anybody's takes no more memory than its numbers."""


@dataclass(frozen=True)
class StoredCase:
    """A case, and what its pool is known by."""

    case: Case
    model: str
    params: int  # P, values of a sample: the camera's parameters, or what the study's kind has
    covariance: Array = field(compare=False)  # (P, P) of them in the solution of all views, or (0, 0)


@dataclass(frozen=True, eq=False)
class Samples:
    """S samples of a case, by number."""

    case: StoredCase
    number: Rows  # (S,)
    status: NDArray[np.str_]  # (S,)
    distinct_views: Rows  # (S,)
    metrics: Array  # (S, 4) reprojection (px), intersection, reconstruction, pose (mm); nan: not defined
    params: Array  # (S, P) nan if there is no camera
    iterations: Rows  # (S,)
    message: tuple[str, ...]  # (S,)


Row = tuple[object, ...]


def row_of(result: SampleResult, params: int) -> Row:
    """A sample as a row; what is not a number has no value there."""
    if len(result.params) != params:
        raise ValueError(f"sample {result.number} has {len(result.params)} parameters; its case has {params}")
    metrics = (result.reprojection_px, result.intersection_mm, result.reconstruction_mm, result.pose_mm)
    return (
        int(result.number), result.status, int(result.distinct_views),
        *(None if math.isnan(value) else float(value) for value in metrics),
        np.asarray(result.params, dtype="<f8").tobytes(), int(result.iterations), result.message,
    )  # fmt: skip


def samples_from_rows(path: Path, case: StoredCase, rows: Iterable[Row]) -> Samples:
    """The samples of a case, each row checked as it comes.

    Args:
        path: where they are from, for messages.
        case: what they are samples of.
        rows: number, status, distinct views, four metrics, parameters, iterations, message.

    Raises:
        InputError: a row is none that a study has written.
    """
    left = iter(rows)
    parts = [_samples(case, [])]
    while part := [_checked_row(path, case, row) for row in islice(left, ROWS_AT_A_TIME)]:
        parts.append(_samples(case, part))
    joined = {
        name: np.concatenate([getattr(part, name) for part in parts])
        for name in ("number", "status", "distinct_views", "metrics", "params", "iterations")
    }
    return Samples(case, **joined, message=tuple(chain.from_iterable(part.message for part in parts)))


def _samples(case: StoredCase, rows: Sequence[Row]) -> Samples:
    """The samples in rows that were checked."""
    number, status, distinct, *metrics, params, iterations, message = zip(*rows, strict=True) if rows else ((),) * 10
    numbers = np.array([[math.nan if value is None else value for value in column] for column in metrics], dtype=float)
    return Samples(
        case,
        np.array(number, dtype=np.int64),
        np.array(status, dtype="U10"),
        np.array(distinct, dtype=np.int64),
        np.ascontiguousarray(numbers.T),
        np.frombuffer(b"".join(map(_blob, params)), dtype="<f8").reshape(len(rows), case.params).astype(np.float64),
        np.array(iterations, dtype=np.int64),
        tuple(map(str, message)),
    )


def row_of_case(stored: StoredCase) -> Row:
    """A case as a row."""
    case = stored.case
    return (
        case.name, case.target, case.size, case.pool, case.sampling, case.sightings, stored.model, stored.params,
        np.asarray(stored.covariance, dtype="<f8").tobytes(),
    )  # fmt: skip


def case_from_row(path: Path, row: Row) -> StoredCase:
    """A case from a row.

    Raises:
        InputError: it is none that a study has written.
    """
    if not all(isinstance(value, kind) for value, kind in zip(row, CASE_TYPES, strict=True)):
        raise _damaged(path, "its list of cases")
    name, target, size, pool, sampling, sightings, model, params, covariance = cast(
        "tuple[str, str, int, int, str, str, str, int, bytes]", row
    )
    case = Case(target, size, pool, sampling, sightings)
    is_whole = 0 <= params <= MAX_PARAMS and len(covariance) in (0, 8 * params**2)
    if not (is_whole and size > 0 and pool > 0 and case.name == name):
        raise _damaged(path, "its list of cases")
    side = params if covariance else 0
    return StoredCase(
        case, model, params, np.frombuffer(covariance, dtype="<f8").reshape(side, side).astype(np.float64)
    )


def _blob(value: object) -> bytes:
    return value if isinstance(value, bytes) else b""


def _checked_row(path: Path, case: StoredCase, row: Row) -> Row:
    number, status, distinct, *metrics, params, iterations, message = row
    counts = (number, distinct, iterations)
    if not (
        all(isinstance(count, int) and count >= 0 for count in counts)
        and status in STATUSES
        and all(value is None or (isinstance(value, float) and value >= 0) for value in metrics)
        and metrics[0] != math.inf
        and isinstance(params, bytes)
        and len(params) == 8 * case.params
        and isinstance(message, str)
        and len(message) <= LONGEST_MESSAGE
    ):
        raise _damaged(path, f"a sample of {case.case.name!r}")
    return row


def _damaged(path: Path, what: str) -> InputError:
    return InputError(f"{path}: {what} is damaged; start a new study in another folder")
