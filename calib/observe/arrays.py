"""Points and pixels as arrays, as OpenCV takes them: `calib.observations(object_points, image_points, (1280, 720))`."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from calib.core.types import KnownPoints, Observations, RigObservations
from calib.observe.correspondences import MAX_LENGTH_MM, require_inside
from calib.observe.observations import prepare
from calib.observe.point_target import points_with_planes
from calib.observe.rig_observations import RigSightings, rig_observations
from designer.base.arrays import Array, Rows
from designer.base.errors import InputError
from designer.base.units import MM_PER_UNIT
from designer.base.words import shown

MAX_SIDE_PX = 1_000_000


def observations(
    object_points: Sequence[object],
    image_points: "Sequence[object] | Mapping[str, Sequence[object]]",
    image_size: "tuple[int, int] | Mapping[str, tuple[int, int]]",
    *,
    unit: str | None = None,
    sigma_px: "float | Sequence[object] | None" = None,
    names: Sequence[str] | None = None,
) -> Observations | RigObservations:
    """What `cv2.calibrateCamera` takes: `observations(object_points, image_points, gray.shape[::-1])`.

    Args:
        object_points: an array (N, 3) or (N, 1, 3) a photo.
        image_points: an array (N, 2) or (N, 1, 2) a photo, columns before rows; of several cameras that took photos at
            once a list each, by its name, with None where a camera saw nothing.
        image_size: width and height; of several cameras alike, or by name.
        unit: of the object points: "mm", "cm", "m", "in"; None: lengths are told as if it were mm.
        sigma_px: standard deviation of a coordinate, one for all or an array (N,) a photo; None: all alike, measured.
        names: of the photos; None: numbered.

    Raises:
        InputError: arrays that do not belong together; the message says where.
    """
    given = _listed(object_points, "object_points", 3)
    labels = tuple(names) if names is not None else tuple(f"photo {k}" for k in range(len(given)))
    if len(labels) != len(given) or len(set(labels)) < len(labels):
        raise InputError(f"names: {len(labels)} of {len(given)} photos; each photo has its own")
    if unit not in (None, *MM_PER_UNIT):
        raise InputError(f"unit {shown(unit)}: give one of {', '.join(one for one in MM_PER_UNIT if one)}")
    scale = 1.0 if unit is None else MM_PER_UNIT[unit]
    every = [scale * one for one in given if one is not None]
    if not every:
        raise InputError("object_points: there are none; give an array (N, 3) a photo")
    unique, point = np.unique(np.concatenate(every), axis=0, return_inverse=True)
    if (largest := float(np.abs(unique).max())) > MAX_LENGTH_MM:
        raise InputError(f"object_points: {largest:g} mm is beyond {MAX_LENGTH_MM:g} mm; check the unit")
    points, said = points_with_planes(unique, None)
    points = replace(points, circle_mm=np.full(len(unique), np.nan))
    rows = iter(np.split(point.reshape(-1), np.cumsum([len(one) for one in every])[:-1]))
    of_photo = [None if one is None else next(rows) for one in given]
    if not isinstance(image_points, Mapping):
        size = _size(image_size, "image_size")
        return _of_camera("", of_photo, image_points, size, sigma_px, labels, points, said)
    cameras = []
    for name, own in image_points.items():
        size = _size(image_size[name] if isinstance(image_size, Mapping) else image_size, f"image_size of {name}")
        seen = _of_camera(f"{name}: ", of_photo, own, size, sigma_px, labels, points, said)
        cameras.append(RigSightings(name, seen, dict(zip(labels, labels, strict=True))))
    return rig_observations(cameras, labels)


def _of_camera(
    of: str, of_photo: Sequence[Rows | None], image_points: Sequence[object], size: tuple[int, int], sigma_px: object,
    labels: tuple[str, ...], points: KnownPoints, said: tuple[str, ...],
) -> Observations:  # fmt: skip
    """What one camera saw; of a rig it may have seen nothing in some photos."""
    pixels = _listed(image_points, f"{of}image_points", 2, may_lack=bool(of))
    if len(pixels) != len(of_photo):
        raise InputError(f"{of}{len(of_photo)} object_points, {len(pixels)} image_points: as many photos of each")
    views, rows, centers, sigmas = list[int](), list[Rows](), list[Array](), list[Array]()
    for k, (known, seen) in enumerate(zip(of_photo, pixels, strict=True)):
        if seen is None or known is None:
            continue
        if len(known) != len(seen):
            raise InputError(f"{of}{labels[k]}: {len(known)} object points, {len(seen)} image points; one each")
        if len(np.unique(known)) < len(known):
            raise InputError(f"{of}{labels[k]}: the same object point twice; keep one")
        order = np.argsort(known)
        views += [k] * len(known)
        rows.append(known[order])
        centers.append(seen[order])
        if sigma_px is not None:
            sigmas.append(_sigma(sigma_px, k, len(known), f"{of}{labels[k]}")[order])
    if not rows:
        raise InputError(f"{of}image_points: there are none; give an array (N, 2) a photo")
    center = np.concatenate(centers)
    covariance = np.concatenate(sigmas)[:, None, None] ** 2 * np.eye(2) if sigmas else None
    every = Observations(size, labels, np.array(views), np.concatenate(rows), center, covariance, points, said)
    require_inside(every, f"{of}image_points")
    return prepare(every, has_fronts=False, origin=f"{of}image_points")


def _listed(given: object, what: str, columns: int, *, may_lack: bool = False) -> list[Array | None]:
    """An array (N, columns) a photo."""
    example = f"a list with an array (N, {columns}) a photo"
    if not isinstance(given, Sequence | np.ndarray) or isinstance(given, str | bytes):
        raise InputError(f"{what}: {type(given).__name__}: give {example}")
    if isinstance(given, np.ndarray) and given.ndim < 3:
        raise InputError(f"{what}: one array {given.shape}: give {example}")
    found = list[Array | None]()
    for k, one in enumerate(given):
        if one is None and may_lack:
            found.append(None)
            continue
        try:
            array = np.asarray(one, dtype=np.float64)
        except (TypeError, ValueError):
            raise InputError(f"{what}[{k}]: {type(one).__name__}: give an array (N, {columns}) of numbers") from None
        flat = array[:, 0] if array.ndim == 3 and array.shape[1] == 1 else array
        if flat.ndim != 2 or flat.shape[1] != columns:
            turned = "; it is turned, give its .T" if flat.ndim == 2 and flat.shape[0] == columns else ""
            raise InputError(f"{what}[{k}]: shape {array.shape}: must be (N, {columns}) or (N, 1, {columns}){turned}")
        if not np.isfinite(flat).all():
            raise InputError(f"{what}[{k}]: holds what is no finite number; leave these points out")
        found.append(flat)
    return found


def _size(given: object, what: str) -> tuple[int, int]:
    try:
        sides = [int(side) for side in given]  # type: ignore[attr-defined]
    except (TypeError, ValueError):
        sides = []
    if len(sides) != 2 or not all(1 <= side <= MAX_SIDE_PX for side in sides):
        shape = "; that is the shape of an image: give image.shape[1::-1]" if len(sides) == 3 else ""
        raise InputError(f"{what} {shown(given)}: must be (width, height) in px{shape}")
    return sides[0], sides[1]


def _sigma(given: object, photo: int, count: int, of: str) -> Array:
    """Standard deviations of a photo's N points."""
    try:
        own = np.asarray(given if np.ndim(given) == 0 else given[photo], dtype=np.float64)  # type: ignore[arg-type, index]
        sigma = np.broadcast_to(own.reshape(-1), (count,))
    except (TypeError, ValueError, IndexError):
        sigma = np.zeros(1)
    if not ((sigma > 0) & np.isfinite(sigma)).all():
        raise InputError(f"{of}: sigma_px must be more than 0 px, one for all, or an array (N,) a photo")
    return sigma
