"""Cameras that are held together: where each stands, how surely, and the file that keeps it.

A pair of cameras turned in thought until rows of one image are rows of the other.

Each camera turns by half of the rotation between them, then both until the baseline lies along the rows, or along the
columns of one camera above the other (Bouguet's method; Bradski and Kaehler 2008, chapter 12). Both get one focal
length and one principal point, so that disparities of far points are zero.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated

import numpy as np

from calib.cameras import rays
from calib.cameras.camera import Camera, linear_part
from calib.core.se3 import exp_rotation, invert, log_rotation, rigid_fault
from calib.core.types import freeze
from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.base.file_kind import FileKind
from designer.base.files import place_of, write_files
from designer.base.marks import LEFT_OUT, PACKED, AtLeast, AtMost, Length, Shape
from designer.base.words import shown, suggestion

MOST_CAMERAS = 256
LONGEST_DELAY_S = 1e3
POSE = 6
"""Numbers of a pose in a covariance: rotation vector (rad), shift (mm)."""
_Noise = Annotated[Array, Shape("C"), AtLeast(0), AtMost(1e6)]
_Delay = Annotated[Array, Shape("C"), AtLeast(-LONGEST_DELAY_S), AtMost(LONGEST_DELAY_S)]


@dataclass(frozen=True, eq=False)
class Rig:
    """C cameras held together: `rig = calib.load_rig("rig.json"); rig.cam_from_rig[rig.row("left")]`.

    The joint covariance has, camera after camera, the P parameters and the six of the pose: `cam_from_rig` turned by
    the rotation vector w (rad) and shifted by s (mm), both in the camera's axes, `x_cam' = exp(w) R x_rig + t + s`.
    Rows of what was fixed are zero, as are those of the pose of the camera whose frame the rig's is.
    """

    names: Annotated[tuple[Annotated[str, Length(1, 100)], ...], Length(1, MOST_CAMERAS)]  # (C,)
    cameras: tuple[Camera, ...]  # (C,)
    cam_from_rig: Annotated[Array, Shape("C", 4, 4)]
    covariance: Annotated[Array, Shape("N", "N"), PACKED] | None = None  # as it is to be told; None: not known
    noise_px: Annotated[_Noise | None, LEFT_OUT] = None  # of a centre's coordinate
    delay_s: Annotated[_Delay | None, LEFT_OUT] = None
    """By which each camera's time stamps run behind: a photo stamped t was taken at t - delay; None: synchronous."""
    rig_frame: Annotated[str, Length(0, 200)] = ""
    """Whose frame the rig's is: a camera's name, "flange", "base", "table"; "" is the first camera's."""
    geometry_id: Annotated[str, Length(0, 100)] = ""  # of the target it was solved from

    def __post_init__(self) -> None:
        freeze(self, "cam_from_rig", "covariance", "noise_px", "delay_s")
        count = len(self.names)
        if len(set(self.names)) < count:
            twice = next(name for name in self.names if self.names.count(name) > 1)
            raise InputError(f"two cameras are named {shown(twice)}; give each its own name")
        if len(self.cameras) != count or len(self.cam_from_rig) != count:
            raise InputError(
                f"{count} names, {len(self.cameras)} cameras, {len(self.cam_from_rig)} poses: as many each"
            )
        fault = rigid_fault(self.cam_from_rig)
        if fault is not None:
            raise InputError(f"cam_from_rig of {shown(self.names[fault[0]])} {fault[1]}")
        if self.covariance is not None and len(self.covariance) != self.first_row[-1]:
            raise InputError(f"a covariance of {len(self.covariance)} rows for {self.first_row[-1]} unknowns")

    @cached_property
    def first_row(self) -> tuple[int, ...]:
        """Where each camera's rows of the covariance begin, and where the last end.  # (C + 1,)"""
        sizes = [len(camera.params) + POSE for camera in self.cameras]
        return tuple(np.concatenate([[0], np.cumsum(sizes)]).tolist())

    def row(self, name: str) -> int:
        """The row of a camera, by its name.

        Raises:
            InputError: there is none.
        """
        if name not in self.names:
            raise InputError(
                f"camera {shown(name)}: not in the rig"
                f"{suggestion(name, list(self.names)) or '; there are ' + ', '.join(self.names)}"
            )
        return self.names.index(name)

    def params_rows(self, camera: int) -> slice:
        """The rows of a camera's parameters in the covariance."""
        return slice(self.first_row[camera], self.first_row[camera + 1] - POSE)

    def pose_rows(self, camera: int) -> slice:
        """The rows of a camera's pose in the covariance."""
        return slice(self.first_row[camera + 1] - POSE, self.first_row[camera + 1])

    @property
    def rig_from_cam(self) -> Array:
        """The other way round.  # (C, 4, 4)"""
        return invert(self.cam_from_rig)

    @property
    def center_mm(self) -> Array:
        """Where the cameras are, in the rig's frame.  # (C, 3)"""
        center: Array = self.rig_from_cam[:, :3, 3]
        return center

    def save(self, path: str | Path) -> Path:
        """Write `rig.json`, which reads back bit for bit: `rig.save("rig.json")`; return its place.

        Raises:
            InputError: the place takes no file, or holds somebody else's.
        """
        place = place_of(path, "a file to write, such as rig.json")
        write_files({place: RIG.text(self)})
        return place


ALONE = "camera"
"""What the only camera of a rig is called where nobody named it."""


def rig_of_one(camera: Camera, name: str = ALONE) -> Rig:
    """A camera as a rig of that camera alone, whose frame the rig's is."""
    return Rig((name,), (camera,), np.eye(4)[None])


def keep_cameras(rig: Rig, rows: Sequence[int]) -> Rig:
    """The rig of some of its cameras, in that order; its frame stays where it was."""
    if not len(rows):
        raise InputError("no camera: a rig has at least one")
    kept = [number for row in rows for number in range(rig.first_row[row], rig.first_row[row + 1])]
    return replace(
        rig,
        names=tuple(rig.names[row] for row in rows),
        cameras=tuple(rig.cameras[row] for row in rows),
        cam_from_rig=rig.cam_from_rig[list(rows)],
        covariance=None if rig.covariance is None else rig.covariance[np.ix_(kept, kept)],
        noise_px=None if rig.noise_px is None else rig.noise_px[list(rows)],
        delay_s=None if rig.delay_s is None else rig.delay_s[list(rows)],
        rig_frame=rig.rig_frame or rig.names[0],
    )


RIG = FileKind(Rig, "rig", "a rig.json", "solve the rig again")


LEAST_COSINE = 0.5
"""Of the angle by which a camera may turn; pictures of cameras that turn farther overlap in nothing of use."""
CORNER_COSINE = 0.26
"""Corners of the image that are seen farther off the new axis do not say where the middle of the picture is."""


@dataclass(frozen=True, eq=False)
class RectifiedPair:
    """How a pair is rectified: `rectified.projection[1]` is OpenCV's P2. Lengths are in the unit of the pose."""

    rect_from_cam: Array  # (2, 3, 3)
    focal_px: float
    center_px: tuple[float, float]
    shift: float  # along the rows, or the columns, of the second camera's new frame: what T has there
    is_upright: bool  # one camera above the other

    def __post_init__(self) -> None:
        freeze(self, "rect_from_cam")

    @property
    def matrix(self) -> Array:
        """Of both pictures.  # (3, 3)"""
        cx, cy = self.center_px
        return np.array([[self.focal_px, 0.0, cx], [0.0, self.focal_px, cy], [0.0, 0.0, 1.0]])

    @property
    def projection(self) -> Array:
        """Pixels of points in the first camera's new frame.  # (2, 3, 4)"""
        projection = np.zeros((2, 3, 4))
        projection[:, :, :3] = self.matrix
        projection[1, int(self.is_upright), 3] = self.focal_px * self.shift
        return projection

    @property
    def point_from_disparity(self) -> Array:
        """Points of a column, a row and a disparity: OpenCV's Q.  # (4, 4)"""
        cx, cy = self.center_px
        result = np.eye(4)
        result[:2, 3] = -cx, -cy
        result[2] = 0, 0, 0, self.focal_px
        result[3] = 0, 0, -1 / self.shift, 0
        return result


def rectified_pair(cameras: Sequence[Camera], second_from_first: Array) -> RectifiedPair | None:
    """How two cameras of one image size are rectified; None where they see nothing alike.

    Args:
        cameras: two, of any models.
        second_from_first: (4, 4) in any unit of length.
    """
    rotation, shift = second_from_first[:3, :3], second_from_first[:3, 3]
    first, second = cameras
    if first.image_size != second.image_size or not np.linalg.norm(shift) > 0:
        return None
    half = exp_rotation(-0.5 * log_rotation(rotation))  # of the second camera; the first turns the other way
    along = half @ shift
    axis = int(abs(along[1]) >= abs(along[0]))
    aligned = _turned_to(along, axis)
    rect_from_cam = np.stack([aligned @ half.T, aligned @ half])
    if (rect_from_cam[:, 2, 2] < LEAST_COSINE).any():
        return None
    focal = float(np.mean([linear_part(camera).params[1 - axis] for camera in cameras]))
    middles = [_middle_px(camera, turn, focal) for camera, turn in zip(cameras, rect_from_cam, strict=True)]
    center = np.mean(middles, axis=0)
    aside = float((rect_from_cam[1] @ shift)[axis])
    return RectifiedPair(rect_from_cam, focal, (float(center[0]), float(center[1])), aside, bool(axis))


def _turned_to(along: Array, axis: int) -> Array:
    """The smallest rotation (3, 3) that lays a baseline along an axis of the image, to its nearer end."""
    end = np.zeros(3)
    end[axis] = 1.0 if along[axis] >= 0 else -1.0
    turn = np.cross(along, end)
    length = float(np.linalg.norm(turn))
    angle = np.arctan2(length, float(along @ end))
    return exp_rotation(turn * (angle / length if length > 0 else 0.0))


def _middle_px(camera: Camera, rect_from_cam: Array, focal: float) -> Array:
    """The principal point (2,) that puts the middle of a camera's picture in the middle of the new one."""
    width, height = camera.image_size
    last = np.array([width - 1.0, height - 1.0])
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]]) * last
    ray = rays(camera, corners) @ rect_from_cam.T
    if not (ray[:, 2] > CORNER_COSINE).all():  # a wide lens: its middle alone
        ray = rays(camera, linear_part(camera).params[None, 2:4]) @ rect_from_cam.T
    middle: Array = last / 2 - focal * (ray[:, :2] / ray[:, 2:]).mean(axis=0)
    return middle
