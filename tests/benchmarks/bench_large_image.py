"""How long does a 100-megapixel photo take, against the barest OpenCV pass over the same image?

Run from the repository's root: `python -m tests.benchmarks.bench_large_image [--quick]`. A board of 52 x 39 features
fills 11608 x 8708 px, slightly tilted (paper 200, ink 40 of 255), once almost without noise and once with a noise of
30 grey levels. Reading the file is not counted. The peer is `cv2.threshold(OTSU)` + `cv2.findContours(RETR_TREE)`,
which finds contours and no names, in the same run. Best of three each, in turns.
"""

import argparse
import math
import time

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.detector.pipeline import detect
from designer.kinds.board import BoardSpec
from designer.kinds.layout import lay_out
from designer.target import TargetGeometry
from tests.benchmarks.synthetic import (
    DARK,
    LIGHT,
    Array,
    apply_homography,
    best_of,
    eight_bit,
    picture_of_plane,
    plane_view,
    rms,
    row,
    wrong_names,
)

SIZE = (11608, 8708)
FOCAL_PX, TILT_RAD, BLUR_PX = 19_149.0, math.radians(15), 1.0  # 72 mm at 3.76 um
PAPER, INK = np.float32(200 / 255), np.float32(40 / 255)
SPEC = BoardSpec((530.0, 400.0), 3.0, 52, 39, "square", 7.0, 0.45, 10.0, 0.0, 1.5, dots=True)


def picture(target: TargetGeometry, scale: float) -> tuple[NDArray[np.float32], Array]:
    """The noise-free photo and the true centres; `scale` shrinks the image for short runs."""
    size = round(SIZE[0] * scale), round(SIZE[1] * scale)
    middle = (np.array(size) - 1) / 2
    distance_mm = 1.07 * SPEC.size_mm[0] * FOCAL_PX / SIZE[0]
    view = plane_view(FOCAL_PX * scale, TILT_RAD, 0.6, distance_mm, middle) @ np.diag([1.0, -1.0, 1.0])
    plane = target.center_in_face_mm[:, :2]
    image = picture_of_plane(size, view, plane, target.radius_outer_mm, target.radius_inner_mm, BLUR_PX, fine=2)
    image = PAPER + (image - LIGHT) * np.float32((PAPER - INK) / (LIGHT - DARK))
    return image, apply_homography(view, plane)


def bare_pass(image: NDArray[np.uint8]) -> int:
    """Binarise and follow the contours; how many there are."""
    _, binary = cv2.threshold(image, 0, 255, cv2.THRESH_BINARY | cv2.THRESH_OTSU)
    contours, _ = cv2.findContours(binary, cv2.RETR_TREE, cv2.CHAIN_APPROX_NONE)
    return len(contours)


def report(image: NDArray[np.uint8], target: TargetGeometry, truth: Array, times: int) -> tuple[float, float]:
    """Times of detector and peer, and the detector's errors."""
    ours = peer = math.inf
    for _ in range(times):
        peer = min(peer, best_of(1, lambda: bare_pass(image)))
        ours = min(ours, best_of(1, lambda: detect(image, target, name="large")))
    found = detect(image, target, name="large")
    error = np.asarray(found.center_px) - truth[found.ring]
    wrong = int(wrong_names(found, target, truth, np.ones(len(truth), dtype=bool)).sum())
    row("  contours of the bare pass", "", f"{bare_pass(image)}", f"{peer:.2f} s")
    row("  features found", "100 %", f"{len(error)}/{len(truth)}", f"wrong {wrong}; {'; '.join(found.remarks)}")
    sigma = math.sqrt(float(np.trace(np.asarray(found.cov_px2), axis1=1, axis2=2).mean()))
    row("  centre RMSE, 2-D px", "", f"{rms(error) * math.sqrt(2):.4f}", f"reported {sigma:.4f}")
    return ours, peer


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="a quarter of the width and height, once")
    quick = parser.parse_args().quick
    rng = np.random.default_rng(1)
    target = lay_out(SPEC)
    began = time.perf_counter()
    clean, truth = picture(target, 0.25 if quick else 1.0)
    print(
        f"{clean.shape[1]} x {clean.shape[0]} px, {len(truth)} features; drawn in {time.perf_counter() - began:.0f} s"
    )
    warm, _ = picture(target, 0.15)
    detect(eight_bit(warm, 1.0, rng), target, name="warm")  # compile
    for name, noise in (("almost no noise (1 grey level)", 1.0), ("noise of 30 grey levels", 30.0)):
        image = eight_bit(clean, noise, rng)
        print(name)
        ours, peer = report(image, target, truth, 1 if quick else 3)
        goal = "<= 3 x bare" if noise < 2 else "<= 1 s"
        row("  detect(), best of three", goal, f"{ours:.2f} s", f"{ours / peer:.2f} x bare Otsu + findContours")


if __name__ == "__main__":
    main()
