"""`verdict.json` in the folder of a run: the verdict, the limits, and the cameras of the two halves.

With the calibrations beside it the halves suffice to judge again by other limits, and to draw how far they differ,
without solving anything.
"""

import json
import math
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, JsonValue, ValidationError

from calib.cameras import parameter_names
from calib.cameras.camera import Camera
from calib.cameras.camera_file import camera_from_mapping, camera_to_json
from calib.verdict.apart import Known
from calib.verdict.criteria import Criteria, Limits
from calib.verdict.halves import Half, HalfSplit, Halves, NoHalves
from calib.verdict.of_run import Judged
from calib.verdict.verdict import Check, Grade, Verdict
from designer.errors import InputError
from designer.small_file import parse_json, read_small_text
from designer.spec_file import shown

FORMAT = "ringsolid.verdict"
VERSION = 1
VERDICT_FILE = "verdict.json"
KIND = "a verdict.json"
MAX_FILE_BYTES = 16 * 2**20
LARGEST_COVARIANCE = 1e100
"""Squares of what is larger overflow further on."""
MOST_CHECKS, MOST_ADVICE, MOST_PAIRS, MOST_VIEWS = 50, 50, 20, 100_000

_Number = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=-1e15, le=1e15)]
_Text = Annotated[str, Field(max_length=4000)]
_Word = Annotated[str, Field(max_length=200)]


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class _Check(_Part):
    name: _Word
    title: _Word
    grade: Grade
    value: _Number | None
    unit: _Word
    good: _Number
    usable: _Number
    is_at_least: Annotated[bool, Field(strict=True)]
    sentence: _Text


class _Verdict(_Part):
    grade: Grade
    model: _Word
    sentence: _Text
    checks: Annotated[tuple[_Check, ...], Field(max_length=MOST_CHECKS)]
    advice: Annotated[tuple[_Text, ...], Field(max_length=MOST_ADVICE)]


class _Limits(_Part):
    good: Annotated[_Number, Field(ge=0)]
    usable: Annotated[_Number, Field(ge=0)]
    source: _Text


class _Criteria(_Part):
    name: _Word
    title: _Word
    uncertainty_px: _Limits
    coverage_percent: _Limits
    halves_sigma: _Limits
    residuals_px: _Limits
    systematic_px: _Limits
    outliers_percent: _Limits
    target_px: _Limits
    models_px: _Limits


class _Half(_Part):
    camera: JsonValue
    param_covariance: Annotated[
        list[list[Annotated[float, Field(strict=True, allow_inf_nan=False)]]], Field(max_length=100)
    ]
    views: Annotated[tuple[_Text, ...], Field(max_length=MOST_VIEWS)]


class _VerdictFile(_Part):
    """The keys of the file in their order."""

    format: Literal["ringsolid.verdict"]
    version: Literal[1]
    verdict: _Verdict
    criteria: _Criteria
    halves: Annotated[tuple[tuple[_Half, _Half], ...], Field(min_length=1, max_length=MOST_PAIRS)] | None
    no_halves: _Text | None
    observations_sha256: _Word = ""


def verdict_to_json(judged: Judged) -> bytes:
    """The text of `verdict.json`; it reads back bit for bit."""
    halves = judged.halves
    document: dict[str, object] = {
        "format": FORMAT,
        "version": VERSION,
        "verdict": asdict(judged.verdict),
        "criteria": asdict(judged.criteria),
        "halves": None if isinstance(halves, NoHalves) else [[_half(half) for half in pair] for pair in halves.pairs],
        "no_halves": halves.reason if isinstance(halves, NoHalves) else None,
        "observations_sha256": judged.observations_sha256,
    }
    return (json.dumps(document, indent=1, allow_nan=False) + "\n").encode()


def _half(half: Half) -> dict[str, object]:
    return {
        "camera": json.loads(camera_to_json(half.known.camera)),
        "param_covariance": half.known.param_covariance.tolist(),
        "views": half.view_names,
    }


def read_verdict(folder: Path) -> Judged:
    """The verdict in the folder of a run, with the limits and half solutions it rests on.

    Raises:
        InputError: there is none, or it breaks a rule; the message names file and place.
    """
    path = folder / VERDICT_FILE
    document = parse_json(read_small_text(path, MAX_FILE_BYTES, KIND), path, KIND)
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise InputError(f'{path}: not a verdict: it must hold "format": "{FORMAT}"')
    if type(document.get("version")) is not int or document["version"] != VERSION:
        raise InputError(f"{path}: version {shown(document.get('version'))}; this program reads version {VERSION}")
    try:
        file = _VerdictFile.model_validate(document)
        return Judged(_verdict(file.verdict), _criteria(file.criteria), _halves(file, path), file.observations_sha256)
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(map(str, first["loc"]))
        raise InputError(f"{path}: {shown(place)}: {first['msg']}; solve again") from None
    except ValueError as error:
        raise error if isinstance(error, InputError) else InputError(f"{path}: {error}; solve again") from None


def _verdict(file: _Verdict) -> Verdict:
    checks = tuple(Check(**dict(check)) for check in file.checks)
    return Verdict(file.grade, file.model, file.sentence, checks, file.advice)


def _criteria(file: _Criteria) -> Criteria:
    limits = {name: Limits(**dict(value)) for name, value in file if isinstance(value, _Limits)}
    return Criteria(file.name, file.title, **limits)


def _halves(file: _VerdictFile, path: Path) -> HalfSplit:
    """The two solutions, or why there are none."""
    if file.halves is None:
        return NoHalves(file.no_halves or "no half solutions are stored")
    pairs = tuple(
        (_read_half(first, f"{path}: halves.{number}.0"), _read_half(second, f"{path}: halves.{number}.1"))
        for number, (first, second) in enumerate(file.halves)
    )
    if len({(half.known.camera.image_size, half.known.camera.model) for pair in pairs for half in pair}) > 1:
        raise ValueError("halves must have cameras of one model and image size")
    return Halves(pairs)


def _read_half(file: _Half, origin: str) -> Half:
    camera = camera_from_mapping(file.camera, f"{origin}.camera")
    return Half(Known(camera, _covariance(file, camera)), file.views)


def _covariance(file: _Half, camera: Camera) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    """A matrix that can be the covariance of the camera's parameters."""
    size = len(parameter_names(camera.model))
    if len(file.param_covariance) != size or any(len(row) != size for row in file.param_covariance):
        raise ValueError(f"param_covariance must be {size} rows of {size} numbers")
    matrix = np.array(file.param_covariance, dtype=np.float64)
    if not (np.abs(matrix) <= LARGEST_COVARIANCE).all() or (np.diagonal(matrix) < 0).any():
        raise ValueError(
            f"param_covariance must have variances of 0 or more, and no number beyond {LARGEST_COVARIANCE:g}"
        )
    if not math.isclose(float(np.abs(matrix - matrix.T).max()), 0.0, abs_tol=1e-6 * float(np.abs(matrix).max())):
        raise ValueError("param_covariance must be symmetric")
    return matrix
