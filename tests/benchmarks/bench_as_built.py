"""How fast and how well a print is measured from photos.

`python -m tests.benchmarks.bench_as_built`; the held-out part needs the photos beside the project, in `../shared/real`.
"""

from dataclasses import replace
from functools import partial

import numpy as np

from calib.cameras.camera import Camera
from calib.core.se3 import make_pose, transform
from calib.core.types import Observations, keep_views
from calib.measure_target.datum import best_motion
from calib.measure_target.lengths import scaled
from calib.measure_target.solve import measure
from calib.measure_target.unknowns import AsBuiltOptions
from calib.observe.observations import known_points
from calib.solver.metrics.evaluation import evaluate
from calib.solver.solve import solve
from calib.solver.start import solve_poses
from designer.base.arrays import Array, Flags
from designer.target import TargetGeometry
from designer.tolerance.error_file import error_model
from designer.tolerance.model import perturb
from tests.benchmarks.bench_real_calibration import FOLDER, observe, rms_px
from tests.benchmarks.bench_real_photos import plain_grid
from tests.benchmarks.synthetic import best_of, row, target_of
from tests.support.as_built_scenes import (
    blocks_of,
    frame_errors,
    mahalanobis,
    photos,
    printed,
    random_shape,
    solid,
    truth_of,
)

RINGS = (0.05, 0.02)
TRIALS = 200
FOLDS = 5


def speed() -> None:
    """90 views of about 210 rings."""
    target = target_of("ico 100 mm")
    rng = np.random.default_rng(1)
    seen = photos(printed(target, random_shape(target, rng, ring_mm=RINGS)), rng, 90)
    for title, options in (
        ("rigid faces (120 parameters)", AsBuiltOptions(ring_sigma_mm=None)),
        (f"and {target.ring_count} rings' offsets", AsBuiltOptions(ring_sigma_mm=RINGS)),
    ):
        seconds = best_of(3, partial(measure, [seen], target, "opencv", options))
        row(f"90 views x {len(seen.view) / 90:.0f} rings, {title}, one thread", "<= 2 s", f"{seconds:.2f} s")


def coverage(options: AsBuiltOptions, ring_mm: tuple[float, float]) -> tuple[float, float, float]:
    """Parts of the true motions, frames and strains that lie within their stated 95 % regions."""
    from scipy.stats import chi2

    own: list[Array] = []
    frames: list[Array] = []
    strains: list[float] = []
    for trial in range(TRIALS):
        rng = np.random.default_rng([7, trial])
        shape = random_shape(solid(), rng, ring_mm=ring_mm)
        found = measure([photos(printed(solid(), shape), rng)], solid(), "opencv", options)
        true = truth_of(found, shape, options)
        kept = found.is_determined
        own.append(mahalanobis(found.motion - true.shape.motion, blocks_of(found.motion_covariance))[kept])
        error = frame_errors(found.target, true.target)
        assert found.target.face_covariance is not None
        frames.append(mahalanobis(error, found.target.face_covariance)[kept])
        strain = found.strain[[0, 1, 2, 1, 0, 0], [0, 1, 2, 2, 2, 1]] - true.shape.strain
        strains.append(float(strain @ np.linalg.solve(found.strain_covariance, strain)))
    inside = float(chi2.ppf(0.95, 6))
    parts = [float((np.concatenate(some) < inside).mean()) for some in (own, frames)]
    return parts[0], parts[1], float((np.array(strains) < inside).mean())


def coverages() -> None:
    """With rigid faces, with ring offsets as expected, and with none where some were expected."""
    for title, options, ring_mm in (
        ("rigid faces", AsBuiltOptions(ring_sigma_mm=None), (0.0, 0.0)),
        ("rings off as expected", AsBuiltOptions(ring_sigma_mm=RINGS), RINGS),
        ("rings off three times as much", AsBuiltOptions(ring_sigma_mm=RINGS), (0.15, 0.06)),
        ("rings not off", AsBuiltOptions(ring_sigma_mm=RINGS), (0.0, 0.0)),
    ):
        own, frame, strain = coverage(options, ring_mm)
        row(f"95 % regions, {title}: own motions", "93-97 %", f"{own:.1%}", f"frames {frame:.1%}, strain {strain:.1%}")


