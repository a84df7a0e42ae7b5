"""Real photos of a sheet of 10 x 7 rings: what is left over, and whether two sets agree on the camera.

`python -m tests.benchmarks.bench_real_calibration`; needs the photos beside the project, in `../shared/real`.

Both sets were taken by one camera, so their solutions should differ by no more than their standard deviations say. The
sheet on its wall is not flat: its shape is in every residual, the same in all photos, which covariances of independent
errors do not know of. OpenCV on the same centres is the peer.
"""

import sys
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from calib.app.detect import Detector
from calib.cameras import parameter_names
from calib.cameras.camera import Camera
from calib.core.types import Observations, keep_views
from calib.observe.observations import observations_from_detections
from calib.observe.photos import PhotoFile, named_photos, searched_photos
from calib.solver.calibration import Calibration
from calib.solver.metrics.evaluation import evaluate
from calib.solver.solve import solve
from designer.base.arrays import Array
from tests.benchmarks.bench_real_photos import plain_grid

FOLDER = Path(__file__).parents[2].parent / "shared" / "real" / "rings-10x7"
PASSES = 2


def observe(camera: Camera | None) -> Observations:
    """The rings of all photos."""
    target = plain_grid(10, 7)
    photos = named_photos(map(PhotoFile, sorted(FOLDER.glob("*.png"))))
    look = Detector(target, camera).look
    results = searched_photos(photos, target, look, jobs=2)
    return observations_from_detections([one.seen for one in results if one.seen], target)


def rms_px(residual_px: Array) -> float:
    """Root mean square length."""
    return float(np.sqrt((residual_px**2).sum(axis=1).mean()))


def peer_rms_px(seen: Observations) -> float:
    """OpenCV's, of the same centres."""
    points, pixels = [], []
    for view in range(seen.view_count):
        rows = seen.view == view
        points.append(seen.points.position_mm[seen.point[rows]].astype(np.float32))
        pixels.append(seen.center_px[rows].astype(np.float32))
    return float(cv2.calibrateCamera(points, pixels, seen.image_size, None, None)[0])


def compare(first: Calibration, second: Calibration) -> None:
    """Differences in parameters, in standard deviations of the difference."""
    variance = np.diagonal(first.param_covariance) + np.diagonal(second.param_covariance)
    difference = first.camera.params - second.camera.params
    terms = zip(parameter_names(first.camera.model), difference, difference / np.sqrt(variance), strict=True)
    print("  " + ", ".join(f"{name} {value:+.4g} ({sigmas:+.1f} sigma)" for name, value, sigmas in terms))


def shaped(seen: Observations, rounds: int = 30) -> Observations:
    """The observations with each ring moved to where its rays meet, and the camera solved again, by turns."""
    for _ in range(rounds):
        errors = evaluate(solve(seen, "opencv")).of("reconstruction")
        if errors is None or errors.point is None:
            raise AssertionError("every ring is seen in every photo")
        position = np.array(seen.points.position_mm)
        position[errors.point] += errors.vector
        seen = replace(seen, points=replace(seen.points, position_mm=position))
    return seen


def main() -> None:
    """Passes, then sets apart."""
    if not FOLDER.is_dir():
        sys.exit(f"{FOLDER}: no real photos here")
    camera: Camera | None = None
    for number in range(1, PASSES + 1):
        seen = observe(camera)
        solved = {model: solve(seen, model) for model in ("opencv", "luhmann")}
        figures = ", ".join(f"{model} {rms_px(one.residual_px):.4f} px" for model, one in solved.items())
        print(
            f"pass {number}: {len(seen.view)} rings, 2-D RMS {figures}; cv2.calibrateCamera {peer_rms_px(seen):.4f} px"
        )
        camera = solved["opencv"].camera
    is_first = np.array([name.startswith("set1") for name in seen.view_names])
    for model in solved:
        first, second = solve(keep_views(seen, is_first), model), solve(keep_views(seen, ~is_first), model)
        print(f"{model}: set 1 {rms_px(first.residual_px):.4f} px, set 2 {rms_px(second.residual_px):.4f} px")
        compare(first, second)
    curved = shaped(seen)
    moved = curved.points.position_mm - seen.points.position_mm
    left = rms_px(solve(curved, "opencv").residual_px)
    print(
        f"with the sheet's shape (up to {np.abs(moved[:, 2]).max():.3f} of a pitch of 10 off the plane): {left:.4f} px"
    )
    compare(*(solve(keep_views(curved, part), "opencv") for part in (is_first, ~is_first)))


if __name__ == "__main__":
    main()
