"""`calibration.json` with `observations.csv` beside it: a whole calibration, to evaluate without anything else.

Both are plain text and read back bit for bit; what is not known (not finite) is null. `camera.json` is written with
them: it is all that other programs need.
"""

import hashlib
import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Annotated, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, JsonValue, ValidationError

from calib.cameras import parameter_names
from calib.cameras.camera import Camera
from calib.cameras.camera_file import camera_from_mapping, camera_to_json
from calib.core.files import write_files
from calib.core.rigid import rigid_fault
from calib.core.types import KnownPoints, Observations
from calib.records.observation_table import MAX_RESIDUAL_PX, observations_to_csv, read_sightings
from calib.solver.calibration import Calibration, ImageField, Status, TargetError
from calib.solver.options import SolveOptions
from designer.errors import InputError
from designer.small_file import parse_json, read_small_text
from designer.tolerance.model import ErrorModel
from designer.tolerance.registry import SOURCES
from designer.tolerance.source import Amount, Kind
from designer.words import shown

Array = NDArray[np.float64]

FORMAT = "ringsolid.calibration"
VERSION = 1
MAX_FILE_BYTES = 512 * 2**20
LARGEST_SCALE = 1e9
LARGEST_COVARIANCE = 1e100
"""Squares of what is larger overflow further on."""
LARGEST_AMOUNT = 1e6
"""Of an error, in mm, rad, kelvins or shares."""
CALIBRATION_FILE, OBSERVATIONS_FILE, CAMERA_FILE = "calibration.json", "observations.csv", "camera.json"
KIND = "a calibration.json"

_Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
_Amount = Annotated[float, Field(strict=True, ge=-LARGEST_AMOUNT, le=LARGEST_AMOUNT)]
_Rows: TypeAlias = list[list[_Number]]
_RowsWithGaps: TypeAlias = list[list[_Number | None]]
_Count = Annotated[int, Field(strict=True, ge=0)]


@dataclass(frozen=True)
class Provenance:
    """Where a calibration comes from: enough to make it again."""

    program: str  # name and version
    layout_id: str = ""  # of the target file; "" for points from elsewhere
    geometry_id: str = ""
    seed: int | None = None  # of what was drawn at random, if anything was
    options: SolveOptions = field(default_factory=SolveOptions)
    settings: tuple[tuple[str, str], ...] = ()  # of the command: name and value as they were given
    observations_sha256: str = ""  # of the table with what this camera leaves over: no two cameras have the same


class _CalibrationView(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)

    image: str
    cam_from_target: _Rows
    covariance: _RowsWithGaps


class _Errors(BaseModel):
    """What moves rings, in the sources' units: a template or a file of errors may be another one later."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    amounts: Annotated[list[tuple[str, Kind, _Amount]], Field(max_length=len(SOURCES))]
    expansion_per_kelvin: Annotated[_Amount, Field(ge=0)]
    layer_height_mm: Annotated[_Amount, Field(ge=0)]


class _TargetError(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)

    made: Annotated[str, Field(max_length=1000)]
    because: Annotated[str, Field(max_length=1000)]
    param_covariance: _Rows
    errors: _Errors | None = None


class _ImageField(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)

    left_px: Annotated[_Number, Field(ge=0)]
    param_covariance: _Rows


class _CalibrationFile(BaseModel):
    """The keys of the file in their order."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    format: Literal["ringsolid.calibration"]
    version: Literal[1]
    provenance: Provenance
    status: Status
    remarks: tuple[str, ...]
    iterations: _Count
    seconds: Annotated[_Number, Field(ge=0)]
    scale: Annotated[_Number, Field(ge=0, le=LARGEST_SCALE)] | None
    weighted: Annotated[bool, Field(strict=True)]
    fixed: tuple[str, ...]
    camera: JsonValue
    param_covariance: _RowsWithGaps
    target_error: _TargetError | None = None
    image_field: _ImageField | None = None
    geometry_id: str
    observations_sha256: str
    planes: list[tuple[_Number, _Number, _Number, _Number]]
    points: list[tuple[_Number, _Number, _Number, Annotated[int, Field(strict=True, ge=-1)]]]
    views: list[_CalibrationView]


