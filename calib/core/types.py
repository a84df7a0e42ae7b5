"""What is seen in photos, and of what; and parts of it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from designer.base.arrays import Array, Flags

SUREST = 0.25
"""Of the median standard deviation; what states a smaller one, such as 1e-6 px, would own the pose of its photo."""
Rows = Flags | NDArray[np.int64]


def frozen_array(values: object, dtype: type[np.generic] = np.float64) -> NDArray[np.generic]:
    """A read-only, C-contiguous copy of `values`."""
    array = np.array(values, dtype=dtype, order="C")
    array.setflags(write=False)
    return array


def freeze(value: object, *names: str, dtype: type[np.generic] = np.float64) -> None:
    """Make arrays of a frozen dataclass read-only copies; what is None stays so."""
    for name in names:
        if getattr(value, name) is not None:
            object.__setattr__(value, name, frozen_array(getattr(value, name), dtype))


LEAST_RADIUS_PX = 5.0
"""Of a ring that faces the camera, for the detector; turned away it is flatter, and the detector wants 5 px across."""
Mark = Literal["dot", "ring", "unreadable"]
TOO_FLAT, OUTSIDE, CUT_OFF = "seen too small or too flat", "outside the image", "cut by the image's edge"
NOT_MEASURABLE = (TOO_FLAT, OUTSIDE, CUT_OFF)
"""Why features are missing that no camera could have measured from there."""
UNMEASURABLE_WORDS = f"{TOO_FLAT}, outside the image or cut by its edge"


@dataclass(frozen=True)
class FaceRecord:
    """What was read of one face, or of a group of rings that was found but could not be named.

    Why rings are missing is counted by reason, so that a person sees what to change.
    """

    face: int | None  # None: the group could not be named, `remark` says why
    code_read: tuple[Mark, ...]  # the six candidate positions of a face code, or the three dots of a board; () without
    margin: int  # how many marks fit the name given better than the next best name
    rings_found: int  # named features, dots included
    rings_expected: int  # features of the face
    missing: tuple[tuple[str, int], ...]  # reason, how many; sums to expected - found for a named face
    remark: str = ""
    carries: int | None = None  # the face whose code it shows, against its neighbours; itself: it lies turned

    @property
    def measurable(self) -> int:
        """How many features could have been measured: all but those too flat, cut off or outside the image."""
        return self.rings_expected - sum(count for why, count in self.missing if why in NOT_MEASURABLE)


@dataclass(frozen=True, eq=False)
class Detections:
    """N named features in one image: `cv2.solvePnP(found.object_points, found.image_points, matrix, distortion)`."""

    image: str  # the file's name without folder
    image_size: tuple[int, int]  # width, height in px
    layout_id: str  # of the target they were named with
    geometry_id: str
    ring: NDArray[np.int64]  # (N,) rows of the target's arrays, ascending
    position_mm: Array  # (N, 3) X Y Z in the target that they were named with
    center_px: Array  # (N, 2) projected centres, u v
    cov_px2: Array  # (N, 2, 2)
    ellipse_px: Array  # (N, 5) outer contour: centre u v, semi-axes major minor, angle of the major (rad)
    faces: tuple[FaceRecord, ...]
    remarks: tuple[str, ...] = ()  # what a person must know of this image: why nothing was found, mirrored, ambiguous
    rejected_px: Array | None = None  # (K, 2) ring-like things that got no name
    ratio: Array | None = None  # (N,) inner over outer radius, 0 of a dot; nan or None: not known
    blur_px: Array | None = None  # (N,) standard deviation of the edges' blur; likewise
    motion_px: float = 0.0  # by which a motion smeared all edges while the photo was exposed; 0: none noticed
    time_s: float | None = None  # when the photo was taken, by its camera's clock; None: nobody says

    def __post_init__(self) -> None:
        freeze(self, "ring", dtype=np.int64)
        freeze(self, "position_mm", "center_px", "cov_px2", "ellipse_px")
        for name in ("ratio", "blur_px"):
            values = getattr(self, name)
            object.__setattr__(self, name, frozen_array(np.full(len(self.ring), np.nan) if values is None else values))
        rejected = np.zeros((0, 2)) if self.rejected_px is None else self.rejected_px
        object.__setattr__(self, "rejected_px", frozen_array(rejected))

    def __repr__(self) -> str:
        """A line, without the numbers."""
        return f"<Detections of {self.image}: {'; '.join((f'{len(self.ring)} features', *self.remarks))}>"

    @property
    def edges(self) -> Array:
        """Semi-axes (px) and angle of the outer contour, ratio of radii, blur (px); nan: not known.  # (N, 5)"""
        return np.column_stack([self.ellipse_px[:, 2:], np.asarray(self.ratio), np.asarray(self.blur_px)])

    @property
    def object_points(self) -> NDArray[np.float32]:
        """X Y Z in mm as OpenCV takes them, and as `cv2.aruco.Board.matchImagePoints` returns them.  # (N, 1, 3)"""
        return self.position_mm.astype(np.float32)[:, None]

    @property
    def image_points(self) -> NDArray[np.float32]:
        """Centres in px likewise, (0, 0) at the centre of the top-left pixel as OpenCV has it.  # (N, 1, 2)"""
        return self.center_px.astype(np.float32)[:, None]

    def keep(self, which: NDArray[np.int64] | Flags | slice) -> "Detections":
        """Some of the features, by row or by flag."""
        names = ("ring", "position_mm", "center_px", "cov_px2", "ellipse_px", "ratio", "blur_px")
        return replace(self, **{name: getattr(self, name)[which] for name in names})


