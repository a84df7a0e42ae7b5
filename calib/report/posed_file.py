"""`posed.json` in a folder of overlays: where the camera stood in each photo, and which picture shows it."""

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import JsonValue

from calib.camera_file import camera_from_mapping, camera_to_json
from calib.files import write_files
from calib.report.own_file import MOST_PHOTOS, own_to_json, read_own, require_counts, require_near
from calib.results.rigid import rigid_fault
from calib.types import Camera
from designer.errors import InputError

if TYPE_CHECKING:
    from calib.pose import TargetPose
    from designer.target import TargetGeometry

POSED_FILE = "posed.json"
FORMAT = "ringsolid.posed"
REMEDY = "find the poses again"
Three = tuple[float, float, float]
Row = tuple[float, float, float, float]
Matrix = tuple[Row, Row, Row, Row]


@dataclass(frozen=True)
class StoredPose:
    """The pose in one photo, see `calib.pose.TargetPose`."""

    rings: int
    rms_px: float
    camera_mm: Three
    camera_sigma_mm: Three
    distance_mm: float
    distance_sigma_mm: float
    rotation_sigma_rad: float
    cam_from_target: Matrix


@dataclass(frozen=True)
class PosedPhoto:
    """A photo with its pose, or why there is none."""

    image: str
    pose: StoredPose | None
    reason: str = ""
    overlay: str = ""  # within the folder; "": there is none


@dataclass(frozen=True)
class PosedFile:
    """The file's keys."""

    target: str  # its file, as it was given
    geometry_id: str
    camera_name: str  # as it was given
    camera: dict[str, JsonValue]  # as its file has it; of a learned one the linear part, which is drawn
    model: str  # of the camera
    poses: str  # the file of poses, as it was given; "" without
    photos: tuple[PosedPhoto, ...]
    failures: tuple[str, ...]  # arguments that stood for no photo, one line each
    format: Literal["ringsolid.posed"] = "ringsolid.posed"
    version: Literal[1] = 1

    @property
    def cam_from_target(self) -> NDArray[np.float64]:
        """The poses that were found.  # (V, 4, 4)"""
        found = [photo.pose.cam_from_target for photo in self.photos if photo.pose is not None]
        return np.array(found, dtype=np.float64).reshape(-1, 4, 4)


@dataclass(frozen=True, eq=False)
class PosedBy:
    """What poses were found with."""

    target: Path
    geometry: "TargetGeometry"
    camera_name: str
    camera: Camera
    out: Path | None  # the file of poses


def write_posed(
    folder: Path,
    made: PosedBy,
    names: Sequence[str],
    poses: "Mapping[str, TargetPose]",
    reasons: Mapping[str, str],
    overlays: Mapping[str, str],
    failures: Sequence[str],
) -> Path:
    """Write `posed.json`; its path.

    Args:
        folder: of the overlays.
        made: what they were found with.
        names: of the photos, in their order.
        poses: by name.
        reasons: why others have none, by name.
        overlays: names of pictures in the folder, by name of the photo.
        failures: arguments that stood for no photo.

    Raises:
        InputError: another file has that name, or it cannot be written.
    """
    path = folder / POSED_FILE
    camera = made.camera
    drawn = camera if camera.learned is None else Camera("pinhole", camera.params[:4], camera.image_size)
    file = PosedFile(
        str(made.target), made.geometry.geometry_id, made.camera_name, json.loads(camera_to_json(drawn)), camera.model,
        "" if made.out is None else os.fspath(made.out),
        tuple(
            PosedPhoto(name, _stored(poses[name]) if name in poses else None, reasons.get(name, ""),
                       overlays.get(name, ""))
            for name in names
        ),
        tuple(failures),
    )  # fmt: skip
    write_files({path: own_to_json(asdict(file))})
    return path


def _stored(pose: "TargetPose") -> StoredPose:
    x, y, z = pose.camera_mm.tolist()
    sx, sy, sz = pose.camera_sigma_mm.tolist()
    a, b, c, d = (_row(row) for row in pose.cam_from_target.tolist())
    return StoredPose(
        pose.rings, pose.rms_px, (x, y, z), (sx, sy, sz), pose.distance_mm, pose.distance_sigma_mm,
        pose.rotation_sigma_rad, (a, b, c, d),
    )  # fmt: skip


def _row(row: Sequence[float]) -> Row:
    a, b, c, d = row
    return a, b, c, d


def read_posed(folder: Path) -> tuple[PosedFile, Camera]:
    """Read `posed.json`, and the camera in it; a photo whose pose is no motion has none.

    Raises:
        InputError: it cannot be read, or breaks a rule; the message names it.
    """
    path = folder / POSED_FILE
    file = read_own(path, PosedFile, REMEDY)
    if not 0 < len(file.photos) <= MOST_PHOTOS:
        raise InputError(f"{path}: {len(file.photos)} photos; there are 1 to {MOST_PHOTOS}; {REMEDY}")
    require_counts(path, (photo.pose.rings for photo in file.photos if photo.pose is not None), REMEDY)
    checked = replace(file, photos=tuple(map(_checked, file.photos)))
    require_near(path, checked.cam_from_target, REMEDY)
    return checked, camera_from_mapping(file.camera, f"{path}: camera")


def _checked(photo: PosedPhoto) -> PosedPhoto:
    """The photo without a pose that is none."""
    if photo.pose is None or rigid_fault(np.array([photo.pose.cam_from_target])) is None:
        return photo
    return replace(photo, pose=None, reason="its pose is no rigid motion")