def write_calibration(
    folder: Path, calibration: Calibration, provenance: Provenance
) -> tuple[tuple[Path, ...], Provenance]:
    """Write `calibration.json`, `observations.csv` and `camera.json`, all or none.

    Returns:
        Their places, and the provenance as it would be read.

    Raises:
        InputError: they cannot be written, or hold what `read_calibration` refuses.
        ValueError: two views of one name, or a pose, point or parameter that is not finite.
    """
    if len(set(calibration.observations.view_names)) < calibration.observations.view_count:
        raise ValueError("two views have the same name")
    table = observations_to_csv(calibration)
    digest = hashlib.sha256(table).hexdigest()
    text = _calibration_to_json(calibration, provenance, digest)
    _require_readable(text, calibration, folder)
    files = {
        folder / CALIBRATION_FILE: text,
        folder / OBSERVATIONS_FILE: table,
        folder / CAMERA_FILE: camera_to_json(calibration.camera).encode(),
    }
    write_files(files)
    return tuple(files), replace(provenance, observations_sha256=digest)


def _require_readable(text: bytes, calibration: Calibration, folder: Path) -> None:
    """Refuse before it is written what would be refused when it is read."""
    try:
        file = _CalibrationFile.model_validate(json.loads(text))
        camera, *_ = _parts(file, "camera")
        _read_target_error(file.target_error, len(camera.params))
        _read_image_field(file.image_field, len(camera.params))
        if (np.abs(calibration.residual_px[~calibration.is_outlier]) > MAX_RESIDUAL_PX).any():
            raise ValueError(f"a residual is beyond {MAX_RESIDUAL_PX:g} px")
    except ValidationError as error:
        first = error.errors()[0]
        why = f"{'.'.join(map(str, first['loc']))}: {first['msg']}"
    except ValueError as error:
        why = str(error)
    else:
        return
    raise InputError(f"{folder}: the solution makes no sense and is not written: {why}; check what it is solved from")


def _calibration_to_json(calibration: Calibration, provenance: Provenance, digest: str) -> bytes:
    """One line a field, a point and a view."""
    points = calibration.observations.points
    fields: dict[str, object] = {
        "format": FORMAT,
        "version": VERSION,
        "provenance": {name: value for name, value in asdict(provenance).items() if name != "observations_sha256"},
        "status": calibration.status,
        "remarks": calibration.remarks,
        "iterations": calibration.iterations,
        "seconds": calibration.seconds,
        "scale": calibration.scale if math.isfinite(calibration.scale) else None,
        "weighted": calibration.weighted,
        "fixed": calibration.fixed,
        "camera": json.loads(camera_to_json(calibration.camera)),
        "param_covariance": _with_gaps(calibration.param_covariance),
        "target_error": _target_error(calibration.target_error),
        "image_field": _image_field(calibration.image_field),
        "geometry_id": points.geometry_id,
        "observations_sha256": digest,
    }
    lists: dict[str, Iterator[object]] = {
        "planes": iter(points.plane.tolist()),
        "points": ([*x, f] for x, f in zip(points.position_mm.tolist(), points.face.tolist(), strict=True)),
        "views": _views(calibration),
    }
    lines = [f"{json.dumps(name)}: {json.dumps(value, allow_nan=False)}" for name, value in fields.items()]
    for name, rows in lists.items():
        body = ",\n".join(json.dumps(row, allow_nan=False) for row in rows)
        lines.append(f'"{name}": [\n{body}\n]')
    return ("{\n" + ",\n".join(lines) + "\n}\n").encode()


