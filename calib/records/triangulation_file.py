"""triangulation.json: what is told of triangulated points, for their page, `--json` and other programs; points.csv."""

import csv
import io
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from calib.cameras.rig import MOST_CAMERAS, Rig
from calib.space.error_size import NOT_KNOWN, PointErrors, errors_of, rms_error_mm
from calib.space.known_lengths import LengthCheck
from calib.space.sightings import with_noise
from calib.space.triangulate import ONE_CAMERA, REASONS, Triangulation
from designer.base.answer import program
from designer.base.file_kind import FileKind
from designer.base.marks import AtLeast, AtMost, Count, FewLines, Gap, Length, Line, Shape, Word

Array = NDArray[np.float64]

TRIANGULATION_FILE, POINTS_FILE, RESIDUALS_FILE = "triangulation.json", "points.csv", "residuals.csv"
MOST_GROSS, MOST_DRAWN = 200, 400
FARTHEST_MM, FARTHEST_PX = 1e9, 1e9
MOST_ARROWS = 600
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

    name: Word
    sightings: Count
    seen_alone: Count  # points that no other camera saw: they have no position
    left_out: Count  # because they contradict the others
    noise_px: Gap  # root mean square of what the sightings state, or is taken where they state none
    rms_px: Gap  # of the residuals of what was used
    ray_rms_mm: Gap  # of the points' distances from its rays


@dataclass(frozen=True)
class GrossSighting:
    """A sighting that contradicts the others of its point."""

    camera: Word
    frame: Word
    point: Word
    residual_px: Gap  # against the point as the others have it


@dataclass(frozen=True, eq=False)
class CameraArrows:
    """Residuals of one camera, or evenly some of very many."""

    pixel: Annotated[Array, Shape("S", 2), Length(0, MOST_ARROWS), AtLeast(-FARTHEST_PX), AtMost(FARTHEST_PX)]
    residual_px: Annotated[Array, Shape("S", 2), AtLeast(-FARTHEST_PX), AtMost(FARTHEST_PX)]  # predicted - measured
    left_out: Annotated[Array, Shape("K", 2), Length(0, MOST_ARROWS), AtLeast(-FARTHEST_PX), AtMost(FARTHEST_PX)]


@dataclass(frozen=True, eq=False)
class TriangulationRecord:
    """Points that were triangulated. Null is not known."""

    program: Word
    settings: Annotated[Mapping[Word, Line], Length(0, 100)]
    rig: Rig  # without its covariance
    frames: Count
    points: Count
    placed: Count
    without: Annotated[Mapping[Line, Count], Length(0, len(REASONS))]  # reason, how many points
    cameras: Annotated[tuple[SeenByCamera, ...], Length(1, MOST_CAMERAS)]
    total: PointErrors
    by_noise: PointErrors
    by_calibration: PointErrors
    misclosure_px: Gap  # root mean square
    scale: Gap  # residuals over what is expected of them
    gross: Annotated[tuple[GrossSighting, ...], Length(0, MOST_GROSS)]  # the largest
    drawn_mm: Annotated[
        Array, Shape("D", 3), Length(0, MOST_DRAWN), AtLeast(-FARTHEST_MM), AtMost(FARTHEST_MM)
    ]  # some of the points
    drawn_mm2: Annotated[Array, Shape("D", 3, 3), AtLeast(-(FARTHEST_MM**2)), AtMost(FARTHEST_MM**2)]
    arrows: Annotated[tuple[CameraArrows, ...], Length(1, MOST_CAMERAS)]
    lengths: LengthCheck | None  # against the known distances of a check object
    remarks: FewLines


TRIANGULATION = FileKind(
    TriangulationRecord, "triangulation", "a triangulation.json", "triangulate again: calib triangulate"
)


def record_of(found: Triangulation, settings: Mapping[str, str], lengths: LengthCheck | None) -> TriangulationRecord:
    """What is told of points."""
    seen, placed = found.sightings, found.is_placed
    rows = np.flatnonzero(placed)
    drawn = rows[:: max(-(-len(rows) // MOST_DRAWN), 1)]
    misclosure = found.misclosure_px[placed]
    variance_px2 = 0.5 * np.trace(with_noise(seen, found.noise_px), axis1=1, axis2=2)
    known = found.calibration_mm2
    return TriangulationRecord(
        program=program(), settings=dict(settings), rig=replace(found.rig, covariance=None),
        frames=len(seen.frame_names), points=seen.count, placed=len(rows),
        without={REASONS[why]: int((found.reason == why).sum()) for why in np.unique(found.reason).tolist() if why},
        cameras=tuple(_camera(found, camera, variance_px2) for camera in range(len(found.rig.names))),
        total=errors_of(rms_error_mm(found.covariance_mm2)), by_noise=errors_of(rms_error_mm(found.noise_mm2)),
        by_calibration=NOT_KNOWN if known is None else errors_of(rms_error_mm(known)),
        misclosure_px=float(np.sqrt(np.mean(misclosure**2))) if len(rows) else np.nan, scale=found.scale,
        gross=_gross(found), drawn_mm=found.position_mm[drawn], drawn_mm2=found.covariance_mm2[drawn],
        arrows=tuple(_arrows(found, camera) for camera in range(len(found.rig.names))),
        lengths=lengths, remarks=(*seen.remarks, *_remarks(found)),
    )  # fmt: skip


def points_csv(found: Triangulation) -> bytes:
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


def residuals_csv(found: Triangulation) -> bytes:
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


def _camera(found: Triangulation, camera: int, variance_px2: Array) -> SeenByCamera:
    rows = found.sightings.camera == camera
    used = rows & found.is_used
    residual, off = found.residual_px[used], found.ray_error_mm[used]
    known = len(off) > 0
    alone = rows & (found.reason == ONE_CAMERA)[found.sightings.place]
    return SeenByCamera(
        found.rig.names[camera], int(rows.sum()), int(alone.sum()), int((rows & found.is_gross).sum()),
        float(np.sqrt(variance_px2[used].mean())) if known else float(found.noise_px[camera]),
        float(np.sqrt((residual**2).sum(axis=1).mean())) if known else np.nan,
        float(np.sqrt((off**2).mean())) if known else np.nan,
    )  # fmt: skip


def _arrows(found: Triangulation, camera: int) -> CameraArrows:
    rows = found.sightings.camera == camera
    used, gross = np.flatnonzero(rows & found.is_used), np.flatnonzero(rows & found.is_gross)
    used = used[:: max(-(-len(used) // MOST_ARROWS), 1)]
    pixel = found.sightings.center_px
    return CameraArrows(pixel[used], found.residual_px[used], pixel[gross[:MOST_ARROWS]])


def _gross(found: Triangulation) -> tuple[GrossSighting, ...]:
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


def _remarks(found: Triangulation) -> tuple[str, ...]:
    """What a person must know of the numbers."""
    said = []
    delay = found.rig.delay_s
    if delay is not None and delay.any():
        apart_ms = 1e3 * float(np.ptp(delay))
        said.append(f"the cameras' clocks differ by {apart_ms:.3g} ms: a point is off by as far as it moves meanwhile")
    if found.calibration_mm2 is None:
        said.append(
            "the rig's file tells no covariance: the sigmas are of noise alone, the rig's own errors come on top"
        )
    return tuple(said)
