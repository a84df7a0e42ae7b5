"""A camera on a robot by poses alone, beside the reference solvers of KinHEC (`pip install kinhec`).

    python -m tests.benchmarks.bench_pose_pairs --seeds 3

KinHEC's smoke tier: 46 sequences a seed, in tracks; each solver gets them as its own protocol says, with the true
offset of the clocks; ours finds the offset itself, and is told which sequences are odometry and which lack a scale.
Errors of X (mm) are medians of a track; "cover" is how often the stated 95 % ellipsoid holds X. Errors of the robot's
own geometry (tracks robot_error and mixed) are in no statement that poses allow.
"""

import argparse
import tempfile
import time
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from calib.core.se3 import invert, log_rotation
from calib.rigs.pose_pairs import InHand, PairsSolution, PosePairs, solve_pose_pairs, solve_pose_streams
from designer.base.arrays import Array

CHI_SQUARE = 12.59  # 95 % of six


def millimetres(pose: Array) -> Array:
    """Poses of metres."""
    pose = np.array(pose, dtype=np.float64)
    pose[..., :3, 3] *= 1e3
    return pose


def ours(sequence: Any) -> PairsSolution:  # noqa: ANN401  # kinhec has no types
    """Our solution of a sequence."""
    hand: InHand = "camera" if sequence.eye_in_hand else "target"
    known = sequence.camera.has_measurement
    seen, robot = millimetres(sequence.camera.T_cam_target_meas[known]), millimetres(sequence.robot.T_base_ee_meas)
    has_scale, adds_up = sequence.scale != 1.0, sequence.manifest["camera_noise_model"] == "vo_drift" or None
    told = invert(robot) if sequence.eye_in_hand else robot
    if sequence.synchronous:
        return solve_pose_pairs(PosePairs(seen, told[known], hand), has_scale=has_scale, adds_up=adds_up)
    times = sequence.camera.t[known], sequence.robot.t
    return solve_pose_streams(times[0], seen, times[1], told, hand, has_scale=has_scale, adds_up=adds_up)


def error_of(sequence: Any, found: PairsSolution) -> tuple[float, float]:  # noqa: ANN401
    """Millimetres of X, and its weighed square."""
    true = millimetres(sequence.X)
    if sequence.eye_in_hand:
        true, place, covariance = invert(true), found.cam_from_rig, found.covariance[:6, :6]
        shift = invert(true)[:3, 3] - invert(place)[:3, 3]
    else:
        place, covariance = found.carrier_from_target, found.covariance[6:, 6:]
        shift = true[:3, 3] - place[:3, 3]
    six = np.concatenate([log_rotation(true[:3, :3] @ place[:3, :3].T), true[:3, 3] - place[:3, 3]])
    square = float(six @ np.linalg.solve(covariance, six)) if np.isfinite(covariance).all() else np.nan
    return float(np.linalg.norm(shift)), square


def main() -> None:
    """Print a table of tracks."""
    from kinhec import benchmark  # type: ignore[import-not-found]
    from kinhec.io import iter_sequences  # type: ignore[import-not-found]
    from kinhec.pipeline import generate_dataset  # type: ignore[import-not-found]
    from kinhec.plans import load_tier  # type: ignore[import-not-found]

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=1)
    seeds = parser.parse_args().seeds
    errors: dict[str, dict[str, list[float]]] = defaultdict(lambda: defaultdict(list))
    square, seconds = defaultdict(list), defaultdict(list)
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(seeds):
            root = Path(folder) / str(seed)
            tier = load_tier("smoke")
            tier["global_seed"] += seed
            plan = Path(folder) / f"{seed}.yaml"
            plan.write_text(yaml.safe_dump(tier))
            generate_dataset(str(plan), root, progress=False)
            for sequence in iter_sequences(root):
                track = sequence.manifest["track"]
                for row in benchmark.evaluate_sequence(sequence, list(benchmark.SOLVERS), rng=np.random.default_rng(0)):
                    errors[track][row["solver"]].append(row["X_trans_err_mm"] if row["ok"] else np.inf)
                begun = time.perf_counter()
                found = ours(sequence)
                seconds[track].append(time.perf_counter() - begun)
                off_mm, weighed = error_of(sequence, found)
                errors[track]["ours"].append(off_mm)
                square[track].append(weighed)
    print(f"{'track':12} {'n':>4} {'ours':>8} {'best':>8}  {'by':20} {'ratio':>6} {'cover':>6} {'s each':>7}")
    for track, by in errors.items():
        median = {name: float(np.median(each)) for name, each in by.items()}
        mine = median.pop("ours")
        best = min(median, key=lambda name: median[name])
        held = np.mean(np.array(square[track]) < CHI_SQUARE)
        print(
            f"{track:12} {len(square[track]):4} {mine:8.2f} {median[best]:8.2f}  {best:20} {mine / median[best]:6.2f} "
            f"{held:6.2f} {np.median(seconds[track]):7.3f}"
        )


if __name__ == "__main__":
    main()
