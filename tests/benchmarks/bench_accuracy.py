"""The paper's synthetic study beside ours: 120 photos of its board and icosahedron, detected and solved.

`python -m tests.benchmarks.bench_accuracy [FOLDER]`; rendered photos stay in FOLDER and are used again.

The paper (Table 2, 120 images) states the means of 10,000 bootstrap samples; ours are one solution of all photos.
`binary` renders as the paper does, one ray a pixel, black or white; `area` is what a good camera delivers:
anti-aliased, a blur of 0.7 px, noise of a hundredth of the contrast.
"""

import os
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calib.camera_file import camera_or_preset
from calib.detect.batch import detect_photos, named_photos
from calib.detect.pipeline import detect
from calib.inputs.observations import dataset_of, observations_from_detections
from calib.metrics.errors import summarise
from calib.metrics.evaluation import evaluate
from calib.render.job import RenderJob, run_job
from calib.render.options import RenderOptions
from calib.render.poses import PoseGrid, grid_poses
from calib.results.truth import Truth, read_truth, true_poses
from calib.solver.options import SolveOptions
from calib.solver.solve import keep_views, solve
from calib.types import Camera, Observations
from designer.layout import lay_out
from designer.spec import BoardSpec, IcoSpec
from designer.target import TargetGeometry

VIEWS, DISTANCE_MM = 120, 400.0
METRICS = ("reprojection", "intersection", "reconstruction", "pose")
PAPER = {"board": (0.125, 0.0432, 0.0040, 0.058), "icosahedron": (0.135, 0.0257, 0.0110, 0.078)}
GOAL = (0.005, 0.0015, float("nan"), 0.005)


@dataclass(frozen=True)
class Photos:
    """How a set is rendered."""

    name: str
    options: RenderOptions


SETS = (
    Photos("area", RenderOptions(blur_px=0.7, contrast_to_noise=100)),
    Photos("binary", RenderOptions(sampling="binary")),
)


def targets() -> dict[str, TargetGeometry]:
    """The paper's: a 220 mm board and an icosahedron of 100 mm edge, rings of 7 mm every 10 mm."""
    board = BoardSpec(
        size_mm=(220, 220), thickness_mm=5, columns=21, rows=21, lattice="square", ring_diameter_mm=7,
        ring_ratio=0.45, pitch_mm=10, border_mm=0, margin_mm=1, dots=True,
    )  # fmt: skip
    ico = IcoSpec(
        edge_mm=100, rings_per_side=8, ring_diameter_mm=7, ring_ratio=0.45, pitch_mm=10, border_mm=2, margin_mm=1
    )
    return {"board": lay_out(board), "icosahedron": lay_out(ico)}


def photograph(target: TargetGeometry, photos: Photos, folder: Path) -> None:
    """Render the set, unless it is there."""
    grid = PoseGrid(VIEWS, np.pi / 2, (DISTANCE_MM, DISTANCE_MM), random_roll=False, aim_offset_mm=0.0)
    poses = grid_poses(grid, np.random.default_rng(1))
    job = RenderJob(target, camera_or_preset("machine-vision"), poses, photos.options, seed=1)
    run_job(job, folder, processes=os.cpu_count() or 1, overwrite=False, on_view=lambda done, count: None)


def observe(target: TargetGeometry, folder: Path, camera: Camera | None) -> Observations:
    """What the detector sees."""
    photos = named_photos(sorted(folder.glob("*.png")))
    results = list(detect_photos(photos, target, detect=detect, camera=camera, overlay_folder=None, jobs=2))
    seen = [result.seen for result in results if result.seen is not None]
    return observations_from_detections(dataset_of(seen), target).observations


def incidence_deg(seen: Observations, truth: Truth) -> NDArray[np.float64]:
    """Angle between the line of sight and the face's normal, of each sighting by the true poses.  # (M,)"""
    pose = true_poses(truth, seen.view_names)[seen.view]
    position = seen.points.position_mm[seen.point]
    normal = seen.points.plane[seen.points.face[seen.point], :3]
    eye = -np.einsum("mji,mj->mi", pose[:, :3, :3], pose[:, :3, 3])
    sight = eye - position
    cosine = (sight * normal).sum(axis=1) / np.linalg.norm(sight, axis=1)
    return np.rad2deg(np.arccos(np.clip(cosine, -1, 1)))


