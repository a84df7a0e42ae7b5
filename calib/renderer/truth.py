"""`truth.json` of rendered photos: the camera that took them, and where it stood: `TRUTH.read(path)`.

Photos of a rig have one in each camera's folder, and one above them: how the target was held, frame by frame.
"""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np

from calib.cameras.camera import Camera
from calib.cameras.rig import MOST_CAMERAS
from calib.core.se3 import rigid_fault
from calib.core.types import freeze
from calib.renderer.options import FileFormat, RenderOptions
from designer.base.arrays import Array
from designer.base.file_kind import FileKind
from designer.base.marks import LEFT_OUT, Hash, Length, Shape, Word
from designer.base.words import shown


@dataclass(frozen=True)
class FileOptions:
    """How photos are stored."""

    format: FileFormat
    quality: int  # of JPEG


@dataclass(frozen=True, eq=False)
class TrueView:
    """A photo, and where the camera stood."""

    file: str
    cam_from_target: Annotated[Array, Shape(4, 4)]

    def __post_init__(self) -> None:
        freeze(self, "cam_from_target")
        if fault := rigid_fault(self.cam_from_target[None]):
            raise ValueError(f"cam_from_target {fault[1]}; it must be a rigid motion")


def true_views(files: Sequence[str], cam_from_target: Array) -> tuple[TrueView, ...]:
    """Photos by their names, and their poses (V, 4, 4)."""
    return tuple(TrueView(*view) for view in zip(files, cam_from_target, strict=True))


@dataclass(frozen=True, eq=False)
class Truth:
    """What is known of rendered photos."""

    geometry_id: Hash  # of the target that was rendered
    camera: Camera
    views: Annotated[tuple[TrueView, ...], Length(1, 100_000)]
    seed: int | None = None
    layout_id: Hash = ""  # of the target; "" if it is not known
    options: RenderOptions | None = None
    file: FileOptions | None = None

    def __post_init__(self) -> None:
        if len(set(self.files)) < len(self.files):
            raise ValueError(f"views name {shown(Counter(self.files).most_common(1)[0][0])} twice; names must differ")

    @property
    def files(self) -> tuple[str, ...]:
        """Names of the images."""
        return tuple(view.file for view in self.views)

    def rendered_id(self, photos: Iterable[str]) -> str:
        """The geometry that photos of these names show; "" if one of them was not rendered."""
        return self.geometry_id if {Path(name).name for name in photos} <= set(self.files) else ""

    def poses_of(self, view_names: Sequence[str]) -> Array:
        """The true poses of views by their file names, nan for views that it does not hold.  # (V, 4, 4)"""
        known = {view.file: view.cam_from_target for view in self.views}
        unknown = np.full((4, 4), np.nan)
        return np.array([known.get(name, unknown) for name in view_names]).reshape(-1, 4, 4)


TRUTH = FileKind(Truth, "truth", "the truth of rendered photos", "render again")


@dataclass(frozen=True, eq=False)
class TrueFrame:
    """A moment, and how the target was held then."""

    name: str  # of the photos, without suffix
    rig_from_target: Annotated[Array, Shape(4, 4)]
    time_s: Annotated[float | None, LEFT_OUT] = None  # None: the target stood still

    def __post_init__(self) -> None:
        freeze(self, "rig_from_target")
        if fault := rigid_fault(self.rig_from_target[None]):
            raise ValueError(f"rig_from_target {fault[1]}; it must be a rigid motion")


@dataclass(frozen=True, eq=False)
class RigTruth:
    """What is known of a rig's rendered photos, beside the rig itself, which is in `rig.json`."""

    geometry_id: Hash  # of the target
    layout_id: Hash
    cameras: Annotated[tuple[Word, ...], Length(1, MOST_CAMERAS)]
    frames: Annotated[tuple[TrueFrame, ...], Length(1, 100_000)]
    seed: int


RIG_TRUTH = FileKind(RigTruth, "rig_truth", "the truth of a rig's rendered photos", "render again")
