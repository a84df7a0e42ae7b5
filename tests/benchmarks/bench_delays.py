"""Time offsets of three cameras beside what is stated, by frame rate and by how the target is moved.

python -m tests.benchmarks.bench_delays --rigs 10
"""

import argparse
from collections.abc import Sequence

import numpy as np

from calib.core.se3 import exp_rotation, look_at, make_pose
from calib.rigs.problem import CameraChoice, RigOptions
from calib.rigs.solve import solve_rig
from designer.base.arrays import Array
from tests.support import rig_views, solver_scenes

RATES_HZ = (3, 10, 30)
FRAMES, MOST_S, JITTER_S, NOISE_PX = 60, 0.03, 1e-3, 0.05
MOTIONS = {
    # least and largest frequency in Hz, from which on and by which power amplitudes fall, waves
    "one slow wave": (0.1, 0.28, 1.0, 0.0, 1),
    "a calm hand, to 1.2 Hz": (0.1, 1.2, 0.2, 2.0, 12),
    "a jerky hand, to 3 Hz": (0.1, 3.0, 0.3, 1.5, 20),
}
SIZE = np.array([0.6, 0.6, 0.6, 30.0, 30.0, 30.0])
"""Of a coordinate: rad, mm."""


def moved(motion: str, time_s: Array, rng: np.random.Generator) -> Array:
    """Poses of the target at times (C, V): (C, V, 4, 4)."""
    least, most, bend, power, waves = MOTIONS[motion]
    frequency, begin = rng.uniform(least, most, (waves, 6)), rng.uniform(0, 2 * np.pi, (waves, 6))
    size = (bend / np.maximum(frequency, bend)) ** power
    size *= SIZE / np.sqrt((size**2).sum(axis=0))
    six = (size * np.sin(2 * np.pi * frequency * time_s[..., None, None] + begin)).sum(axis=-2)
    return make_pose(exp_rotation(six[..., :3]), six[..., 3:])


def one_rig(motion: str, rate_hz: int, seed: int) -> tuple[Array, Array]:
    """Errors of the delays of a rig, and their standard deviations: (2,) each, s."""
    rng = np.random.default_rng(seed)
    delay_s = np.concatenate([[0.0], rng.uniform(-MOST_S, MOST_S, 2)])
    stamp_s = np.arange(FRAMES) / rate_hz + rng.uniform(-JITTER_S, JITTER_S, (3, FRAMES))
    angle = 0.5 * np.pi * np.arange(3)
    eye_mm = 600 * np.stack([np.cos(angle), np.sin(angle), 0.2 * np.cos(2 * angle)], axis=1)
    pose = look_at(eye_mm, np.zeros((3, 3)))[:, None] @ moved(motion, stamp_s - delay_s[:, None], rng)
    lenses = tuple(rig_views.camera(1000.0 + 40 * number) for number in range(3))
    seen = rig_views.seen_by_all(
        ("a", "b", "c"), lenses, pose, solver_scenes.icosahedron(100.0, 5), rng, NOISE_PX, stamp_s
    )
    known = [CameraChoice(lens.model, given=lens, is_refined=False) for lens in lenses]
    found = solve_rig(seen, known, RigOptions(estimates_delays=True))
    if found.delay_s is None or found.delay_sigma_s is None:
        raise ValueError("no delays")
    return (found.delay_s - delay_s)[1:], found.delay_sigma_s[1:]


def main(words: Sequence[str] | None = None) -> None:
    """All motions at all rates."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rigs", type=int, default=10)
    rigs = parser.parse_args(words).rigs
    for motion in MOTIONS:
        for rate_hz in RATES_HZ:
            solved = [one_rig(motion, rate_hz, seed) for seed in range(rigs)]
            error, sigma = (np.concatenate(part) for part in zip(*solved, strict=True))
            ratio = error / sigma
            print(
                f"{motion}, {rate_hz} Hz: RMS error {1e6 * np.sqrt((error**2).mean()):.0f} us, stated "
                f"{1e6 * np.median(sigma):.0f} us (median); errors in sigmas {np.sqrt((ratio**2).mean()):.2f} RMS, "
                f"{np.abs(ratio).max():.1f} at most (goal 1.3)",
                flush=True,
            )


if __name__ == "__main__":
    main()