def only(seen: Observations, rows: NDArray[np.bool_]) -> Observations:
    """Some of the sightings, without views that keep fewer than ten."""
    count = np.bincount(seen.view[rows], minlength=seen.view_count)
    keep = count >= 10
    rows = rows & keep[seen.view]
    return replace(
        seen, view_names=tuple(np.array(seen.view_names)[keep].tolist()), view=(np.cumsum(keep) - 1)[seen.view[rows]],
        point=seen.point[rows], center_px=seen.center_px[rows],
        cov_px2=None if seen.cov_px2 is None else seen.cov_px2[rows],
    )  # fmt: skip


def study(name: str, target: TargetGeometry, photos: Photos, folder: Path, weightings: Sequence[bool]) -> None:
    """Detect, solve, detect again with the camera, solve and evaluate; print a line each."""
    photograph(target, photos, folder)
    truth = read_truth(folder / "truth.json")
    first = solve(observe(target, folder, None), "opencv")
    seen = observe(target, folder, first.camera)
    angle = incidence_deg(seen, truth)
    for limit in (75.0, 90.0):
        for weighted in weightings:
            calibration = solve(only(seen, angle <= limit), "luhmann", SolveOptions(weighted=weighted))
            evaluation = evaluate(calibration, truth)
            found = [summarise(errors).rmse if (errors := evaluation.of(metric)) else np.nan for metric in METRICS]
            mean_pose = summarise(pose).mean if (pose := evaluation.of("pose")) else np.nan
            ratio = [paper / value for paper, value in zip(PAPER[name], found, strict=True)]
            print(
                f"{name:12} {photos.name:7} {f'<= {limit:.0f} deg' if limit < 90 else 'all':10} "
                f"{'weighted' if weighted else 'alike':9}"
                + "".join(f"{value:9.5f} ({times:5.1f}x)" for value, times in zip(found, ratio, strict=True))
                + f"  mean pose {mean_pose:.5f}  {len(calibration.observations.view)} sightings"
            )
    sys.stdout.flush()
    if len(target.target_from_face) > 1 and photos.name == "area":
        alone(observe(target, folder, None), truth)


def alone(seen: Observations, truth: Truth) -> None:
    """Each photo on its own, detected without a camera: the focal length, and whether its sigma covers its error."""
    true_px = truth.camera.params[0]
    for weighted in (False, True):
        errors, sigmas = [], []
        for view in range(seen.view_count):
            photo = keep_views(seen, np.arange(seen.view_count) == view)
            calibration = solve(photo, "luhmann", SolveOptions(weighted=weighted))
            errors.append(calibration.camera.params[0] - true_px)
            sigmas.append(np.sqrt(calibration.param_covariance[0, 0]))
        error, sigma = np.abs(errors), np.array(sigmas)
        part = error / true_px
        print(
            f"one photo alone, {'weighted' if weighted else 'alike'}: focal length off by {np.median(part):.4%} "
            f"(median), {np.quantile(part, 0.95):.4%} (95 %), {part.max():.4%} (worst of {len(part)}); "
            f"within .05 %: {(part < 5e-4).mean():.0%}; within 1, 2, 3 sigma: "
            + ", ".join(f"{(error < k * sigma).mean():.0%}" for k in (1, 2, 3))
        )


def main() -> None:
    """All sets of both targets."""
    print(f"luhmann model, {VIEWS} photos at {DISTANCE_MM:g} mm; in brackets: the paper's error over ours")
    print(f"{'':42}" + "".join(f"{name:>18}" for name in METRICS))
    with tempfile.TemporaryDirectory() as scratch:
        root = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(scratch)
        for name, target in targets().items():
            print(f"{name:12} {'paper':38}" + "".join(f"{value:9.5f}         " for value in PAPER[name]))
            for photos in SETS:
                study(name, target, photos, root / f"{name}-{photos.name}", (False, True))
    print(f"goal (area, <= 75 deg): {', '.join(f'{n} {g:g}' for n, g in zip(METRICS, GOAL, strict=True))}")


if __name__ == "__main__":
    main()
