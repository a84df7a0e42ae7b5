"""A case of a study, its samples, and both as the rows of a study's file, which are checked as any input.

What is drawn for a sample hangs on seed, case and number alone.
"""

import hashlib
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import chain, islice
from pathlib import Path
from typing import Literal, NamedTuple, cast, get_args

import numpy as np
from numpy.typing import NDArray

from calib.solver.calibration import Status
from designer.base.arrays import Array, Rows
from designer.base.errors import InputError
from designer.base.marks import Count, Word

MAX_PARAMS = 4000
"""Twelve for each of the most cameras that a rig may have."""
CASE_TYPES = (str, str, int, int, str, str, str, int, bytes)
"""Of the columns of a case."""
LONGEST_MESSAGE = 10_000
ROWS_AT_A_TIME = 10_000
"""Checked and packed before the next are read, so that a file of anybody's takes no more memory than its numbers."""

Setting = tuple[str, str]
"""A way of sampling, and of counting observations."""


@dataclass(frozen=True)
class Case:
    """What is sampled: a target's photos, which observations of them count, and how many views a sample has."""

    target: Word
    size: Count  # views drawn for a sample
    pool: Count  # views they are drawn from
    sampling: Word = ""  # of rendered photos, "binary" or "area"
    sightings: Word = ""  # which observations count, such as "all"

    @property
    def setting(self) -> Setting:
        """The way of sampling and counting."""
        return self.sampling, self.sightings

    @property
    def pool_key(self) -> tuple[str, str, str]:
        """What tells the views that samples are drawn from, whatever their number."""
        return self.target, self.sampling, self.sightings

    @property
    def name(self) -> str:
        """What tells it from the others of a study, and its samples' random numbers from theirs."""
        return f"{self.target}/{self.sampling}/{self.sightings}/{self.size}"


SampleStatus = Status | Literal["failed"]
"""`failed`: no camera came out at all, and the message says why."""
STATUSES: tuple[SampleStatus, ...] = (*get_args(Status), "failed")


class SampleErrors(NamedTuple):
    """Root mean squares over a sample's views, each as often as drawn; nan where they are not defined."""

    reprojection_px: float = math.nan
    intersection_mm: float = math.nan
    reconstruction_mm: float = math.nan
    pose_mm: float = math.nan


NO_ERRORS = SampleErrors()


@dataclass(frozen=True)
class SampleResult:
    """The camera of one sample, or other values, and its errors."""

    number: int
    status: SampleStatus
    distinct_views: int
    params: tuple[float, ...]  # (P,) nan if there is no camera
    iterations: int = 0
    message: str = ""  # why the camera is not to be trusted
    errors: SampleErrors = NO_ERRORS


def failed_sample(number: int, distinct_views: int, values: int, reason: str) -> SampleResult:
    """A sample without a camera, of which so many values are not known."""
    return SampleResult(number, "failed", distinct_views, (math.nan,) * values, message=reason)


def keyed_generator(name: str) -> np.random.Generator:
    """The random numbers of what has this name: the same in whatever order, process or part of a run they are drawn.

    They come from Philox (Salmon et al. 2011), a generator whose streams are told apart by a key: a digest of the name.
    """
    key = np.frombuffer(hashlib.sha256(name.encode()).digest()[:16], dtype="<u8")
    return np.random.Generator(np.random.Philox(key=key))


def draw_counts(seed: int, case: str, number: int, size: int, pool: int) -> Rows:
    """How often each view is drawn, of `size` draws with replacement (Efron 1979).  # (V,)"""
    drawn = keyed_generator(f"{seed}\n{number}\n{case}").integers(pool, size=size)
    return np.bincount(drawn, minlength=pool).astype(np.int64, copy=False)


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
    return (
        int(result.number), result.status, int(result.distinct_views),
        *(None if math.isnan(value) else float(value) for value in result.errors),
        np.asarray(result.params, dtype="<f8").tobytes(), int(result.iterations), result.message,
    )  # fmt: skip


def samples_from_rows(path: Path, case: StoredCase, rows: Iterable[Row]) -> Samples:
    """The samples of a case, each row checked as it comes."""
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
    values = b"".join(cast("tuple[bytes, ...]", params))
    return Samples(
        case,
        np.array(number, dtype=np.int64),
        np.array(status, dtype="U10"),
        np.array(distinct, dtype=np.int64),
        np.ascontiguousarray(numbers.T),
        np.frombuffer(values, dtype="<f8").reshape(len(rows), case.params).astype(np.float64),
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
    """A case from a row."""
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
