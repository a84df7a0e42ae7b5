"""How long a person waits after a photo, and how long a look at a frame takes.

`python -m tests.benchmarks.bench_guide_latency`

Thirty photos of each target with about 250 rings in each; CPU time: solving again with what the target may be off, the
next proposal, the verdict (halves of the photos, coverage ...); and a look at a frame. Median of several. The solution
and the proposal are to take less than 300 ms together, a look less than 5.
"""

import time
from collections.abc import Callable
from typing import TypeVar

import numpy as np

from calib.judge.guide import Guide, proposal_of
from calib.judge.guide_state import insight_of, judged
from designer.target import TargetGeometry
from tests.support.guided_scenes import WEBCAM, board_target, found_at, held_by_person, ico_target
from tests.support.verdict_cases import all_over

TARGETS = {"board 20 x 16": board_target(20, 16, 12.0), "icosahedron, edge 100 mm": ico_target(100.0, 11)}
PHOTOS, TIMES, LOOKS = 30, 5, 50
T = TypeVar("T")


def median_ms(work: Callable[[], T], times: int) -> tuple[float, T]:
    """Of the CPU time, and what came of it."""
    result, spent = work(), []
    for _ in range(times):
        begin = time.process_time()
        result = work()
        spent.append(time.process_time() - begin)
    return 1e3 * float(np.median(spent)), result


def measure(name: str, target: TargetGeometry) -> None:
    """Print a line."""
    rng = np.random.default_rng(0)
    poses = all_over(PHOTOS, rng, distance_mm=330.0)
    guide = Guide(target, image_size=WEBCAM.image_size)
    for number, pose in enumerate(poses):
        guide = guide.with_photo(found_at(pose, target, rng, f"{number}.png"))
    rings = np.mean([len(found.ring) for found in guide.photos])
    solving, insight = median_ms(lambda: insight_of(guide.photos, guide.settings), TIMES)
    judging, known = median_ms(lambda: judged(insight, guide.settings), TIMES)
    found = known.calibration
    if found is None or known.standing is None:
        raise RuntimeError("thirty photos determine a camera")
    proposing, proposal = median_ms(lambda: proposal_of(found, known, guide.settings, ()), TIMES)
    frames = [found_at(held_by_person(pose, target, rng), target, rng) for pose in poses[:LOOKS]]
    guide.look(frames[0])
    looking = np.median([median_ms(lambda frame=frame: guide.look(frame), 3)[0] for frame in frames])
    told = "nothing" if proposal is None else "a view"
    print(
        f"{name:26}{rings:6.0f} rings: solve {solving:4.0f}, propose {proposing:4.0f} ({told}), "
        f"verdict {judging:4.0f}, together {solving + proposing + judging:4.0f} ms; look {looking:4.1f} ms"
    )


def main() -> None:
    """Both targets."""
    for name, target in TARGETS.items():
        measure(name, target)


if __name__ == "__main__":
    main()
