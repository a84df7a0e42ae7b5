"""Whether guidance saves photos: how many until a camera is good, for persons who follow it and for others.

`python -m tests.benchmarks.bench_guidance [--scenes N] [--first N] [--seeds N] [--made WAY] [--odd] [--trace]`;
`--scenes 2` takes less than a minute.

Each scene is a camera (640 to 4000 px wide, 30 to 110 degrees) and a target (boards, icosahedra of 20 to 100 mm edges);
sightings are computed with noise that grows for small rings. Three persons take photos of it until the same verdict on
them is good: one holds the target as the guide's ghost asks for, to 5 degrees and 20 mm (or a tenth of the distance, if
that is less); one waves it about at random; one fills the bars of ROS' cameracalibrator, which takes whole boards only,
and goes on when they are full. Stated is what 95 % of the image is uncertain by (1 sigma); true is what 95 % of it
differs by from the true camera, their best rotation removed. The promise is that true is within two stated.

`--made sheet-print,fdm-dual-calibrated` draws targets that came out so, boards and icosahedra; `--odd` gives lenses
what the model they are solved with does not have.
"""

import argparse
import os
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[name] = "1"  # before NumPy is loaded

import numpy as np  # noqa: E402

from calib.cameras.refit import camera_difference  # noqa: E402
from calib.judge.guide import Guide  # noqa: E402
from calib.solver.accuracy import SHARE_PERCENT  # noqa: E402
from designer.base.errors import InputError  # noqa: E402
from tests.benchmarks.simulated_person import PhotoScene, filling_bars, scene_of, taken_with, waved  # noqa: E402

SCENES, MOST_PHOTOS = 40, 42
COLUMNS = 24
WITHIN_SIGMAS = 2.0
"""Of the stated deviation: so far the true camera may be off in 95 % of the image."""
CIRCLE_SIGMAS = 2.45
"""The radius of a circle that holds 95 % of a plane's normal errors: what two would be, were both axes as unsure."""
JUDGED = (*range(1, 17), *range(18, 31, 2), *range(33, MOST_PHOTOS + 1, 3))
"""Numbers of photos after which a camera is judged that was not guided; in favour of those who do without, the first
number that might have been good counts."""
FIXED = (6, 9, 12, 15, 20, 30)
"""Numbers of photos at which the figures of those who wave are looked at because nobody stopped there for them."""


@dataclass(frozen=True)
class Step:
    """What is known after a photo."""

    photos: int
    grade: str  # of the verdict; "" if there is none; "early": good, but after too few photos to be told so
    stated_px: float
    true_px: float
    are_bars_full: bool
    note: str

    @property
    def ratio(self) -> float:
        """True over stated."""
        return self.true_px / self.stated_px

    @property
    def is_known(self) -> bool:
        """Whether anything is stated."""
        return bool(np.isfinite(self.stated_px))


@dataclass(frozen=True)
class Run:
    """All photos of one person."""

    scene: PhotoScene
    person: str
    steps: tuple[Step, ...]
    seconds: float  # a photo

    @property
    def is_good(self) -> bool:
        """Whether it ended well."""
        return bool(self.steps) and self.steps[-1].grade == "good"

    @property
    def photos(self) -> float:
        """Until it was good; infinite if it never was."""
        if not self.is_good:
            return np.inf
        return self.steps[-2].photos + 1 if len(self.steps) > 1 else self.steps[-1].photos


def step_of(scene: PhotoScene, guide: Guide, *, are_bars_full: bool = False, note: str = "") -> Step:
    """What a guide knows, and what is true."""
    photos, verdict, known = len(guide.photos), guide.verdict, guide.calibration
    if verdict is None or known is None:
        return Step(photos, "", np.inf, np.inf, are_bars_full, note)
    stated = next((check.value for check in verdict.checks if check.name == "uncertainty"), None)
    try:
        length = camera_difference(scene.camera, known.camera, columns=COLUMNS).length_px
        true = float(np.percentile(np.where(np.isfinite(length), length, np.inf), SHARE_PERCENT, method="lower"))
    except InputError:
        true = np.inf
    bad = ", ".join(check.name for check in verdict.checks if check.grade in ("usable", "bad"))
    return Step(photos, verdict.grade, np.inf if stated is None else stated, true, are_bars_full, f"{note} {bad}")


