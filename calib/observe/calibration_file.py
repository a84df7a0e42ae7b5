"""`calibration.json` with `observations.csv` beside it: a whole calibration, to evaluate without anything else.

Both are plain text and read back bit for bit; what is not known (not finite) is null. Only the covariances of hundreds
of parameters are written short (`designer.base.packed`). `camera.json` is written with them: it is all that other
programs need.
"""

import hashlib
import math
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Annotated, Self

import numpy as np

from calib.cameras import parameter_names
from calib.cameras.camera import camera_to_json
from calib.core.se3 import rigid_fault
from calib.core.types import KnownPoints, Observations
from calib.observe.observation_table import MAX_RESIDUAL_PX, observations_to_csv, read_sightings
from calib.solver.calibration import Calibration, CameraSolution, session_files
from calib.solver.problem import SolveOptions
from designer.base.arrays import Array
from designer.base.codec import decode, encode
from designer.base.errors import InputError
from designer.base.file_kind import FileKind
from designer.base.files import write_files
from designer.base.marks import LEFT_OUT, OR_NULL, AtLeast, Hash, Length, Shape
from designer.base.words import shown

LARGEST_COVARIANCE = 1e100
"""Squares of what is larger overflow further on."""
CALIBRATION_FILE, OBSERVATIONS_FILE, CAMERA_FILE = "calibration.json", "observations.csv", "camera.json"
RIG_CALIBRATION_FILE = "rig_calibration.json"
"""Of cameras that were solved together, each of which has a folder with the files above beside it."""

_Point = tuple[float, float, float, Annotated[int, AtLeast(-1)]]


@dataclass(frozen=True)
class Provenance:
    """Where a calibration comes from: enough to make it again."""

    program: str  # name and version
    layout_id: Hash = ""  # of the target file; "" for points from elsewhere
    geometry_id: Hash = ""
    seed: int | None = None  # of what was drawn at random, if anything was
    options: SolveOptions = field(default_factory=SolveOptions)
    settings: tuple[tuple[str, str], ...] = ()  # of the command: name and value as they were given
    observations_sha256: Annotated[Hash, LEFT_OUT] = ""
    """Of the table with what this camera leaves over: no two cameras have the same. Files say it beside the table."""


@dataclass(frozen=True, eq=False)
class SolvedView:
    """Where a photo was taken."""

    image: str
    cam_from_target: Annotated[Array, Shape(4, 4)]
    covariance: Annotated[Array, Shape(6, 6), OR_NULL]


@dataclass(frozen=True, eq=False)
class PointsRecord:
    """Known points and their planes, as files have them."""

    planes: Annotated[Array, Shape("F", 4)]
    points: tuple[_Point, ...]

    @classmethod
    def of(cls, known: KnownPoints) -> Self:
        """Those of a target."""
        each = zip(known.position_mm.tolist(), known.face.tolist(), strict=True)
        return cls(known.plane, tuple((x, y, z, face) for (x, y, z), face in each))

    def __post_init__(self) -> None:
        for number, plane in enumerate(self.planes.tolist()):
            if abs((length := math.hypot(*plane[:3])) - 1) > 1e-6:
                raise ValueError(f"planes.{number} has a normal of length {length:g}; it must be 1")
        for number, point in enumerate(self.points):
            if point[3] >= len(self.planes):
                raise ValueError(
                    f"points.{number} is on plane {point[3]}; there are {len(self.planes)}, counted from 0"
                )

    def known(self, geometry_id: str) -> KnownPoints:
        """As they are used."""
        position = np.array([point[:3] for point in self.points], dtype=np.float64).reshape(-1, 3)
        face = np.array([point[3] for point in self.points], dtype=np.int64)
        return KnownPoints(position, face, self.planes, geometry_id)


@dataclass(frozen=True, eq=False, kw_only=True)
class CalibrationRecord(CameraSolution):
    """The keys of the file: a calibration but for what stands in the table beside it."""

    provenance: Provenance
    geometry_id: Hash
    observations_sha256: Hash
    planes: Annotated[Array, Shape("F", 4)]
    points: tuple[_Point, ...]
    views: Annotated[tuple[SolvedView, ...], Length(1, 1_000_000)]

    def __post_init__(self) -> None:
        if len({view.image for view in self.views}) < len(self.views):
            raise ValueError("views must each be of another image")
        names = parameter_names(self.camera.model)
        if odd := set(self.fixed) - set(names):
            raise ValueError(f"fixed holds {shown(min(odd))}, which is no parameter of model {self.camera.model!r}")
        if odd := {one.name for one in self.priors} - set(names):
            raise ValueError(f"priors hold {shown(min(odd))}, which is no parameter of model {self.camera.model!r}")
        parts = {"param_covariance": self.param_covariance}
        parts |= {f"{name}.param_covariance": part.param_covariance for name, part in self.errors.items()}
        for name, covariance in parts.items():
            if covariance.shape != (len(names),) * 2:
                raise ValueError(f"{name} must be {len(names)} rows of {len(names)} numbers")
            _check_covariance(name, covariance)
        if self.linear is not None and len(self.linear) != len(self.views):
            raise ValueError("linear must have a row a view")
        if fault := rigid_fault(np.stack([view.cam_from_target for view in self.views])):
            raise ValueError(f"views.{fault[0]}.cam_from_target {fault[1]}")
        _ = self.known_points

    @property
    def known_points(self) -> KnownPoints:
        """The known points and their planes."""
        return PointsRecord(self.planes, self.points).known(self.geometry_id)


