"""Errors of chessboards' corners against the Cramer-Rao bound, and against OpenCV's in the same photos.

Run from the repository's root: `python -m tests.benchmarks.bench_corners [PHOTOS]`. Photos are sampled exactly (24 x 24
where an edge crosses a pixel), blurred by .7 px, with noise of a fiftieth of the contrast, in bytes. The bound is that
of all pixels of the four squares around a corner, up to two blurs from where the next edges begin, from photos of the
board moved a little, with the levels of both colours and their slopes unknown (directions and blur, even about the
corner, take nothing from it). Covariances are held against errors by `z`, the root mean square of errors in standard
deviations; the search begins from the finder, as in `calib detect`.
"""

import sys
import time

import cv2
import numpy as np

from calib.detector import pipeline
from calib.detector.boards import find_boards
from designer.base.arrays import Array
from designer.marks.chessboard import Chessboard
from designer.target import target_of_marks
from tests.support.board_photos import BoardPhoto, checkered, facing

SIZE = 480, 400
BOARD = Chessboard((8, 7), 20.0)
BLUR_PX, NOISE, BLACK, WHITE = 0.7, 3.2, 40.0, 200.0
MOVE_PX = 0.02


def bound_px2(photo: BoardPhoto, corner_px: Array, noise: float) -> Array:
    """Smallest covariances of the corners.  # (N, 2) -> (N, 2, 2)"""

    def even(move: tuple[float, float]) -> Array:
        shifted = np.array([[1, 0, move[0]], [0, 1, move[1]], [0, 0, 1.0]]) @ photo.px_from_mm
        return BLACK + (WHITE - BLACK) * BoardPhoto(photo.size, shifted).light(checkered(BOARD), BLUR_PX)

    middle = (even((0, 0)) - BLACK) / (WHITE - BLACK) - 0.5
    slope = [
        (even((MOVE_PX, 0)) - even((-MOVE_PX, 0))) / (2 * MOVE_PX),
        (even((0, MOVE_PX)) - even((0, -MOVE_PX))) / (2 * MOVE_PX),
    ]
    v, u = np.indices(middle.shape)
    plane = photo.plane_mm(np.stack([u, v], axis=-1).astype(np.float64)) / BOARD.square_mm
    found = []
    across_mm = [np.linalg.norm(np.gradient(plane[..., k], axis=(0, 1)), axis=0) for k in (0, 1)]
    for at_px, at in zip(corner_px, photo.plane_mm(corner_px) / BOARD.square_mm, strict=True):
        margin = 2 * BLUR_PX * np.array([each[round(at_px[1]), round(at_px[0])] for each in across_mm])
        near = (np.abs(plane - at) < 1 - margin).all(axis=-1)
        x, y, level = u[near] - at_px[0], v[near] - at_px[1], middle[near]
        ones = np.ones(len(x))
        nuisance = np.stack([ones, x, y, level, level * x, level * y], axis=1)
        by = np.stack([each[near] for each in slope], axis=1)
        by = by - nuisance @ np.linalg.lstsq(nuisance, by, rcond=None)[0]
        found.append(noise**2 * np.linalg.inv(by.T @ by))
    return np.array(found)


def subpix(pixels: np.ndarray, near_px: Array, step_px: float) -> Array:
    """OpenCV's refinement, its window half a square."""
    half = max(2, int(0.5 * step_px))
    end = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 60, 1e-4)
    start = np.ascontiguousarray(near_px[:, None], dtype=np.float32)
    return np.asarray(cv2.cornerSubPix(pixels, start, (half, half), (-1, -1), end)[:, 0], dtype=np.float64)


def main() -> None:
    """A row for each size of squares and tilt."""
    photos = int(sys.argv[1]) if len(sys.argv) > 1 else 8
    target = target_of_marks([BOARD], np.eye(4)[None])
    flags = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_ACCURACY
    print(
        "square px  tilt  corners      RMSE     bound  /bound       z  stated/RMSE   SB RMSE  cornerSubPix  us/corner"
    )
    whole = []
    for step_px in (14, 22, 32):
        for tilt in (0, 20, 40, 55, 65):
            errors, bounds, squares, stated, sb, sub = [], [], [], [], [], []
            spent = count = 0.0
            for seed in range(photos):
                rng = np.random.default_rng([step_px, tilt, seed])
                roll, axis, shift = rng.uniform(0, 90), rng.uniform(0, 180), rng.uniform(-0.5, 0.5, 2).tolist()
                photo = facing(
                    SIZE, step_px, BOARD.square_mm, tilt_deg=tilt, roll_deg=roll, axis_deg=axis, shift_px=tuple(shift)
                )
                pixels = photo.levels(checkered(BOARD), rng, blur_px=BLUR_PX, black=BLACK, white=WHITE, noise=NOISE)
                named = find_boards(pixels, target)
                begin = time.process_time()
                found = pipeline.detect(pixels, target, name="photo", found=named)
                spent += time.process_time() - begin
                true = photo.seen_at(found.position_mm[:, :2])
                error = found.center_px - true
                if not len(error):
                    print(f"{step_px} px, {tilt} deg, photo {seed}: {'; '.join(found.remarks)}")
                    continue
                errors.append(error)
                count += len(error)
                bounds.append(bound_px2(photo, true, float(np.hypot(NOISE, 12**-0.5))))
                squares.append(np.einsum("ni,nij,nj->n", error, np.linalg.inv(found.cov_px2), error))
                stated.append(found.cov_px2)
                sub.append(subpix(pixels, found.center_px, step_px) - true)
                seen, corner = cv2.findChessboardCornersSB(pixels, (7, 6), flags=flags)
                if seen:
                    every = photo.seen_at(target.center_mm[:, :2])
                    away = np.linalg.norm(corner.reshape(-1, 1, 2) - every, axis=2)
                    sb.append(corner.reshape(-1, 2) - every[away.argmin(axis=1)])
            error, square = np.concatenate(errors), np.concatenate(squares)
            rmse = float(np.sqrt((error**2).mean()))
            least = float(np.sqrt(np.trace(np.concatenate(bounds), axis1=1, axis2=2).mean() / 2))
            told = float(np.sqrt(np.trace(np.concatenate(stated), axis1=1, axis2=2).mean() / 2))
            peers = [float(np.sqrt((np.concatenate(one) ** 2).mean())) if one else np.nan for one in (sb, sub)]
            z = float(np.sqrt(square.mean() / 2))
            whole.append((rmse / least, z))
            ours = f"{len(error):9d}{rmse:10.5f}{least:10.5f}{rmse / least:8.3f}{z:8.3f}{told / rmse:13.3f}"
            theirs = f"{peers[0]:10.4f}{peers[1]:14.4f}{1e6 * spent / count:11.0f}"
            print(f"{step_px:9d}{tilt:6d}{ours}{theirs}", flush=True)
    print("RMSE/bound {:.3f} .. {:.3f}; z {:.3f} .. {:.3f}".format(
        *(limit(one) for one in zip(*whole, strict=True) for limit in (min, max))
    ))  # fmt: skip


if __name__ == "__main__":
    main()