def _target_error(error: TargetError | None) -> dict[str, object] | None:
    if error is None:
        return None
    return {
        "made": error.made,
        "because": error.because,
        "param_covariance": error.param_covariance.tolist(),
        "errors": _errors(error.errors),
    }


def _errors(errors: ErrorModel | None) -> dict[str, object] | None:
    if errors is None:
        return None
    return {
        "amounts": [(name, amount.kind, amount.size) for name, amount in errors.amounts],
        "expansion_per_kelvin": errors.expansion_per_kelvin,
        "layer_height_mm": errors.layer_height_mm,
    }


def _image_field(field: ImageField | None) -> dict[str, object] | None:
    if field is None:
        return None
    return {"left_px": field.left_px, "param_covariance": field.param_covariance.tolist()}


def _views(calibration: Calibration) -> Iterator[dict[str, object]]:
    names, poses = calibration.observations.view_names, calibration.cam_from_target.tolist()
    for name, pose, covariance in zip(names, poses, calibration.pose_covariance, strict=True):
        yield {"image": name, "cam_from_target": pose, "covariance": _with_gaps(covariance)}


def _with_gaps(matrix: Array) -> list[list[float | None]]:
    """Rows of numbers, with null for what is not finite."""
    return [[x if math.isfinite(x) else None for x in row] for row in matrix.tolist()]


def read_calibration(path: Path) -> tuple[Calibration, Provenance]:
    """Read a `calibration.json` and the `observations.csv` beside it.

    Raises:
        InputError: one of them cannot be read, breaks a rule, or does not belong to the other; the message names file
            and place.
    """
    document = parse_json(read_small_text(path, MAX_FILE_BYTES, KIND), path, KIND)
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise InputError(f'{path}: not a calibration: it must hold "format": "{FORMAT}"')
    if type(document.get("version")) is not int or document["version"] != VERSION:
        raise InputError(f"{path}: version {shown(document.get('version'))}; this program reads version {VERSION}")
    try:
        file = _CalibrationFile.model_validate(document)
        calibration = _calibration(file, path)
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(map(str, first["loc"]))
        raise InputError(f"{path}: {place}: {first['msg']}; solve again") from None
    except ValueError as error:
        raise error if isinstance(error, InputError) else InputError(f"{path}: {error}; solve again") from None
    return calibration, replace(file.provenance, observations_sha256=file.observations_sha256)


def _calibration(file: _CalibrationFile, path: Path) -> Calibration:
    """Hold the file to the rules that tie its parts together, and read the table beside it."""
    camera, names, poses, covariance, points, param_covariance = _parts(file, f"{path}: camera")
    table = path.parent / OBSERVATIONS_FILE
    seen = read_sightings(table, names, points)
    with table.open("rb") as stream:
        if hashlib.file_digest(stream, "sha256").hexdigest() != file.observations_sha256:
            raise InputError(f"{table}: does not belong to {path}, or was changed since; solve again")
    return Calibration(
        camera=camera,
        observations=Observations(
            camera.image_size, names, seen.view, seen.point, seen.center_px, seen.cov_px2, points
        ),
        cam_from_target=poses,
        residual_px=seen.residual_px,
        is_outlier=seen.is_outlier,
        scale=math.nan if file.scale is None else file.scale,
        param_covariance=param_covariance,
        pose_covariance=covariance,
        fixed=file.fixed,
        weighted=file.weighted,
        status=file.status,
        remarks=file.remarks,
        iterations=file.iterations,
        seconds=file.seconds,
        target_error=_read_target_error(file.target_error, len(camera.params)),
        image_field=_read_image_field(file.image_field, len(camera.params)),
    )


def _read_target_error(file: _TargetError | None, parameters: int) -> TargetError | None:
    """What the target's errors may have done."""
    if file is None:
        return None
    covariance = _matrix(file.param_covariance, (parameters,) * 2, "target_error.param_covariance")
    return TargetError(file.made, file.because, _covariance(covariance), _read_errors(file.made, file.errors))