CALIBRATION = FileKind(CalibrationRecord, "calibration", "a calibration.json", "solve again", largest_bytes=512 * 2**20)

_ALIKE = tuple(one.name for one in fields(CameraSolution))


def _check_covariance(name: str, matrix: Array) -> None:
    """Refuse what is no covariance of parameters, which may have gaps."""
    variance = np.diagonal(matrix)
    if (variance < 0).any():
        raise ValueError(f"{name} has a variance of {np.nanmin(variance):g}; it must be 0 or more")
    if (np.abs(matrix) > LARGEST_COVARIANCE).any():
        raise ValueError(f"{name} holds a number beyond {LARGEST_COVARIANCE:g}")


def write_calibration(
    folder: Path, calibration: Calibration, provenance: Provenance
) -> tuple[tuple[Path, ...], Provenance]:
    """Write `calibration.json`, `observations.csv` and `camera.json`, all or none.

    Returns:
        Their places, and the provenance as it would be read.

    Raises:
        InputError: they cannot be written, or hold what `read_calibration` refuses.
        ValueError: two views of one name.
    """
    files, provenance = calibration_files(folder, calibration, provenance)
    write_files(files)
    return tuple(files), provenance


def calibration_files(
    folder: Path, calibration: Calibration, provenance: Provenance
) -> tuple[dict[Path, bytes], Provenance]:
    """What `write_calibration` writes, to be written with other files; errors as there."""
    if len(set(calibration.observations.view_names)) < calibration.observations.view_count:
        raise ValueError("two views have the same name")
    table = observations_to_csv(calibration)
    digest = hashlib.sha256(table).hexdigest()
    files = {
        folder / CALIBRATION_FILE: _text(calibration, provenance, digest, folder),
        folder / OBSERVATIONS_FILE: table,
        folder / CAMERA_FILE: camera_to_json(calibration.camera, calibration.told_of_camera).encode(),
    }
    for one, name in zip(calibration.sessions, session_files(calibration.sessions), strict=True):
        files[folder / name] = camera_to_json(one.of(calibration.camera)).encode()
    return files, replace(provenance, observations_sha256=digest)


def _text(calibration: Calibration, provenance: Provenance, digest: str, folder: Path) -> bytes:
    """The file, if it holds nothing that would be refused when it is read."""
    try:
        record = record_of(calibration, provenance, digest)
        decode(CalibrationRecord, encode(CalibrationRecord, record))
        if (np.abs(calibration.residual_px[~calibration.is_outlier]) > MAX_RESIDUAL_PX).any():
            raise ValueError(f"a residual is beyond {MAX_RESIDUAL_PX:g} px")
    except ValueError as error:
        raise InputError(
            f"{folder}: the solution makes no sense and is not written: {error}; check what it is solved from"
        ) from None
    return CALIBRATION.text(record)


def record_of(calibration: Calibration, provenance: Provenance, digest: str) -> CalibrationRecord:
    """What the file says."""
    seen, points = calibration.observations, calibration.observations.points
    return CalibrationRecord(
        provenance=replace(provenance, observations_sha256=""),
        **{name: getattr(calibration, name) for name in _ALIKE},
        geometry_id=points.geometry_id,
        observations_sha256=digest,
        planes=points.plane,
        points=PointsRecord.of(points).points,
        views=tuple(
            SolvedView(*view)
            for view in zip(seen.view_names, calibration.cam_from_target, calibration.pose_covariance, strict=True)
        ),
    )


def read_calibration(path: Path) -> tuple[Calibration, Provenance]:
    """Read a `calibration.json` and the `observations.csv` beside it.

    Raises:
        InputError: one of them cannot be read, breaks a rule, or does not belong to the other; the message names file
            and place.
    """
    file = CALIBRATION.read(path)
    names, points = tuple(view.image for view in file.views), file.known_points
    table = path.parent / OBSERVATIONS_FILE
    seen = read_sightings(table, names, points)
    with table.open("rb") as stream:
        if hashlib.file_digest(stream, "sha256").hexdigest() != file.observations_sha256:
            raise InputError(f"{table}: does not belong to {path}, or was changed since; solve again")
    calibration = Calibration(
        observations=Observations(
            file.camera.image_size, names, seen.view, seen.point, seen.center_px, seen.cov_px2, points
        ),
        cam_from_target=np.stack([view.cam_from_target for view in file.views]),
        residual_px=seen.residual_px,
        is_outlier=seen.is_outlier,
        pose_covariance=np.stack([view.covariance for view in file.views]),
        **{name: getattr(file, name) for name in _ALIKE},
    )
    return calibration, replace(file.provenance, observations_sha256=file.observations_sha256)
