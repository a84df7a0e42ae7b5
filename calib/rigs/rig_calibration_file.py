"""`rig_calibration.json`, and a folder a camera: a whole solved rig, to judge and evaluate without anything else.

What is joint is in the one file; of each camera `calibration.json`, `observations.csv` and `camera.json` are in its own
folder, as of a camera that was solved by itself.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Annotated

import numpy as np

from calib.cameras.rig import LONGEST_DELAY_S, MOST_CAMERAS, POSE
from calib.core.se3 import rigid_fault
from calib.core.types import KnownPoints, RigObservations
from calib.observe.calibration_file import (
    CALIBRATION_FILE,
    RIG_CALIBRATION_FILE,
    PointsRecord,
    Provenance,
    calibration_files,
    read_calibration,
)
from calib.rigs.result import JointSolution, RigCalibration
from calib.solver.calibration import Calibration
from calib.solver.problem import SolveOptions
from designer.base.arrays import Array, Rows
from designer.base.errors import InputError
from designer.base.file_kind import FileKind
from designer.base.marks import LEFT_OUT, OR_NULL, AtLeast, AtMost, Length, Line, Shape, Word
from designer.base.words import no_two_alike, shown

CAMERAS = "cameras"
MOST_FRAMES = 1_000_000
LONGEST_TIME_S = 1e12
_SAFE = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,59}")
_Rows = Annotated[Rows, Shape("V"), AtLeast(0)]
_Times = Annotated[Array, Shape("V"), AtLeast(-LONGEST_TIME_S), AtMost(LONGEST_TIME_S)]

_Delay = Annotated[float, AtLeast(-LONGEST_DELAY_S), AtMost(LONGEST_DELAY_S)]
_Sigma = Annotated[float, AtLeast(0), AtMost(LONGEST_TIME_S)]


@dataclass(frozen=True, eq=False)
class HeldCamera:
    """A camera of a rig, but for what its own folder says."""

    name: Annotated[str, Length(1, 100)]
    folder: Word  # in `cameras/`
    cam_from_rig: Annotated[Array, Shape(4, 4)]
    is_refined: bool
    observations_sha256: Word  # of its table
    frame: _Rows  # of each of its views
    time_s: Annotated[_Times | None, LEFT_OUT] = None
    delay_s: Annotated[_Delay | None, LEFT_OUT] = None
    delay_sigma_s: Annotated[_Sigma | None, LEFT_OUT] = None

    def __post_init__(self) -> None:
        if not _SAFE.fullmatch(self.folder):
            raise ValueError(f"folder {shown(self.folder)}: must be a plain name")
        if fault := rigid_fault(self.cam_from_rig[None]):
            raise ValueError(f"cam_from_rig {fault[1]}")
        if (np.diff(self.frame) <= 0).any():
            raise ValueError("frame must ascend")


@dataclass(frozen=True, eq=False)
class SolvedFrame:
    """Where the target was in a frame."""

    name: str
    rig_from_target: Annotated[Array, Shape(4, 4)]
    covariance: Annotated[Array, Shape(6, 6), OR_NULL]


@dataclass(frozen=True, eq=False, kw_only=True)
class RigRecord(JointSolution):
    """The keys of the file."""

    provenance: Provenance
    observed: tuple[Line, ...] = ()  # remarks on the observations
    cameras: Annotated[tuple[HeldCamera, ...], Length(1, MOST_CAMERAS)]
    frames: Annotated[tuple[SolvedFrame, ...], Length(1, MOST_FRAMES)]
    target: Annotated[PointsRecord | None, LEFT_OUT] = None
    """As its file has it, where a robot's ways told another size, which each camera's own file has it in."""

    def __post_init__(self) -> None:
        count = len(self.cameras)
        if len({one.name for one in self.cameras}) < count or len({one.folder for one in self.cameras}) < count:
            raise ValueError("cameras must each have another name and folder")
        if self.reference >= count:
            raise ValueError(f"reference {self.reference}: there are {count} cameras, counted from 0")
        if any((one.frame >= len(self.frames)).any() for one in self.cameras):
            raise ValueError(f"a camera has a frame beyond the {len(self.frames)} there are")
        for name in ("time_s", "delay_s", "delay_sigma_s"):
            if len({getattr(one, name) is None for one in self.cameras}) > 1:
                raise ValueError(f"either all cameras have {name}, or none")
        if (np.diagonal(self.covariance) < 0).any():
            raise ValueError("covariance has a variance below 0")
        if fault := rigid_fault(np.stack([one.rig_from_target for one in self.frames])):
            raise ValueError(f"frames.{fault[0]}.rig_from_target {fault[1]}")
        if self.carrier is not None and len(self.carrier.error) != len(self.frames):
            raise ValueError("carrier.error must have a row a frame")


RIG_CALIBRATION = FileKind(
    RigRecord, "rig_calibration", "a rig_calibration.json", "solve the rig again", largest_bytes=512 * 2**20
)


def rig_files(folder: Path, found: RigCalibration, provenance: Provenance) -> dict[Path, bytes]:
    """The files of a solved rig and of its cameras, the rig's own last.

    Raises:
        InputError: they hold what `read_rig` refuses.
    """
    files: dict[Path, bytes] = {}
    digests = []
    names = folder_names(found.observations.camera_names)
    for one, name in zip(found.alone, names, strict=True):
        as_solved = replace(provenance, options=_as_solved(one, provenance.options))
        own, told = calibration_files(folder / CAMERAS / name, one, as_solved)
        files |= own
        digests.append(told.observations_sha256)
    return {**files, folder / RIG_CALIBRATION_FILE: RIG_CALIBRATION.text(_record(found, provenance, names, digests))}


def _as_solved(one: Calibration, options: SolveOptions) -> SolveOptions:
    """How a camera by itself is solved again as with the others."""
    bend = one.target_bend
    return replace(
        options, fixed=tuple((name, one.camera.parameters[name]) for name in one.fixed), priors=one.priors,
        free_bend=bend is not None, bend_sigma_mm=None if bend is None else bend.believed_mm,
    )  # fmt: skip


def folder_names(camera_names: Sequence[str]) -> tuple[str, ...]:
    """A folder of each camera: its name where that is a plain one, else its number; no two alike in any letters."""
    return no_two_alike(
        name if _SAFE.fullmatch(name) and not name.endswith(".") else f"camera_{number}"
        for number, name in enumerate(camera_names)
    )


_ALIKE = tuple(one.name for one in fields(JointSolution))


def _record(found: RigCalibration, provenance: Provenance, folders: Sequence[str], digests: Sequence[str]) -> RigRecord:
    """What the file says."""
    seen = found.observations
    return RigRecord(
        provenance=provenance,
        observed=seen.remarks,
        cameras=tuple(
            HeldCamera(
                name,
                folders[k],
                found.cam_from_rig[k],
                found.is_refined[k],
                digests[k],
                seen.frame[k],
                None if seen.time_s is None else seen.time_s[k],
                None if found.delay_s is None else float(found.delay_s[k]),
                None if found.delay_sigma_s is None else float(found.delay_sigma_s[k]),
            )
            for k, name in enumerate(seen.camera_names)
        ),
        frames=tuple(
            SolvedFrame(*frame)
            for frame in zip(seen.frame_names, found.rig_from_target, found.frame_covariance, strict=True)
        ),
        target=PointsRecord.of(seen.points) if found.carrier is not None and found.carrier.size != 1 else None,
        **{name: getattr(found, name) for name in _ALIKE},
    )


def read_rig(folder: Path) -> tuple[RigCalibration, Provenance]:
    """Read the rig of a folder.

    Raises:
        InputError: a file cannot be read, breaks a rule, or does not belong to the others; the message names it.
    """
    path = folder / RIG_CALIBRATION_FILE
    record = RIG_CALIBRATION.read(path)
    alone = [_read_camera(folder, one) for one in record.cameras]
    points = alone[0].observations.points
    for one, held in zip(alone, record.cameras, strict=True):
        if not _same_points(one.observations.points, points):
            raise InputError(f"{path}: {shown(held.name)} saw another target than the others; solve the rig again")
    size = sum(len(one.camera.params) + POSE for one in alone)
    if len(record.covariance) != size:
        raise InputError(f"{path}: a covariance of {len(record.covariance)} rows for {size} unknowns; solve again")
    if record.target is not None:
        points = record.target.known(points.geometry_id)
    cameras = record.cameras
    seen = RigObservations(
        tuple(one.name for one in cameras),
        tuple(one.name for one in record.frames),
        tuple(replace(one.observations, points=points) for one in alone),
        tuple(one.frame for one in cameras),
        tuple(np.asarray(one.time_s) for one in cameras) if cameras[0].time_s is not None else None,
        record.observed,
    )
    delays = [one.delay_s for one in cameras if one.delay_s is not None]
    sigmas = [one.delay_sigma_s for one in cameras if one.delay_sigma_s is not None]
    return RigCalibration(
        observations=seen,
        cameras=tuple(one.camera for one in alone),
        cam_from_rig=np.stack([one.cam_from_rig for one in cameras]),
        rig_from_target=np.stack([one.rig_from_target for one in record.frames]),
        residual_px=tuple(one.residual_px for one in alone),
        is_outlier=tuple(one.is_outlier for one in alone),
        scale=np.array([one.scale for one in alone]),
        frame_covariance=np.stack([one.covariance for one in record.frames]),
        pose_covariance=tuple(one.pose_covariance for one in alone),
        fixed=tuple(one.fixed for one in alone),
        delay_s=np.array(delays) if delays else None,
        delay_sigma_s=np.array(sigmas) if len(sigmas) == len(cameras) else None,
        target_bend=alone[0].target_bend,
        priors=tuple(one.priors for one in alone),
        **{name: getattr(record, name) for name in _ALIKE},
    ), record.provenance


def _read_camera(folder: Path, held: HeldCamera) -> Calibration:
    """A camera's own folder, if it is the one that was solved with the others."""
    path = folder / CAMERAS / held.folder / CALIBRATION_FILE
    one, provenance = read_calibration(path)
    if provenance.observations_sha256 != held.observations_sha256 or one.observations.view_count != len(held.frame):
        raise InputError(f"{path}: does not belong to {folder / RIG_CALIBRATION_FILE}; solve the rig again")
    return one


def _same_points(one: KnownPoints, other: KnownPoints) -> bool:
    return all(
        np.array_equal(getattr(one, name), getattr(other, name)) for name in ("position_mm", "face", "plane")
    ) and (one.geometry_id == other.geometry_id)
