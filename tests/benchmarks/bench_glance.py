"""The quick look at frames of a video: no wrong name, centres, and the time, beside ChArUco with as many points.

Run from the repository's root: `python -m tests.benchmarks.bench_glance [--frames N] [--first SEED] [--log FILE]`.
Some views of icosahedra and boards are rendered; each frame is one of them, turned, moved, tilted and enlarged by a
homography, which is known, and blurred, shaken, darkened, covered by hands, and made noisy. In every seventh frame
another target is looked for than the one in view, or one more is put beside it. A frame has a seed of its own. No look
knows of the one before, so that videos are no other than single frames to it; but the frames are of a few views.

A name is wrong if its centre lies farther from its true place than .3 of the distance to its nearest neighbour and
2 px, or if that ring cannot be seen at all.
"""

import argparse
import json
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import cache, partial
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.detector.glance import glance
from calib.detector.pipeline import detect
from calib.detector.plan import TargetPlan, plan_for
from calib.renderer import RenderOptions, View, render_view
from designer.base.arrays import Flags
from designer.target import TargetGeometry
from tests.benchmarks.bench_everyday import CORNERS, HD, charuco, charuco_corners
from tests.benchmarks.synthetic import SPECS, Array, apply_homography, due_rings, row, target_of, wrong_names
from tests.support.ring_views import board, ico, pose_of
from tests.support.sightings import pinhole

Grey = NDArray[np.uint8]

VIEWS = 12
"""Of each target."""
FOCAL_PX = 1000.0
OTHER_EVERY = 7
DISTANCES_MM = {
    "board, 256 rings": 330.0,
    "board, 99 rings": 260.0,
    "board, triangular": 350.0,
    "ico, 720 rings": 300.0,
    "ico, 420 rings": 300.0,
}
"""From the targets, from .8 to 1.3 times as far."""
SIZES = {"1280 x 720": 1.0, "1920 x 1080": 1.5, "3840 x 2160": 3.0}
TIMED = "board, 256 rings"


@dataclass(frozen=True, eq=False)
class Frame:
    """What is looked at, and the truth."""

    image: Grey
    name: str
    other: str  # the target that is looked for; "": the one in view
    center_px: Array  # (R, 2)
    is_shown: Flags  # (R,)
    is_due: Flags  # (R,) well in view, and nothing before it
    is_blurred: bool


@dataclass(frozen=True)
class Outcome:
    """What one frame gave."""

    seed: int
    name: str
    is_other: bool
    named: int
    wrong: int
    due: int
    due_named: int
    errors_px: tuple[float, ...]
    chi_square: float
    cpu_ms: float
    remarks: tuple[str, ...]


@cache
def view_number(name: str, number: int) -> View:
    """A rendered view of a target; each number has a pose of its own."""
    rng = np.random.default_rng([number, *name.encode()])
    target, distance_mm = target_named(name), DISTANCES_MM[name]
    options = RenderOptions(blur_px=rng.uniform(0.4, 0.9), contrast_to_noise=100, light_gradient=rng.uniform(0, 0.4))
    pose = pose_of(target, rng, distance_mm * rng.uniform(0.8, 1.3))
    return render_view(target, pinhole(*HD, FOCAL_PX), pose, options, rng)


@cache
def target_named(name: str) -> TargetGeometry:
    """The target of a name in `DISTANCES_MM`."""
    if name in SPECS:
        return target_of(name)
    if name.startswith("ico"):
        return target_of("ico 100 mm") if "720" in name else ico()
    return board(columns=16, rows=16) if "256" in name else board()


def warp(rng: np.random.Generator, size: tuple[int, int]) -> Array:
    """A turn, a scale, a shift and a tilt about the middle of an image.  # (3, 3)"""
    middle = 0.5 * np.array(size)
    angle, scale = rng.uniform(-np.pi, np.pi), np.exp(rng.uniform(np.log(0.6), np.log(1.5)))
    shift = middle + rng.normal(0, 0.12, 2) * size
    turn = scale * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    stretch = np.diag([1.0, rng.uniform(0.6, 1.0)])
    mapped = np.eye(3)
    mapped[:2, :2] = turn @ stretch
    mapped[2, :2] = rng.normal(0, 1e-4, 2)
    there, back = np.eye(3), np.eye(3)
    there[:2, 2], back[:2, 2] = shift, -middle
    return np.asarray(there @ mapped @ back)