def _read_errors(name: str, file: _Errors | None) -> ErrorModel | None:
    """The errors of a way of making."""
    if file is None:
        return None
    amounts = tuple((source, Amount(kind, size)) for source, kind, size in file.amounts)
    try:
        return ErrorModel(name, "", amounts, file.expansion_per_kelvin, file.layer_height_mm)
    except InputError as error:
        raise ValueError(f"target_error.errors: {error}") from None


def _read_image_field(file: _ImageField | None, parameters: int) -> ImageField | None:
    """What the parameters took of a field over the image."""
    if file is None:
        return None
    covariance = _matrix(file.param_covariance, (parameters,) * 2, "image_field.param_covariance")
    return ImageField(file.left_px, _covariance(covariance))


def _parts(file: _CalibrationFile, origin: str) -> tuple[Camera, tuple[str, ...], Array, Array, KnownPoints, Array]:
    """Camera, names and poses of the views, their covariances, the points, and the covariance of the parameters."""
    camera = camera_from_mapping(file.camera, origin)
    names = tuple(view.image for view in file.views)
    if not names or len(set(names)) < len(names):
        raise ValueError("views must hold one view or more, each of another image")
    parameters = parameter_names(camera.model)
    if odd := set(file.fixed) - set(parameters):
        raise ValueError(f"fixed holds {shown(min(odd))}, which is no parameter of model {camera.model!r}")
    poses = np.stack([_matrix(v.cam_from_target, (4, 4), "cam_from_target", n) for n, v in enumerate(file.views)])
    if fault := rigid_fault(poses):
        raise ValueError(f"views.{fault[0]}.cam_from_target {fault[1]}")
    covariance = [_matrix(v.covariance, (6, 6), "covariance", n) for n, v in enumerate(file.views)]
    param_covariance = _covariance(_matrix(file.param_covariance, (len(parameters),) * 2, "param_covariance"))
    return camera, names, poses, np.stack(covariance), _points(file), param_covariance


def _points(file: _CalibrationFile) -> KnownPoints:
    """The known points and their planes."""
    position = np.array([point[:3] for point in file.points], dtype=np.float64).reshape(-1, 3)
    face = np.array([point[3] for point in file.points], dtype=np.int64)
    plane = np.array(file.planes, dtype=np.float64).reshape(-1, 4)
    for number, row in enumerate(face.tolist()):
        if row >= len(plane):
            raise ValueError(f"points.{number} is on plane {row}; there are {len(plane)}, counted from 0")
    for number, row in enumerate(plane.tolist()):
        one = math.hypot(*row[:3])
        if abs(one - 1) > 1e-6:
            raise ValueError(f"planes.{number} has a normal of length {one:g}; it must be 1")
    return KnownPoints(position, face, plane, file.geometry_id)


def _covariance(matrix: Array) -> Array:
    """A matrix as a covariance of parameters, which may have gaps."""
    variance = np.diagonal(matrix)
    if (variance < 0).any():
        raise ValueError(f"param_covariance has a variance of {np.nanmin(variance):g}; it must be 0 or more")
    if (np.abs(matrix) > LARGEST_COVARIANCE).any():
        raise ValueError(f"param_covariance holds a number beyond {LARGEST_COVARIANCE:g}")
    return matrix


def _matrix(
    rows: Sequence[Sequence[float | None]], shape: tuple[int, int], name: str, view: int | None = None
) -> Array:
    """Rows as an array, null as nan."""
    if len(rows) != shape[0] or any(len(row) != shape[1] for row in rows):
        place = name if view is None else f"views.{view}.{name}"
        raise ValueError(f"{place} must be {shape[0]} rows of {shape[1]} numbers")
    return np.array([[math.nan if x is None else x for x in row] for row in rows], dtype=np.float64).reshape(shape)
