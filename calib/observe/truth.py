"""`truth.json` of rendered photos: the camera that took them, and where it stood."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calib.cameras.camera import Camera
from calib.cameras.camera_file import camera_from_mapping
from calib.core.rigid import rigid_fault
from calib.core.types import frozen_array
from designer.errors import InputError
from designer.small_file import JsonValue, parse_json, read_small_text
from designer.words import shown

FORMAT = "ringsolid.truth"
VERSION = 1
MAX_FILE_BYTES = 64 * 2**20
MAX_VIEWS = 100_000


@dataclass(frozen=True, eq=False)
class Truth:
    """What is known of V rendered photos."""

    camera: Camera
    geometry_id: str  # of the target that was rendered
    files: tuple[str, ...]  # (V,) names of the images
    cam_from_target: NDArray[np.float64]  # (V, 4, 4)
    layout_id: str = ""  # of the target; "" if it is not known

    def rendered_id(self, photos: Iterable[str]) -> str:
        """The geometry that photos of these names show; "" if one of them was not rendered."""
        return self.geometry_id if {Path(name).name for name in photos} <= set(self.files) else ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "cam_from_target", frozen_array(self.cam_from_target))


def read_truth(path: Path) -> Truth:
    """Read the `truth.json` that `calib render` writes beside its photos.

    Raises:
        InputError: it cannot be read, or holds no truth of this version; the message names file and place.
    """
    document = parse_json(read_small_text(path, MAX_FILE_BYTES, "a truth.json"), path, "a truth.json")
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise InputError(f'{path}: not the truth of rendered photos: it must hold "format": "{FORMAT}"')
    if type(document.get("version")) is not int or document["version"] != VERSION:
        raise InputError(f"{path}: version {shown(document.get('version'))}; this program reads version {VERSION}")
    geometry_id, layout_id = (_id(document.get(name), name, path) for name in ("geometry_id", "layout_id"))
    camera = camera_from_mapping(document.get("camera"), f"{path}: camera")
    files, poses = _views(document.get("views"), path)
    return Truth(camera, geometry_id, files, poses, layout_id)


def _id(value: JsonValue, name: str, path: Path) -> str:
    if not isinstance(value, str):
        raise InputError(f"{path}: {name} is missing; render again")
    return value


def _views(views: JsonValue, path: Path) -> tuple[tuple[str, ...], NDArray[np.float64]]:
    """File names and poses of the views."""
    if not isinstance(views, list) or not 0 < len(views) <= MAX_VIEWS:
        raise InputError(f"{path}: views must be a list of 1 to {MAX_VIEWS} views; render again")
    poses = np.empty((len(views), 4, 4))
    files: dict[str, None] = {}
    for number, view in enumerate(views):
        place = f"{path}: view {number} (from 0)"
        if not isinstance(view, dict) or not isinstance(name := view.get("file"), str):
            raise InputError(f"{place} names no file; render again")
        if name in files:
            raise InputError(f"{place}: the file {shown(name)} a second time; names must differ")
        files[name] = None
        matrix = view.get("cam_from_target")
        if not is_matrix(matrix, 4, 4):
            raise InputError(f"{place}: cam_from_target must be 4 rows of 4 numbers")
        poses[number] = np.array(matrix, dtype=np.float64)
    if fault := rigid_fault(poses):
        raise InputError(f"{path}: view {fault[0]} (from 0): cam_from_target {fault[1]}; it must be a rigid motion")
    return tuple(files), poses


def is_matrix(value: JsonValue, rows: int, columns: int) -> bool:
    """Whether a value from JSON is so many rows of so many numbers, each within what a float holds."""
    return (
        isinstance(value, list)
        and len(value) == rows
        and all(isinstance(row, list) and len(row) == columns and all(map(_is_number, row)) for row in value)
    )


def _is_number(value: JsonValue) -> bool:
    return isinstance(value, float) or (type(value) is int and abs(value) < 2**63)


def true_poses(truth: Truth, view_names: Sequence[str]) -> NDArray[np.float64]:
    """The true poses of views by their file names, nan for views that it does not hold.  # (V, 4, 4)"""
    row = {name: number for number, name in enumerate(truth.files)}
    poses = np.full((len(view_names), 4, 4), np.nan)
    for number, name in enumerate(view_names):
        if name in row:
            poses[number] = truth.cam_from_target[row[name]]
    return poses