def cover(image: Grey, rng: np.random.Generator) -> Flags:
    """Draw hands and sleeves over an image; returns what they hide.  # (H, W)"""
    hidden = np.zeros(image.shape, dtype=np.uint8)
    for _ in range(int(rng.integers(1, 4))):
        at, turn = rng.uniform((0, 0), image.shape[::-1]), rng.uniform(0, 2 * np.pi)
        for finger in range(int(rng.integers(1, 5))):
            way = np.array([np.cos(turn + 0.3 * finger), np.sin(turn + 0.3 * finger)])
            end = at + rng.uniform(60, 250) * way
            ends = [tuple(int(value) for value in point) for point in (at, end)]
            width, level = int(rng.integers(15, 50)), float(rng.uniform(40, 220))
            cv2.line(image, ends[0], ends[1], level, width)
            cv2.line(hidden, ends[0], ends[1], 1, width + 12)
    return np.asarray(hidden > 0)


def frame_of(seed: int) -> Frame:
    """The frame of a seed."""
    rng = np.random.default_rng([77, seed])
    names = list(DISTANCES_MM)
    name = names[seed % len(names)]
    view = view_number(name, int(rng.integers(VIEWS)))
    mapped = warp(rng, HD)
    grey = float(rng.uniform(30, 220))
    image = np.asarray(cv2.warpPerspective(view.image, mapped, HD, flags=cv2.INTER_AREA, borderValue=grey), np.uint8)
    center_px = apply_homography(mapped, view.center_px)
    hidden = np.zeros(image.shape, dtype=np.bool_)
    is_other = seed % OTHER_EVERY == 0
    other = str(rng.choice([one for one in names if one != name])) if is_other else ""
    if is_other and rng.random() < 0.5:  # one more in the picture, and what is looked for is the first
        beside = cv2.warpPerspective(view_number(other, int(rng.integers(VIEWS))).image, warp(rng, HD), HD)
        left = int(rng.integers(HD[0] // 3, 2 * HD[0] // 3))
        image[:, left:], hidden[:, left - 8 :] = beside[:, left:], True
        other = ""
    if rng.random() < 0.4:
        hidden |= cover(image, rng)
    is_blurred, soft = blurred(image, rng)
    levels = np.clip(soft * rng.uniform(0.4, 1.2) + rng.normal(0, rng.uniform(0.5, 4), image.shape), 0, 255)
    inside = ((center_px > 0) & (center_px < np.array(HD) - 1)).all(axis=1)
    pixel = np.where(inside[:, None], np.nan_to_num(center_px), 0).astype(int)
    covered: Flags = np.asarray(hidden)
    free = inside & ~covered[pixel[:, 1], pixel[:, 0]]
    edge = ((center_px > 20) & (center_px < np.array(HD) - 21)).all(axis=1)
    return Frame(
        levels.astype(np.uint8),
        name,
        other,
        center_px,
        view.visible & inside,
        due_rings(view) & free & edge,
        is_blurred,
    )


def blurred(image: Grey, rng: np.random.Generator) -> tuple[bool, Array]:
    """An image as it is, out of focus, or shaken."""
    kind = rng.random()
    if kind < 0.4:
        return False, image.astype(np.float64)
    if kind < 0.7:
        soft = cv2.GaussianBlur(image.astype(np.float64), (0, 0), rng.uniform(0.6, 2.5))
        return True, np.asarray(soft, dtype=np.float64)
    length, angle = int(rng.integers(2, 12)), rng.uniform(0, np.pi)
    kernel = np.zeros((15, 15))
    way = 0.5 * length * np.array([np.cos(angle), np.sin(angle)])
    ends = [tuple(np.rint(7 + sign * way).astype(int).tolist()) for sign in (-1, 1)]
    cv2.line(kernel, ends[0], ends[1], 1.0)
    shaken = cv2.filter2D(image.astype(np.float64), -1, kernel / kernel.sum())
    return True, np.asarray(shaken, dtype=np.float64)


def outcome_of(seed: int) -> Outcome:
    """Look at the frame of a seed."""
    frame = frame_of(seed)
    looked_for = frame.other or frame.name
    plan = plan_for(target_named(looked_for))
    begin = time.process_time()
    found = glance(frame.image, plan, str(seed))
    cpu_ms = 1000 * (time.process_time() - begin)
    if frame.other:  # no name is right
        wrong = len(found.ring)
        return Outcome(seed, looked_for, True, wrong, wrong, 0, 0, (), 0.0, cpu_ms, found.remarks)
    off = found.center_px - frame.center_px[found.ring]
    error = np.linalg.norm(off, axis=1)
    is_wrong = wrong_names(found, plan.target, frame.center_px, frame.is_shown)
    # A motion blur's middle is where the kernel's pixels have theirs: half a pixel is not the detector's.
    sharp = [] if frame.is_blurred else error[~is_wrong].tolist()
    chi = (error**2 / np.trace(found.cov_px2, axis1=1, axis2=2))[~is_wrong] if sharp else np.zeros(0)
    return Outcome(
        seed, looked_for, False, len(found.ring), int(is_wrong.sum()), int(frame.is_due.sum()),
        int(frame.is_due[found.ring].sum()), tuple(sharp), float(chi.sum()), cpu_ms, found.remarks,
    )  # fmt: skip


def told(outcomes: list[Outcome]) -> None:
    """A table of frames."""
    frames = [one for one in outcomes if not one.is_other]
    others = [one for one in outcomes if one.is_other]
    row("wrong names", "0", str(sum(one.wrong for one in outcomes)), f"{len(outcomes)} frames")
    row("  frames with another target, named", "0", str(sum(one.named > 0 for one in others)), f"{len(others)} frames")
    row("  of these without a remark", "0", str(sum(not one.remarks for one in others)))
    due, due_named = sum(one.due for one in frames), sum(one.due_named for one in frames)
    row("rings well in view that are named", "", f"{due_named / max(due, 1):.1%}", f"{due} rings")
    empty = sum(one.named == 0 and one.due >= 40 for one in frames)
    row("frames with 40 of these rings and no name", "", f"{empty / max(len(frames), 1):.1%}")
    errors = np.concatenate([np.array(one.errors_px) for one in frames] or [np.zeros(0)])
    if len(errors):
        row("centres, root mean square, 99 %", "<= .3 px", f"{np.sqrt(np.mean(errors**2)):.3f}, "
            f"{np.quantile(errors, 0.99):.3f} px", f"{len(errors)} in sharp frames")  # fmt: skip
        row("  squared over what is stated", "<= 1", f"{sum(one.chi_square for one in frames) / len(errors):.2f}")
    times = [one.cpu_ms for one in outcomes]
    row("time of a frame, median, 95 %", "", f"{np.median(times):.0f}, {np.quantile(times, 0.95):.0f} ms")
    for one in outcomes:
        if one.wrong:
            print(f"  seed {one.seed}: {one.wrong} of {one.named} wrong, {one.name}, {one.remarks}")


def enlarged(image: Grey, scale: float) -> Grey:
    """An image at another size."""
    size = (round(image.shape[1] * scale), round(image.shape[0] * scale))
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_CUBIC), np.uint8)


