"""Whether planned photos keep what the plan promises, and how many photos waving a target about takes for the same.

`python -m tests.benchmarks.bench_plan [--scenes N] [--first N] [--within PX] [--made WAY]`; `--scenes 2` takes half a
minute.

The scenes are those of `bench_guidance`: cameras and targets, true ones beside those that are believed. A plan is made
for a camera without distortion whose focal length is up to 10 % off, and for the noise there is; then a person holds
the target as it says, to 5 degrees and 20 mm (or a tenth of the distance), and the true camera takes the photos.
Promised is what the plan's worst try stated; stated is what the camera solved from the photos states, and true is what
95 % of the image differs by from the true camera. The other person waves the target about until the same goal is
stated.
"""

import argparse
from dataclasses import dataclass

import numpy as np

import calib
from calib.cameras import COMMON
from calib.cameras.refit import plain_camera
from designer.base.errors import InputError
from tests.benchmarks.bench_guidance import CIRCLE_SIGMAS, JUDGED, Step, first_guide, step_of
from tests.benchmarks.simulated_person import CLOSE, FEWEST_RINGS, PhotoScene, photograph, scene_of, waved
from tests.support.guided_scenes import TREMOR_MM, held_by_person

WITHIN_PX = 0.1
FOCAL_OFF = 0.1


@dataclass(frozen=True)
class Compared:
    """A plan, what came of it, and of as many photos at random."""

    planned: int
    promised_px: float
    is_reached: bool
    step: Step
    random: Step  # of as many photos
    random_count: float  # until the goal is stated; infinite: never


def planned_for(scene: PhotoScene, within_px: float, rng: np.random.Generator) -> calib.PhotoPlan:
    """The plan for a camera of which little is known."""
    focal_px = float(scene.camera.params[0] * (1 + FOCAL_OFF * rng.uniform(-1, 1)))
    about = plain_camera(COMMON, scene.camera.image_size, focal_px)
    return calib.plan(scene.target, about, within_px=within_px, made=scene.made, noise_px=scene.noise_px)


def taken(scene: PhotoScene, found: calib.PhotoPlan, rng: np.random.Generator) -> Step:
    """What is known after the photos of a plan."""
    guide = first_guide(scene)
    for number, (view, away_mm) in enumerate(zip(found.photos, found.distance_mm.tolist(), strict=True)):
        near = min(1.0, CLOSE * away_mm / TREMOR_MM)
        pose = held_by_person(view.cam_from_target, scene.target, rng, steady=near)
        seen = photograph(scene, pose, rng, f"{number:04d}.png")
        if len(seen.ring) >= FEWEST_RINGS:
            guide = guide.with_photo(seen)
    return step_of(scene, guide)


def waved_about(scene: PhotoScene, count: int, within_px: float, rng: np.random.Generator) -> tuple[Step, float]:
    """What is known after as many photos at random, and how many reach the goal."""
    guide, same, reached = first_guide(scene), None, np.inf
    for number, seen in enumerate(waved(scene, rng), 1):
        guide = guide.with_photo(seen)
        if number != count and number not in JUDGED:
            continue
        step = step_of(scene, guide)
        same = step if number == count else same
        if step.stated_px <= within_px and not np.isfinite(reached):
            reached = number
        if same is not None and (np.isfinite(reached) or number >= JUDGED[-1]):
            return same, reached
    raise AssertionError("a person who waves stops never")


def compared(scene: PhotoScene, seed: int, within_px: float) -> Compared:
    """One scene."""
    rng = np.random.default_rng([22, seed])
    found = planned_for(scene, within_px, rng)
    step, count = taken(scene, found, rng), len(found.photos)
    random, random_count = waved_about(scene, count, within_px, rng)
    return Compared(count, found.worst_px, found.is_reached, step, random, random_count)


def print_summary(rows: list[Compared], within_px: float) -> None:
    """The figures of all."""
    reached = [row for row in rows if row.is_reached]
    print(f"\n{len(rows)} scenes, {len(reached)} plans that promise {within_px:g} px")
    if not reached:
        return
    stated = np.array([row.step.stated_px for row in reached])
    kept = float((stated <= within_px).mean())
    print(f"promise kept, stated within {within_px:g} px: {100 * kept:.0f} %; in the rest up to {stated.max():.3f} px")
    ratio = np.array([row.step.stated_px / row.promised_px for row in reached])
    print(f"stated over promised: median {np.median(ratio):.2f}, {np.percentile(ratio, 5):.2f} to {ratio.max():.2f}")
    true = np.array([row.step.ratio for row in reached])
    far = int((true > CIRCLE_SIGMAS).sum())
    print(f"true over stated: median {np.median(true):.2f}, beyond {CIRCLE_SIGMAS} in {far} of {len(true)}")
    more = np.array([row.random.stated_px / row.step.stated_px for row in reached])
    print(f"as many photos at random state {np.median(more):.1f} times as much (median)")
    fewer = np.array([1 - row.planned / min(row.random_count, JUDGED[-1]) for row in reached])
    never = sum(not np.isfinite(row.random_count) for row in reached)
    low, middle, high = np.percentile(100 * fewer, (25, 50, 75))
    print(
        f"photos: at least {middle:.0f} % fewer than at random (median; quartiles {low:.0f}, {high:.0f}); "
        f"at random never within {JUDGED[-1]}: {never}"
    )


def main() -> None:
    """Print a line a scene, and the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", type=int, default=40)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--within", type=float, default=WITHIN_PX)
    parser.add_argument("--made", default="exact")
    arguments = parser.parse_args()
    rows: list[Compared] = []
    for number in range(arguments.first, arguments.first + arguments.scenes):
        scene = scene_of(number, made=arguments.made)
        try:
            row = compared(scene, number, arguments.within)
        except InputError as error:
            print(f"{scene.name} {error}", flush=True)
            continue
        rows.append(row)
        print(
            f"{scene.name}{row.planned:4} planned, promised {row.promised_px:6.3f}{'' if row.is_reached else ' (no)':5}"
            f" stated {row.step.stated_px:6.3f} true/stated {row.step.ratio:4.2f}; "
            f"random: {row.random.stated_px:6.3f}, {row.random_count:3.0f} photos",
            flush=True,
        )
    print_summary(rows, arguments.within)


if __name__ == "__main__":
    main()
