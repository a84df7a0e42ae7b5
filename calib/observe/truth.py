"""`truth.json` of rendered photos: the camera that took them, and where it stood."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calib.cameras.camera import Camera
from calib.core.types import frozen_array
from calib.renderer.job import TRUTH


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
    found = TRUTH.read(path)
    poses = np.array([view.cam_from_target for view in found.views])
    return Truth(found.camera, found.geometry_id, tuple(view.file for view in found.views), poses, found.layout_id)


def true_poses(truth: Truth, view_names: Sequence[str]) -> NDArray[np.float64]:
    """The true poses of views by their file names, nan for views that it does not hold.  # (V, 4, 4)"""
    row = {name: number for number, name in enumerate(truth.files)}
    poses = np.full((len(view_names), 4, 4), np.nan)
    for number, name in enumerate(view_names):
        if name in row:
            poses[number] = truth.cam_from_target[row[name]]
    return poses
