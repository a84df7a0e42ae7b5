"""Whether cameras are as their file says: false alarms, and how often changes are found.

`python -m tests.benchmarks.bench_check [checks]`: each check has a camera solved from 20 photos of a board of 11 x 9
marks (.05 px, f 2500 px), or a rig solved from 15 frames (.1 px, f 1100 px), and three new photos or frames of it, all
with noise of their own. Told are shares of checks that say "changed" at 1 %; and of changes of the size that the test
itself says it would find with 95 %.
"""

import sys
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from calib.core.types import KnownPoints
from calib.judge.drift import DriftTest, drift_test
from calib.judge.reference import of_one_camera, reference_of
from tests.support import drift_scenes, rig_views, solver_scenes
from tests.support.drift_scenes import CAMERA, frames_of, moved_camera, photos_of, scaled

CHECKS, FRAMES, NEW = 1000, 15, 3


def one_camera(points: KnownPoints, seed: int, focal: float = 1.0, photos: int = NEW) -> DriftTest:
    """A check of a camera."""
    rng = np.random.default_rng(seed)
    known = reference_of(drift_scenes.solved(points, rng))
    seen = photos_of(scaled(CAMERA, focal), points, photos, rng)
    found = drift_test(known, of_one_camera(seen), is_exact=True, seed=seed)
    assert found is not None
    return found


def visible(points: KnownPoints, seed: int) -> DriftTest:
    """A check of a camera whose focal length changed by as much as an unchanged one says it would see."""
    focal = one_camera(points, seed).of("camera", "focal length")
    assert focal is not None
    return one_camera(points, seed, 1 + focal.visible)


def of_rig(make: Callable[..., rig_views.RigScene], seed: int, turn_deg: float = 0.0, focal: float = 1.0) -> DriftTest:
    """A check of a rig whose second camera turned about any axis."""
    rng, scene = np.random.default_rng(seed), make(frames=FRAMES + NEW, seed=seed)
    known = reference_of(drift_scenes.solved_rig(scene, FRAMES, rng))
    axis = rng.standard_normal(3)
    x, y, z = (turn_deg * axis / np.linalg.norm(axis)).tolist()
    seen = frames_of(moved_camera(scene, (x, y, z), focal=focal), slice(FRAMES, None), rng)
    found = drift_test(replace(known, photos=None), seen, is_exact=True, seed=seed)
    assert found is not None
    return found


def tell(name: str, count: int, check: Callable[[int], DriftTest], what: str = "") -> None:
    """The share of checks that say changed, and of these how many name what it was, and nothing else."""
    found = [check(seed) for seed in range(count)]
    changed = [one for one in found if one.is_changed]
    told = f"{name:58} changed {100 * len(changed) / count:6.2f} %"
    if what and changed:
        among = sum(what in {cause.what for cause in one.causes} for one in changed) / len(changed)
        wrong = sum(len(one.causes) == 1 and one.causes[0].what != what for one in changed) / len(changed)
        told += f"   the cause is among those told {100 * among:.1f} %, another alone {100 * wrong:.1f} %"
    print(told, flush=True)


if __name__ == "__main__":
    checks = int(sys.argv[1]) if len(sys.argv) > 1 else CHECKS
    board, solid = solver_scenes.board(), solver_scenes.icosahedron()
    few = max(checks // 5, 1)
    tell("a board, three photos, nothing changed", checks, lambda seed: one_camera(board, seed))
    tell("one photo", checks, lambda seed: one_camera(board, seed, photos=1))
    tell("an icosahedron, three photos", few, lambda seed: one_camera(solid, seed))
    tell("focal length + .1 %", few, lambda seed: one_camera(board, seed, 1.001), "focal length")
    tell("focal length by what would be found with 95 %", few, lambda seed: visible(board, seed), "focal length")
    tell("a stereo pair, three frames, nothing changed", few, lambda seed: of_rig(rig_views.stereo_pair, seed))
    tell("four cameras around a solid", few, lambda seed: of_rig(rig_views.ring, seed))
    tell("a camera of the pair turned by .05 deg", few, lambda seed: of_rig(rig_views.stereo_pair, seed, 0.05), "turn")
    tell("one of four turned by .05 deg", few, lambda seed: of_rig(rig_views.ring, seed, 0.05), "turn")
    tell(
        "focal length of one of four + .1 %", few, lambda seed: of_rig(rig_views.ring, seed, 0.0, 1.001), "focal length"
    )
