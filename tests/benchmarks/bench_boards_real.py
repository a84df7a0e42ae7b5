"""Corners of real photos of others' chessboards: how many photos, and how far corners lie off in photos held out.

Run from the repository's root: `python -m tests.benchmarks.bench_boards_real [FOLDER]`; needs the photos beside the
project, in `../shared/real`. Each finder's corners go through the same solver: a camera from every second photo, of the
others the poses alone; and likewise with the board's bend free, as paper on a clipboard is not flat. `ours` is measured
by the model of two edges, in two passes as `calib run` does; `SB` and `classic` are OpenCV's, the latter with
`cornerSubPix`.
"""

import sys
import time
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.core.types import Detections, keep_views
from calib.detector import boards, pipeline
from calib.detector.marks import chessboard
from calib.observe.observations import observations_from_detections
from calib.solver.metrics.errors import summarise
from calib.solver.metrics.evaluation import evaluate_on
from calib.solver.problem import SolveOptions
from calib.solver.solve import solve
from designer.base.errors import InputError
from designer.marks.chessboard import Chessboard
from designer.target import TargetGeometry, target_of_marks

FOLDER = Path(__file__).parents[2].parent / "shared" / "real"
SETS = {"fisheye-chess": ((5, 7), "fisheye"), "chess-sony": ((5, 7), "opencv")}
Pixels = NDArray[np.uint8]


def peer(pixels: Pixels, target: TargetGeometry, name: str, finder: str) -> Detections:
    """OpenCV's corners, named as ours are, all with the same covariance."""
    assert target.marks is not None
    (marks,) = target.marks
    assert isinstance(marks, Chessboard)
    size = marks.squares[0] - 1, marks.squares[1] - 1
    if finder == "SB":
        flags = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_ACCURACY
        is_found, corner = cv2.findChessboardCornersSB(pixels, size, flags=flags)
        if not is_found:
            is_found, corner = cv2.findChessboardCornersSB(pixels, size, flags=cv2.CALIB_CB_NORMALIZE_IMAGE)
    else:
        is_found, corner = cv2.findChessboardCorners(pixels, size)
        if is_found:
            end = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 40, 1e-3)
            step = np.linalg.norm(np.diff(corner.reshape(size[1], size[0], 2), axis=1), axis=2).min()
            half = int(np.clip(0.4 * step, 2, 11))
            corner = cv2.cornerSubPix(pixels, corner, (half, half), (-1, -1), end)
    if not is_found:
        return boards.detect_boards(pixels, target, name=name, found=boards.FoundBoards(()))
    one = chessboard.named(pixels, corner.reshape(size[1], size[0], 2).astype(np.float64), marks, 0)
    count = len(one.row)
    blank = boards.detect_boards(pixels, target, name=name, found=boards.FoundBoards(()))
    return replace(
        blank, ring=one.row, position_mm=target.center_mm[one.row], center_px=one.near_px,
        cov_px2=np.tile(0.01 * np.eye(2), (count, 1, 1)), ellipse_px=np.zeros((count, 5)), ratio=None, blur_px=None,
    )  # fmt: skip


def ours(photos: dict[str, Pixels], target: TargetGeometry, model: str) -> list[Detections]:
    """As `calib run` finds them."""
    first = {name: pipeline.find(pixels, target) for name, pixels in photos.items()}
    seen = [pipeline.detect(pixels, target, name=name, found=first[name]) for name, pixels in photos.items()]
    camera = solve(observations_from_detections(seen, target, origin="photos"), model).camera
    return [
        pipeline.detect(pixels, target, name=name, camera=camera, found=first[name])
        for name, pixels in photos.items()
    ]  # fmt: skip


def held_out(seen: list[Detections], target: TargetGeometry, model: str, *, free_bend: bool) -> str:
    """RMS and median in photos that the camera was not solved from, both ways around."""
    both = observations_from_detections([one for one in seen if len(one.ring)], target, origin="photos")
    is_first = np.arange(both.view_count) % 2 == 0
    size = []
    for mine in (is_first, ~is_first):
        try:
            solved = solve(keep_views(both, mine), model, SolveOptions(free_bend=free_bend))
            found = evaluate_on(solved, keep_views(both, ~mine), "test").of("reprojection")
        except InputError as error:
            return str(error)[:40]
        assert found is not None
        size.append(found)
    told = [summarise(one) for one in size]
    return " ".join(f"{one.rmse:.4f} ({one.median:.4f})" for one in told)


def main() -> None:
    """A row for each set and finder."""
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER
    if not folder.is_dir():
        print(f"{folder}: absent; nothing to do")
        return
    for name, (squares, model) in SETS.items():
        target = target_of_marks([Chessboard(squares, 30.0)], np.eye(4)[None])
        paths = sorted((folder / name).glob("*.jpg"), key=lambda path: int("".join(filter(str.isdigit, path.stem))))
        photos = {path.name: cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) for path in paths}
        print(f"{name}: {len(photos)} photos; held-out RMS (median) in px, two halves each; then with the bend free")
        for finder in ("ours", "SB", "classic"):
            begin = time.process_time()
            if finder == "ours":
                seen = ours(photos, target, model)
            else:
                seen = [peer(pixels, target, one, finder) for one, pixels in photos.items()]
            seconds = time.process_time() - begin
            count = sum(len(one.ring) > 0 for one in seen)
            corners = sum(len(one.ring) for one in seen)
            errors = [held_out(seen, target, model, free_bend=bend) for bend in (False, True)]
            print(
                f"  {finder:8}{count:3d} photos {corners:4d} corners {seconds:6.1f} s   {errors[0]}   {errors[1]}",
                flush=True,
            )


if __name__ == "__main__":
    sys.exit(main())
