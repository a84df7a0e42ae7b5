"""What `metrics.json` and its tables say beyond what a calibration tells: true values, and errors of poses."""

import csv
import io
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, TypeAdapter, ValidationError

from calib.observe.csv_table import is_real, read_text
from calib.records.evaluation_files import METRICS_FILE, VIEWS_FILE
from designer.errors import InputError
from designer.small_file import parse_json, read_small_text
from designer.words import printable

MAX_FILE_BYTES, MAX_TABLE_BYTES = 2**20, 64 * 2**20
WHAT = "a metrics file"

_Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
_Count = Annotated[int, Field(strict=True, ge=0)]


@dataclass(frozen=True)
class StoredMetric:
    """The summary of one metric's errors; None: not known."""

    unit: str
    count: _Count
    rmse: _Number | None
    mean: _Number | None
    median: _Number | None
    percentile_95: _Number | None
    largest: _Number | None
    left_out: Mapping[str, _Count] = field(default_factory=dict)


@dataclass(frozen=True)
class StoredParameter:
    """One parameter of the camera."""

    value: _Number
    sigma: _Number | None
    unit: str
    fixed: bool
    true: _Number | None = None  # of rendered photos


@dataclass(frozen=True)
class StoredMetrics:
    """The keys of `metrics.json`."""

    format: Literal["ringsolid.metrics"]
    version: Literal[1]
    model: str
    status: str
    views: _Count
    observations: _Count
    outliers: _Count
    of: str
    parts: _Count  # in how many the views were held out in turn; 0: the errors are of the views solved from
    remarks: tuple[str, ...]
    parameters: Mapping[str, StoredParameter]
    metrics: Mapping[str, StoredMetric]


def read_metrics(folder: Path) -> StoredMetrics:
    """The metrics of a model's folder.

    Raises:
        InputError: there are none, or the file breaks a rule; the message names it.
    """
    path = folder / METRICS_FILE
    document = parse_json(read_small_text(path, MAX_FILE_BYTES, WHAT), path, WHAT)
    try:
        return TypeAdapter(StoredMetrics).validate_python(document)
    except ValidationError as error:
        first = error.errors()[0]
        place = printable(".".join(map(str, first["loc"])))[:100] or "the document"
        raise InputError(f"{path}: {place}: {first['msg']}; calib evaluate writes it again") from None


def of_views(folder: Path, column: str) -> NDArray[np.float64]:
    """A column of `metrics_views.csv`, without gaps; empty if there is no such column, or no such table."""
    try:
        rows = csv.reader(io.StringIO(read_text(folder / VIEWS_FILE, "a table of photos", MAX_TABLE_BYTES)))
        head = next(rows, [])
        if column not in head:
            return np.zeros(0)
        place = head.index(column)
        found = [float(row[place]) for row in rows if len(row) == len(head) and is_real(row[place])]
    except (InputError, csv.Error):
        return np.zeros(0)
    return np.array([number for number in found if math.isfinite(number)])
