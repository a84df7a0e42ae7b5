"""Which rings of the real photos are found?

Run from the repository's root: `python -m tests.benchmarks.bench_real_photos [--photos FOLDER]`. The photos lie in
`../shared/real`; without them there is nothing to do, and that is said. Their rings carry no dots, so names are free
up to the board's symmetry; a name counts as false if its centre does not lie where a plane seen through a simple lens
(homography and two radial terms, fitted to the photo, for information only) puts it. The sheets are not flat: the fit
leaves more than the detector does.
"""

import argparse
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from calib.detector.pipeline import detect
from designer.kinds.board import BoardSpec
from designer.kinds.layout import lay_out
from designer.target import TargetGeometry
from tests.benchmarks.synthetic import Array, rms, row

FALSE_SHARE = 0.35
"""Of the distance to the next ring: farther off than this, a centre carries another ring's name."""


def plain_grid(columns: int, rows: int) -> TargetGeometry:
    """A grid of rings without dots; the pitch is not known and taken as 10 mm."""
    size = 10.0 * (columns + 1), 10.0 * (rows + 1)
    return lay_out(BoardSpec(size, 1.0, columns, rows, "square", 7.0, 0.45, 10.0, 0.0, 1.0, dots=False))


def lens_residual(place: Array, center: Array) -> Array:
    """Residuals of a homography and two radial terms about a free centre.  # (N, 2)"""
    scale = float(np.abs(center - center.mean(axis=0)).max())
    image = (center - center.mean(axis=0)) / scale
    plane = (place - place.mean(axis=0)) / np.abs(place - place.mean(axis=0)).max()
    start = np.asarray(cv2.findHomography(plane, image, cv2.LMEDS)[0], dtype=np.float64)

    def residual(p: Array) -> Array:
        view = np.append(p[:8], 1.0).reshape(3, 3)
        point = np.column_stack([plane, np.ones(len(plane))]) @ view.T
        ideal = point[:, :2] / point[:, 2:] - p[8:10]
        square = (ideal**2).sum(axis=1, keepdims=True)
        return np.asarray((ideal * (1 + p[10] * square + p[11] * square**2) + p[8:10] - image).ravel())

    first = np.concatenate([(start / start[2, 2]).ravel()[:8], np.zeros(4)])
    fit = least_squares(residual, first, loss="soft_l1", f_scale=2e-3, max_nfev=500)
    return residual(fit.x).reshape(-1, 2) * scale


def read(path: Path) -> NDArray[np.uint8]:
    """The photo in grey."""
    return np.asarray(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE), dtype=np.uint8)


def report(folder: Path, columns: int, rows: int, goal: str) -> None:
    """One line a photo and a sum."""
    target = plain_grid(columns, rows)
    complete, false, squares = 0, 0, []
    paths = sorted(folder.glob("*.png"))
    print(f"{folder.name}: {columns} x {rows} rings")
    for path in paths:
        found = detect(read(path), target, name=path.name)
        count, text, note = len(found.ring), "", "; ".join(found.remarks)
        if count >= 8:
            center = np.asarray(found.center_px)
            error = lens_residual(target.center_in_face_mm[found.ring, :2], center)
            gap = np.linalg.norm(center[:, None] - center[None], axis=2) + np.diag(np.full(count, np.inf))
            wrong = int((np.linalg.norm(error, axis=1) > FALSE_SHARE * gap.min(axis=1)).sum())
            false += wrong
            squares.append((error**2).sum(axis=1))
            reported = np.sqrt(np.trace(np.asarray(found.cov_px2), axis1=1, axis2=2).mean())
            text = f"false {wrong}; fit {np.sqrt(squares[-1].mean()):.3f} px 2-D, reported sigma {reported:.3f}; "
        complete += count == columns * rows
        rejected = 0 if found.rejected_px is None else len(found.rejected_px)
        row(f"  {path.name}", f"{columns * rows}", f"{count}", f"{text}unnamed {rejected}; {note}")
    fit = rms(np.sqrt(np.concatenate(squares))) if squares else float("nan")
    row(f"{folder.name}: photos complete", goal, f"{complete} of {len(paths)}", f"false {false}; fit {fit:.4f} px 2-D")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--photos", type=Path, default=Path(__file__).parents[3] / "shared" / "real")
    photos = parser.parse_args().photos
    if not photos.is_dir():
        print(f"skipped: there are no photos in {photos}")
        return
    report(photos / "rings-10x7", 10, 7, "10 of 10")
    report(photos / "rings-4x3-glare", 4, 3, ">= 10 of 11")


if __name__ == "__main__":
    main()
