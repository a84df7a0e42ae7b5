"""Points that nobody knows yet, as the cameras of a rig see them."""

from dataclasses import dataclass, replace

import numpy as np

from calib.cameras.rig import Rig
from calib.core.types import RigObservations, freeze
from designer.base.arrays import Array, Flags, Rows
from designer.base.errors import InputError
from designer.base.words import shown


@dataclass(frozen=True, eq=False)
class PointSightings:
    """M sightings of N points, each in a frame, by the cameras of a rig: `calib.triangulate(rig, sightings)`.

    A point that moves from frame to frame is another one in each of them.
    """

    frame_names: tuple[str, ...]  # (V,)
    point_names: tuple[str, ...]  # (K,)
    frame: Rows  # (N,) rows of `frame_names`
    point: Rows  # (N,) rows of `point_names`; a frame and a point stand together once
    camera: Rows  # (M,) rows of the rig's cameras
    place: Rows  # (M,) rows of `frame` and `point`; a camera sees each once at most
    center_px: Array  # (M, 2)
    cov_px2: Array | None = None  # (M, 2, 2) as stated, nan of those that state none; None: of all
    remarks: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        freeze(self, "frame", "point", "camera", "place", dtype=np.int64)
        freeze(self, "center_px", "cov_px2")

    @property
    def count(self) -> int:
        """N."""
        return len(self.frame)

    def name(self, place: int) -> str:
        """What a point is called: its frame's name and its own."""
        point, frame = self.point_names[self.point[place]], self.frame_names[self.frame[place]]
        return f"{frame}/{point}" if len(self.frame_names) > 1 else point


def of_rows(
    camera: Rows, frames: tuple[str, ...], points: tuple[str, ...], center_px: Array, cov_px2: Array | None = None
) -> PointSightings:
    """Sightings from columns of equal length M: camera rows, names of frames and points, pixels, covariances."""
    frame_names, point_names = tuple(dict.fromkeys(frames)), tuple(dict.fromkeys(points))
    frame_row = {name: row for row, name in enumerate(frame_names)}
    point_row = {name: row for row, name in enumerate(point_names)}
    key = np.array([frame_row[name] for name in frames], dtype=np.int64) * max(len(point_names), 1)
    key += np.array([point_row[name] for name in points], dtype=np.int64)
    kept, place = np.unique(key, return_inverse=True)
    frame, point = np.divmod(kept, max(len(point_names), 1))
    return PointSightings(frame_names, point_names, frame, point, camera, place, center_px, cov_px2)


def as_points(rig: Rig, observations: RigObservations) -> PointSightings:
    """What cameras saw of a target as sightings of unknown points, all of the target's points by their rows.

    Raises:
        InputError: a camera that is not in the rig, or photos of another size than its own.
    """
    camera, frame, point, center, cov = [], [], [], [], []
    for name, seen, frames in zip(observations.camera_names, observations.sightings, observations.frame, strict=True):
        row = rig.row(name)
        if seen.image_size != rig.cameras[row].image_size:
            raise InputError(
                f"camera {shown(name)}: photos of {seen.image_size[0]} x {seen.image_size[1]} px, but the rig's camera "
                f"has {rig.cameras[row].image_size[0]} x {rig.cameras[row].image_size[1]} px"
            )
        camera.append(np.full(len(seen.view), row))
        frame.append(frames[seen.view])
        point.append(seen.point)
        center.append(seen.center_px)
        cov.append(np.full((len(seen.view), 2, 2), np.nan) if seen.cov_px2 is None else seen.cov_px2)
    count = len(observations.points.position_mm)
    kept, place = np.unique(np.concatenate(frame) * count + np.concatenate(point), return_inverse=True)
    return PointSightings(
        observations.frame_names, tuple(map(str, range(count))), kept // count, kept % count, np.concatenate(camera),
        place, np.concatenate(center), np.concatenate(cov), observations.remarks,
    )  # fmt: skip


def with_noise(sightings: PointSightings, noise_px: Array) -> Array:
    """Covariances (M, 2, 2) of all sightings: as stated, or by each camera's noise (C,)."""
    usual: Array = noise_px[sightings.camera, None, None] ** 2 * np.eye(2)
    if sightings.cov_px2 is None:
        return usual
    states_it = np.asarray(np.isfinite(sightings.cov_px2).all(axis=(1, 2)))
    return np.where(states_it[:, None, None], sightings.cov_px2, usual)


def keep_places(sightings: PointSightings, keep: Flags) -> PointSightings:
    """The sightings of some of the points (N,), which are numbered anew."""
    rows = keep[sightings.place]
    return replace(
        sightings, frame=sightings.frame[keep], point=sightings.point[keep], camera=sightings.camera[rows],
        place=(np.cumsum(keep) - 1)[sightings.place[rows]], center_px=sightings.center_px[rows],
        cov_px2=None if sightings.cov_px2 is None else sightings.cov_px2[rows],
    )  # fmt: skip
