"""Four webcams of others and a hand-held chessboard: fitted on every second frame, the others' points triangulated.

Run from the repository's root: `python -m tests.benchmarks.bench_rig_real`; needs the measurements beside the project,
in `../shared/real/rig-4-cameras` (57 frames, one flat board of 12 corners, metres). Told are the distances between all
pairs of corners of a frame against those of the board, root mean square in mm, and the scale.

Published for the frames in second, fourth, ... place (their linear triangulation): the authors' program, fitted on all
frames, 1.217 mm; a plain rigid-board adjustment of the other frames .991 mm. The corners have no covariances: each
camera's noise is what it leaves over, and so are the weights of its rays.

The webcams are not synchronous, and most frames have no time stamp; there the frame's number, times the usual step,
stands for it. With time offsets, corners of a late camera are moved to the frame's moment along their way in its image,
from the frame before to that after, of whichever half these are; nothing but pixels is taken of them.
"""

import csv
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path

import numpy as np

import calib
from calib.cameras.rig import Rig
from calib.core.types import KnownPoints, Observations, RigObservations, without_empty_views
from calib.observe.observations import prepare
from calib.observe.rig_observations import RigSightings, rig_observations
from calib.space.propagate import of_rows
from calib.space.triangulate import triangulate_points
from designer.base.arrays import Array, Flags, Rows

FOLDER = Path(__file__).parents[2].parent / "shared" / "real" / "rig-4-cameras"
SIZE = (1280, 720)
STEP_S = 0.166
"""Between two frames, the median of those that have time stamps."""
MM = 1e3


@dataclass(frozen=True, eq=False)
class Corners:
    """All corners of all frames; M of them."""

    frame: Rows  # (M,)
    camera: Rows  # (M,)
    corner: Rows  # (M,)
    pixel: Array  # (M, 2)
    board_mm: Array  # (K, 3)

    def of(self, keep: Flags) -> "Corners":
        """Some of them."""
        return replace(
            self, frame=self.frame[keep], camera=self.camera[keep], corner=self.corner[keep], pixel=self.pixel[keep]
        )


