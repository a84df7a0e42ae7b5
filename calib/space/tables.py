"""What is told of triangulated points: `points.csv`, `residuals.csv`, and what each camera had its part in."""

import csv
import io
import math
from dataclasses import dataclass

import numpy as np

from calib.core.linear_algebra import rms_length
from calib.space.propagate import rms_error_mm, with_noise
from calib.space.triangulate import ONE_CAMERA, REASONS, TriangulatedPoints
from designer.base.arrays import Array
from designer.base.marks import Gap

MOST_GROSS = 200
_AXES = ("XX", "XY", "XZ", "YY", "YZ", "ZZ")
COLUMNS = (
    "frame", "point", "X", "Y", "Z", "sigma_mm", *(f"{part}_{axes}" for part in ("c", "noise", "calibration")
    for axes in _AXES), "cameras", "misclosure_px", "left_out", "reason",
)  # fmt: skip
EXPLAINED = (
    "# ringsolid points, version 1",
    "# X Y Z: in the rig's frame, mm; sigma_mm: root mean square of the error's length in space",
    "# c_: covariance in mm^2; noise_: its part by the pixels; calibration_: by the rig's errors, which all points "
    "share; empty: not known",
    "# misclosure_px: of two cameras the epipolar error; left_out: cameras that contradict the others",
)
RESIDUAL_COLUMNS = ("camera", "frame", "point", "u", "v", "du", "dv", "ray_mm", "used")
RESIDUALS_EXPLAINED = (
    "# ringsolid residuals, version 1",
    "# du dv: predicted - measured, px; ray_mm: from the point to the sighting's ray; used: 0 if it was left out",
)


@dataclass(frozen=True)
class SeenByCamera:
    """What one camera of a rig saw of the points."""

    name: str
    sightings: int
    seen_alone: int  # points that no other camera saw: they have no position
    left_out: int  # because they contradict the others
    noise_px: Gap  # root mean square of what the sightings state, or is taken where they state none
    rms_px: Gap  # of the residuals of what was used
    ray_rms_mm: Gap  # of the points' distances from its rays


@dataclass(frozen=True)
class GrossSighting:
    """A sighting that contradicts the others of its point."""

    camera: str
    frame: str
    point: str
    residual_px: Gap  # against the point as the others have it


def points_csv(found: TriangulatedPoints) -> bytes:
    """The points as a table, a line each; what is not known is empty."""
    stream = io.StringIO(newline="")
    stream.writelines(f"{line}\n" for line in EXPLAINED)
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(COLUMNS)
    seen, upper = found.sightings, np.triu_indices(3)
    unknown = np.full((seen.count, 3, 3), np.nan)
    parts = (found.covariance_mm2, found.noise_mm2, unknown if found.calibration_mm2 is None else found.calibration_mm2)
    numbers = np.column_stack(
        [found.position_mm, rms_error_mm(found.covariance_mm2), *(part[:, upper[0], upper[1]] for part in parts)]
    )
    left_out: dict[int, list[str]] = {}
    for row in np.flatnonzero(found.is_gross).tolist():
        left_out.setdefault(int(seen.place[row]), []).append(found.rig.names[seen.camera[row]])
    misclosure = found.misclosure_px.tolist()
    for place, values in enumerate(numbers.tolist()):
        writer.writerow([
            seen.frame_names[seen.frame[place]], seen.point_names[seen.point[place]], *map(_text, values),
            int(found.cameras_used[place]), _text(misclosure[place]), " ".join(left_out.get(place, ())),
            REASONS[found.reason[place]],
        ])  # fmt: skip
    return stream.getvalue().encode("utf-8", "surrogatepass")


def residuals_csv(found: TriangulatedPoints) -> bytes:
    """The residuals as a table, a line a sighting; empty of points without a position."""
    stream = io.StringIO(newline="")
    stream.writelines(f"{line}\n" for line in RESIDUALS_EXPLAINED)
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(RESIDUAL_COLUMNS)
    seen = found.sightings
    numbers = np.column_stack([seen.center_px, found.residual_px, found.ray_error_mm]).tolist()
    for row, values in enumerate(numbers):
        place = seen.place[row]
        names = seen.frame_names[seen.frame[place]], seen.point_names[seen.point[place]]
        writer.writerow([found.rig.names[seen.camera[row]], *names, *map(_text, values), int(found.is_used[row])])
    return stream.getvalue().encode("utf-8", "surrogatepass")


def _text(value: float) -> str:
    return "" if math.isnan(value) else repr(value)


def seen_by_cameras(found: TriangulatedPoints) -> tuple[SeenByCamera, ...]:
    """What each camera of the rig saw."""
    variance_px2 = 0.5 * np.trace(with_noise(found.sightings, found.noise_px), axis1=1, axis2=2)
    return tuple(_seen_by(found, camera, variance_px2) for camera in range(len(found.rig.names)))


def _seen_by(found: TriangulatedPoints, camera: int, variance_px2: Array) -> SeenByCamera:
    rows = found.sightings.camera == camera
    used = rows & found.is_used
    residual, off = found.residual_px[used], found.ray_error_mm[used]
    known = len(off) > 0
    alone = rows & (found.reason == ONE_CAMERA)[found.sightings.place]
    return SeenByCamera(
        found.rig.names[camera], int(rows.sum()), int(alone.sum()), int((rows & found.is_gross).sum()),
        float(np.sqrt(variance_px2[used].mean())) if known else float(found.noise_px[camera]),
        rms_length(residual),
        float(np.sqrt((off**2).mean())) if known else np.nan,
    )  # fmt: skip


def gross_sightings(found: TriangulatedPoints) -> tuple[GrossSighting, ...]:
    """The sightings that were left out, the largest residuals first."""
    seen, length = found.sightings, np.hypot(*found.residual_px.T)
    rows = np.flatnonzero(found.is_gross)
    rows = rows[np.argsort(-length[rows], kind="stable")][:MOST_GROSS]
    return tuple(
        GrossSighting(
            found.rig.names[seen.camera[row]], seen.frame_names[seen.frame[seen.place[row]]],
            seen.point_names[seen.point[seen.place[row]]], float(length[row]),
        )
        for row in rows.tolist()
    )  # fmt: skip