@dataclass(frozen=True, eq=False)
class KnownPoints:
    """The K points of a target whose sightings a camera is solved from, and the planes they lie in."""

    position_mm: Array  # (K, 3) in the target's frame
    face: NDArray[np.int64]  # (K,) row of `plane`; -1: on no known plane
    plane: Array  # (F, 4) unit normal n and offset d (mm) of the plane n X = d
    geometry_id: str = ""  # of the target file they come from; "" for points from elsewhere
    circle_mm: Array | None = None
    """(K,) diameters of the circles whose images' centres were measured; 0: the point itself was, nan: nobody said;
    None: the points themselves."""
    turned: NDArray[np.int64] | None = None
    """(T, K) which point each looks like with the target turned by so many parts of a full turn; None: like none."""

    def __post_init__(self) -> None:
        freeze(self, "face", "turned", dtype=np.int64)
        freeze(self, "position_mm", "plane", "circle_mm")

    @property
    def middle_mm(self) -> Array:
        """Of the box around them.  # (3,)"""
        middle: Array = 0.5 * (self.position_mm.min(axis=0) + self.position_mm.max(axis=0))
        return middle


@dataclass(frozen=True, eq=False)
class Observations:
    """M known points as V views of one camera show them: `calib.solve(observations)`."""

    image_size: tuple[int, int]  # width, height in px
    view_names: tuple[str, ...]  # (V,)
    view: NDArray[np.int64]  # (M,) ascending
    point: NDArray[np.int64]  # (M,) rows of `points`
    center_px: Array  # (M, 2)
    cov_px2: Array | None  # (M, 2, 2); None: not known, all alike
    points: KnownPoints
    remarks: tuple[str, ...] = ()  # what was left out of them, or should be known, one line each
    smeared: tuple[str, ...] = ()  # names of views that a motion blurred

    def __post_init__(self) -> None:
        freeze(self, "view", "point", dtype=np.int64)
        freeze(self, "center_px", "cov_px2")

    @property
    def view_count(self) -> int:
        """How many views."""
        return len(self.view_names)