def against_truth(
    seen: Observations, used: TargetGeometry, print_: TargetGeometry, held: Flags, lens: Camera | None = None
) -> dict[str, float]:
    """Root mean square errors on held-out views against the true rings, laid over the used ones by a similarity.

    The camera is solved with the used rings, or is given.
    """
    camera = solve(replace(keep_views(seen, ~held), points=known_points(used)), "opencv")
    camera = camera if lens is None else replace(camera, camera=lens)
    shown = replace(keep_views(seen, held), points=known_points(used))
    poses = solve_poses(camera.camera, shown)
    rows = np.unique(seen.point)
    scale, rotation, shift = best_motion(print_.center_mm[rows], used.center_mm[rows], with_scale=True)
    laid = scaled(print_, scale)
    change = make_pose(rotation, shift)
    laid = replace(laid, center_mm=transform(change, laid.center_mm), target_from_face=change @ laid.target_from_face)
    judged = replace(
        camera, observations=replace(shown, points=known_points(laid)), cam_from_target=poses.cam_from_target,
        residual_px=poses.residual_px, is_outlier=np.zeros(len(shown.view), dtype=bool),
        pose_covariance=poses.covariance,
    )  # fmt: skip
    errors = {errors.metric: errors for errors in evaluate(judged).errors}
    return {
        name: float(np.sqrt(np.nanmean((errors[name].vector ** 2).sum(axis=1))))
        for name in ("intersection", "reconstruction")
    }


def gain() -> None:
    """A print with fdm-dual errors: what is left of its errors once it was measured."""
    target = target_of("ico 100 mm")
    for preset in ("fdm-dual", "fdm-dual-calibrated", "hand-stickers"):
        rng = np.random.default_rng(11)
        print_ = perturb(target, error_model(preset), rng)
        seen = photos(print_, rng, 90)
        held = np.arange(90) % 3 == 0
        found = measure([keep_views(seen, ~held)], target, "opencv")
        figures = [against_truth(seen, used, print_, held) for used in (target, found.target)]
        perfect = against_truth(photos(target, np.random.default_rng(11), 90), target, target, held)
        for metric in ("intersection", "reconstruction"):
            nominal, measured = (one[metric] for one in figures)
            row(f"{preset}: {metric} error, nominal -> measured", ">= 10 x", f"{nominal / measured:.1f} x",
                f"{nominal:.4f} -> {measured:.4f} mm; perfect print {perfect[metric]:.4f} mm")  # fmt: skip


def held_out() -> None:
    """Real photos: every fifth view in turn, its pose from its own rings, camera and target from the others."""
    if not FOLDER.is_dir():
        print(f"  {FOLDER}: no real photos here")
        return
    camera = None
    for _ in range(2):
        seen = observe(camera)
        camera = solve(seen, "opencv").camera
    target = plain_grid(10, 7)
    for model in ("opencv", "luhmann"):
        left, plain = [], []
        for fold in range(FOLDS):
            held = np.arange(seen.view_count) % FOLDS == fold
            others, shown = keep_views(seen, ~held), keep_views(seen, held)
            found = measure([others], target, model, AsBuiltOptions(ring_sigma_mm=RINGS))
            moved = replace(shown, points=known_points(found.target))
            left.append(solve_poses(found.cameras[0], moved).residual_px)
            plain.append(solve_poses(solve(others, model).camera, shown).residual_px)
        figures = rms_px(np.concatenate(left)), rms_px(np.concatenate(plain))
        row(f"real 10 x 7 rings, {model}, held-out views, 2-D RMS", "<= 0.02 px", f"{figures[0]:.4f} px",
            f"as a flat grid {figures[1]:.4f} px")  # fmt: skip


def main() -> None:
    """All figures."""
    speed()
    held_out()
    gain()
    coverages()


if __name__ == "__main__":
    main()