def first_guide(scene: PhotoScene) -> Guide:
    """Before the first photo."""
    return Guide(scene.target, made=scene.made, image_size=scene.camera.image_size)


def guided(scene: PhotoScene, rng: np.random.Generator) -> Iterator[Step]:
    """Who follows the ghost."""
    guide = first_guide(scene)
    while (told := guide.told).ghost is not None:
        guide, skipped = taken_with(guide, scene, rng)
        note = f"{skipped * 's'} {told.ghost.short}, {told.ghost.gain}, {len(guide.photos[-1].ring)} rings:"
        step = step_of(scene, guide, note=note)
        # The guide asks for more photos than the first that might be good.
        yield step if guide.is_good or step.grade != "good" else replace(step, grade="early")


def random(scene: PhotoScene, rng: np.random.Generator) -> Iterator[Step]:
    """Who waves the target about."""
    guide = first_guide(scene)
    for number, found in enumerate(waved(scene, rng), 1):
        guide = guide.with_photo(found)
        if number in JUDGED:
            yield step_of(scene, guide)


def with_bars(scene: PhotoScene, rng: np.random.Generator) -> Iterator[Step]:
    """Who fills bars."""
    guide, were_full = first_guide(scene), False
    for number, (found, bars) in enumerate(filling_bars(scene, rng), 1):
        guide = guide.with_photo(found)
        if number in JUDGED or bars.are_full != were_full:
            yield step_of(scene, guide, are_bars_full=bars.are_full)
        were_full = bars.are_full


PERSONS: dict[str, Callable[[PhotoScene, np.random.Generator], Iterator[Step]]] = {
    "guided": guided, "random": random, "ros": with_bars,
}  # fmt: skip


def run_of(scene: PhotoScene, person: str, seed: int, most: int) -> Run:
    """Photos until it is good, or too many."""
    begin, steps = time.process_time(), []
    for step in PERSONS[person](scene, np.random.default_rng([21, seed])):
        steps.append(step)
        if step.grade == "good" or step.photos >= most:
            break
    return Run(scene, person, tuple(steps), (time.process_time() - begin) / max(steps[-1].photos, 1))


def print_run(run: Run, *, is_traced: bool) -> None:
    """A line, or one for each photo."""
    last = run.steps[-1]
    print(
        f"{run.scene.name} {run.person:7}{last.photos:4} photos  {last.grade or '-':7} stated {last.stated_px:6.3f} "
        f"true {last.true_px:6.3f} ratio {last.ratio:4.2f}  {run.seconds:5.2f} s {'' if run.is_good else last.note}",
        flush=True,
    )
    for step in run.steps if is_traced else ():
        print(f"    {step.photos:3} {step.stated_px:8.3f} {step.true_px:8.3f}  {step.note}")


def beyond(steps: Sequence[Step]) -> str:
    """How often the truth is beyond the promise, and how true compares with stated."""
    known = [step for step in steps if step.is_known]
    ratio = np.array([step.ratio for step in known] or [np.nan])
    over, far = (100 * float((ratio > limit).mean()) for limit in (WITHIN_SIGMAS, CIRCLE_SIGMAS))
    rms = float(np.sqrt(np.mean(np.minimum(ratio, 10) ** 2)))
    shares = f"{over:4.1f} % of {len(known):4} ({far:.1f} % beyond {CIRCLE_SIGMAS})"
    return f"{shares}, ratio {np.median(ratio):.2f} (rms {rms:.2f})"