@dataclass(frozen=True, eq=False)
class RigObservations:
    """What C cameras saw of one target in V frames, each camera in some of them: `calib.rig(observations)`."""

    camera_names: tuple[str, ...]  # (C,) each another
    frame_names: tuple[str, ...]  # (V,)
    sightings: tuple[Observations, ...]  # (C,) of each camera, of the same points; its views are frames
    frame: tuple[NDArray[np.int64], ...]  # (C,) of (V_c,): the frame of each view of a camera, ascending
    time_s: tuple[Array, ...] | None = None  # (C,) of (V_c,): time stamps; None: taken at once
    remarks: tuple[str, ...] = ()  # what was left out, or should be known, one line each

    def __post_init__(self) -> None:
        object.__setattr__(self, "frame", tuple(frozen_array(rows, np.int64) for rows in self.frame))
        if self.time_s is not None:
            object.__setattr__(self, "time_s", tuple(frozen_array(times) for times in self.time_s))
        if not len(self.camera_names) == len(self.sightings) == len(self.frame):
            raise ValueError("names, sightings and frames of as many cameras are needed")
        if any(len(rows) != seen.view_count for rows, seen in zip(self.frame, self.sightings, strict=True)):
            raise ValueError("each view of a camera is a frame")

    @property
    def camera_count(self) -> int:
        """C."""
        return len(self.camera_names)

    @property
    def frame_count(self) -> int:
        """V."""
        return len(self.frame_names)

    @property
    def points(self) -> KnownPoints:
        """What was seen."""
        return self.sightings[0].points

    @property
    def shared(self) -> NDArray[np.int64]:
        """In how many frames cameras see the target together, on the diagonal at all.  # (C, C)"""
        sees = np.zeros((self.camera_count, self.frame_count), dtype=np.int64)
        for row, frames in zip(sees, self.frame, strict=True):
            row[frames] = 1
        together: NDArray[np.int64] = sees @ sees.T
        return together


def keep_frames(observations: RigObservations, keep: Flags) -> RigObservations:
    """The sightings of some frames (V,), which are numbered anew."""
    if keep.all():
        return observations
    number, kept = np.cumsum(keep) - 1, keep_photos(observations, [keep[frames] for frames in observations.frame])
    names = tuple(name for name, ok in zip(observations.frame_names, keep.tolist(), strict=True) if ok)
    return replace(kept, frame_names=names, frame=tuple(number[frames] for frames in kept.frame))


def keep_photos(observations: RigObservations, keep: Sequence[Flags]) -> RigObservations:
    """The sightings of some views (V_c,) of each camera; all frames stay."""
    times = observations.time_s
    return replace(
        observations,
        sightings=tuple(keep_views(seen, ok) for seen, ok in zip(observations.sightings, keep, strict=True)),
        frame=tuple(frames[ok] for frames, ok in zip(observations.frame, keep, strict=True)),
        time_s=None if times is None else tuple(one[ok] for one, ok in zip(times, keep, strict=True)),
    )


def keep_sightings(observations: Observations, rows: Rows) -> Observations:
    """Some sightings, by a mask (M,) or by their rows; all views stay, also empty ones."""
    return replace(
        observations,
        view=observations.view[rows],
        point=observations.point[rows],
        center_px=observations.center_px[rows],
        cov_px2=None if observations.cov_px2 is None else observations.cov_px2[rows],
    )


def keep_views(observations: Observations, keep: Flags) -> Observations:
    """The sightings of some views (V,), which are numbered anew."""
    if keep.all():
        return observations
    names = zip(observations.view_names, keep.tolist(), strict=True)
    kept = keep_sightings(observations, keep[observations.view])
    return replace(kept, view_names=tuple(name for name, ok in names if ok), view=(np.cumsum(keep) - 1)[kept.view])


LEAST_POINTS = 4
"""Of a view, for a pose: a homography has eight unknowns."""


def sightings_per_view(observations: Observations) -> NDArray[np.int64]:
    """How many sightings each view has.  # (V,)"""
    count: NDArray[np.int64] = np.bincount(observations.view, minlength=observations.view_count)
    return count


def without_empty_views(observations: Observations) -> Observations:
    """The observations without the views that have no sighting."""
    return keep_views(observations, sightings_per_view(observations) > 0)


def with_sound_covariances(observations: Observations) -> tuple[Observations, int]:
    """The observations with no axis of a covariance surer than a quarter of the median, and how many were.

    The median is of the surest axes, whose standard deviations differ by factors of two or three in one set of photos.
    """
    covariance = observations.cov_px2
    if covariance is None or not len(covariance):
        return observations, 0
    value, axis = np.linalg.eigh(covariance)
    least = (SUREST * np.sqrt(np.median(value[:, 0].clip(min=0.0)))) ** 2
    (rows,) = np.nonzero(value[:, 0] < least)
    if not len(rows):
        return observations, 0
    sound = covariance.copy()
    sound[rows] = (axis[rows] * value[rows, None].clip(min=least)) @ axis[rows].transpose(0, 2, 1)
    return replace(observations, cov_px2=sound), len(rows)