def read_corners(path: Path) -> Corners:
    """The table of the authors."""
    with path.open(encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    frame, camera, corner = (
        np.array([int(row[name]) for row in rows]) for name in ("sync_index", "cam_id", "keypoint_id")
    )
    pixel = np.array([[float(row["img_loc_x"]), float(row["img_loc_y"])] for row in rows])
    board_mm = np.zeros((int(corner.max()) + 1, 3))
    board_mm[corner] = [[MM * float(row[f"obj_loc_{axis}"]) for axis in "xyz"] for row in rows]
    return Corners(frame, camera, corner, pixel, board_mm)


def observed(seen: Corners) -> RigObservations:
    """What a rig is solved from, with the frames' numbers for time stamps."""
    number = np.unique(seen.frame)
    points = KnownPoints(seen.board_mm, np.zeros(len(seen.board_mm), dtype=np.int64), np.array([[0.0, 0.0, 1.0, 0.0]]))
    names = tuple(f"{one:04d}" for one in number.tolist())
    cameras = []
    for camera in np.unique(seen.camera).tolist():
        own = seen.of(seen.camera == camera)
        view = np.searchsorted(number, own.frame)
        order = np.lexsort((own.corner, view))
        every = without_empty_views(
            Observations(SIZE, names, view[order], own.corner[order], own.pixel[order], None, points)
        )
        kept = prepare(every, has_fronts=False, origin=f"cam{camera}")
        stamps = {name: STEP_S * int(name) for name in kept.view_names}
        cameras.append(RigSightings(f"cam{camera}", kept, {name: name for name in kept.view_names}, stamps))
    return rig_observations(cameras, names)


def in_time(seen: Corners, rig: Rig) -> Corners:
    """The corners where they were at the frames' moments, by their ways in the images and the cameras' delays."""
    assert rig.delay_s is not None
    place = {
        (frame, camera, corner): pixel
        for frame, camera, corner, pixel in zip(
            seen.frame.tolist(), seen.camera.tolist(), seen.corner.tolist(), seen.pixel, strict=True
        )
    }
    pixel = seen.pixel.copy()
    for row, (frame, camera, corner) in enumerate(place):
        near = [(step, place.get((frame + step, camera, corner))) for step in (-1, 0, 1)]
        known = [(step, one) for step, one in near if one is not None]
        (first, before), (last, after) = known[0], known[-1]
        if last > first:
            delay_s = float(rig.delay_s[rig.row(f"cam{camera}")])
            pixel[row] += delay_s * (after - before) / (STEP_S * (last - first))
    return replace(seen, pixel=pixel)


def length_errors(rig: Rig, seen: Corners) -> tuple[float, float]:
    """Root mean square error (mm) of the distances between all pairs of corners of a frame, and the scale's error."""
    key = seen.frame * 100 + seen.corner
    _, place, count = np.unique(key, return_inverse=True, return_counts=True)
    seen = seen.of(count[place] > 1)
    camera = np.array([rig.row(f"cam{one}") for one in seen.camera.tolist()])
    sightings = of_rows(camera, tuple(map(str, seen.frame.tolist())), tuple(map(str, seen.corner.tolist())), seen.pixel)
    points = triangulate_points(rig, sightings, rejects=False).position_mm  # of all, gross errors too
    corner = np.array([int(name) for name in sightings.point_names])[sightings.point]
    errors, lengths = [], []
    for frame in range(len(sightings.frame_names)):
        for a, b in combinations(np.flatnonzero(sightings.frame == frame).tolist(), 2):
            lengths.append(float(np.linalg.norm(seen.board_mm[corner[a]] - seen.board_mm[corner[b]])))
            errors.append(float(np.linalg.norm(points[a] - points[b])) - lengths[-1])
    error, length = np.array(errors), np.array(lengths)
    return float(np.sqrt((error**2).mean())), float(error @ length / (length @ length))


def shuffled(seen: RigObservations, rng: np.random.Generator) -> RigObservations:
    """The same with cameras and frames in another order."""
    frames = [seen.frame_names[row] for row in rng.permutation(seen.frame_count).tolist()]
    cameras = [
        RigSightings(seen.camera_names[row], seen.sightings[row], {name: name for name in seen.frame_names})
        for row in rng.permutation(seen.camera_count).tolist()
    ]
    return rig_observations(cameras, frames)


def told(name: str, rig: Rig, seen: Corners, seconds: float) -> None:
    """A line."""
    rms_mm, scale = length_errors(rig, seen)
    noise = " ".join(f"{one:.2f}" for one in np.asarray(rig.noise_px))
    late = "" if rig.delay_s is None else "   late ms " + " ".join(f"{MM * one:.0f}" for one in rig.delay_s)
    print(f"{name:36}{rms_mm:.3f} mm   scale {100 * scale:+.2f} %   noise px {noise}   {seconds:.1f} s{late}")


def main(orders: Sequence[int] = (1, 2, 3)) -> None:
    """Both halves, from any order, with the clocks as they are and with their offsets estimated."""
    corners = read_corners(FOLDER / "xy.csv")
    is_first = np.isin(corners.frame, np.unique(corners.frame)[::2])
    for name, fitted in (("first half, tested on the second", is_first), ("second, tested on the first", ~is_first)):
        train, test = observed(corners.of(fitted)), corners.of(~fitted)
        calib.rig(replace(train, time_s=None), model="opencv")  # so that nothing is compiled in the time
        begin = time.perf_counter()
        found = calib.rig(replace(train, time_s=None), model="opencv")
        told(name, found.rig, test, time.perf_counter() - begin)
        centers = found.rig.center_mm
        apart_mm = 0.0
        for seed in orders:
            mixed = shuffled(replace(train, time_s=None), np.random.default_rng(seed))
            again = calib.rig(mixed, model="opencv", reference=found.rig.names[0]).rig
            rows = [again.row(one) for one in found.rig.names]
            apart_mm = max(apart_mm, float(np.abs(again.center_mm[rows] - centers).max()))
        print(f"  in {len(orders)} other orders the cameras stand within {apart_mm:.1e} mm of there")
        begin = time.perf_counter()
        late = calib.rig(train, model="opencv", delays=True).rig
        seconds = time.perf_counter() - begin
        told("  with time offsets, and moved by them", late, in_time(corners, late).of(~fitted), seconds)


if __name__ == "__main__":
    main()