def print_persons(runs: Sequence[Run]) -> None:
    """Photos until good, and whether it is true, by person."""
    print(f"\n{'person':8}{'runs':>5}{'good':>5}   photos: quartiles       s/photo  true beyond two stated when good")
    for person in dict.fromkeys(run.person for run in runs):
        part = [run for run in runs if run.person == person]
        good = [run for run in part if run.is_good]
        quartiles = np.percentile([run.photos for run in part], (25, 50, 75), method="higher")
        cells = " ".join(f"{value:6.0f}" for value in quartiles)
        seconds = np.median([run.seconds for run in part])
        print(
            f"{person:8}{len(part):5}{len(good):5}   {cells}{seconds:16.2f}  {beyond([run.steps[-1] for run in good])}"
        )


def print_ratios(runs: Sequence[Run]) -> None:
    """Each scene and draw, who follows against others; who is never good counts with the photos he took."""
    mine = [run for run in runs if run.person == "guided"]
    for person in dict.fromkeys(run.person for run in runs if run.person != "guided"):
        theirs = [run for run in runs if run.person == person]
        scenes = {run.scene.name for run in theirs}
        pairs = list(zip((run for run in mine if run.scene.name in scenes), theirs, strict=False))
        good = np.array([(a.steps[-1].photos, b.steps[-1].photos) for a, b in pairs if a.is_good]).reshape(-1, 2)
        if len(good):
            low, middle, high = np.percentile(100 * (1 - good[:, 0] / good[:, 1]), (25, 50, 75))
            ours, others = (sum(pair[k].is_good and not pair[1 - k].is_good for pair in pairs) for k in (0, 1))
            print(
                f"guided against {person}: at least {middle:.0f} % fewer photos (median; quartiles {low:.0f}, "
                f"{high:.0f}); only guided good {ours}, only {person} good {others}, of {len(pairs)}"
            )


def print_honesty(runs: Sequence[Run]) -> None:
    """How far what is stated can be relied on where nobody stopped because of it, and what bars are worth."""
    waved_steps = [step for run in runs if run.person == "random" for step in run.steps if step.photos in FIXED]
    print(f"random, at {FIXED} photos: {beyond(waved_steps)}")
    firsts = [next((s for s in run.steps if s.are_bars_full), None) for run in runs if run.person == "ros"]
    full = [step for step in firsts if step is not None]
    if full:
        fine = sum(step.true_px <= 0.1 for step in full)
        photos = np.median([step.photos for step in full])
        true = np.percentile([step.true_px for step in full], (25, 50, 75), method="higher")
        cells = " ".join(f"{value:.3f}" for value in true)
        print(
            f"bars full {len(full)} of {len(firsts)} before the verdict is good, after {photos:.0f} photos (median): "
        )
        print(f"  then within 0.1 px {fine}; true error, quartiles {cells} px")


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", type=int, default=SCENES)
    parser.add_argument("--first", type=int, default=0, help="seed of the first scene")
    parser.add_argument("--seeds", type=int, default=1, help="times that each scene is photographed")
    parser.add_argument("--made", default="exact")
    parser.add_argument("--odd", action="store_true", help="lenses that the model does not fit quite")
    parser.add_argument("--most", type=int, default=MOST_PHOTOS)
    parser.add_argument("--persons", default=",".join(PERSONS))
    parser.add_argument("--trace", action="store_true", help="a line for each photo")
    arguments = parser.parse_args()
    runs: list[Run] = []
    for number in range(arguments.first, arguments.first + arguments.scenes):
        scene = scene_of(number, made=arguments.made, is_lens_odd=arguments.odd)
        for seed in range(arguments.seeds):
            for person in arguments.persons.split(","):
                if person != "ros" or scene.is_flat:
                    runs.append(run_of(scene, person, 1000 * number + seed, arguments.most))
                    print_run(runs[-1], is_traced=arguments.trace)
    print_persons(runs)
    print_ratios(runs)
    print_honesty(runs)


if __name__ == "__main__":
    main()