def rings_seen(image: Grey, plan: TargetPlan) -> int:
    """How many a glance names."""
    return len(glance(image, plan).ring)


def timed() -> None:
    """The processor's time of a sharp frame, at three sizes, beside the exact pass and ChArUco."""
    target, board_image = target_named(TIMED), charuco(HD)
    base = cv2.GaussianBlur(view_number(TIMED, 1).image, (3, 3), 0.6)
    images = {size: enlarged(np.asarray(base, np.uint8), scale) for size, scale in SIZES.items()}
    plan = plan_for(target)
    works: dict[str, Callable[[], int]] = {
        f"glance, {size}": partial(rings_seen, image, plan) for size, image in images.items()
    }
    works["detect, 1280 x 720"] = lambda: len(detect(images["1280 x 720"], target, name="").ring)
    works["cv2 ChArUco, 1280 x 720"] = lambda: charuco_corners(board_image)
    taken: dict[str, list[float]] = {name: [] for name in works}
    seen = {name: work() for name, work in works.items()}
    for _ in range(9):  # in turns, so that a busy machine slows all alike
        for name, work in works.items():
            begin = time.process_time()
            work()
            taken[name].append(1000 * (time.process_time() - begin))
    peer = float(np.median(taken["cv2 ChArUco, 1280 x 720"]))
    for name, values in taken.items():
        goal = "<= 40 ms" if name == "glance, 1280 x 720" else ""
        of = f" of {CORNERS}" if "ChArUco" in name else ""
        middle = float(np.median(values))
        row(f"{name}, {seen[name]}{of} points", goal, f"{middle:.1f} ms", f"ChArUco x {peer / middle:.1f}")


def main() -> None:
    """Times, then frames."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=200)
    parser.add_argument("--first", type=int, default=0, help="seed of the first frame")
    parser.add_argument("--log", type=Path, help="a line of JSON a frame, for runs in parts")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    if options.frames < 1000 and not options.log:
        timed()
    outcomes = []
    for seed in range(options.first, options.first + options.frames):
        outcomes.append(outcome_of(seed))
        if options.log is not None:
            with options.log.open("a") as file:
                file.write(json.dumps(asdict(outcomes[-1])) + "\n")
    told(outcomes)


if __name__ == "__main__":
    main()
