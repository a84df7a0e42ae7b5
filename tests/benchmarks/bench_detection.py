"""Thousands of random views: no wrong name, few rings missed, true covariances.

Run from the repository's root: `python -m tests.benchmarks.bench_detection [--views N | --quick] [--binary]`. Each view
has a seed of its own; two processes work, and a log of one line a view lets a killed run resume as long as neither
renderer nor detector changed. `--only SEED --overlay FILE.png` replays one view: true centres green (clean), yellow
(hidden in part); found ones as crosses, wrong ones red. `--binary` adds the scenario of the paper: one ray a pixel.

A found feature is wrong if its centre lies farther from its true place than 0.3 of the distance to its nearest
neighbour in the picture and 2 px, or if it cannot be seen at all. Every fifth view is also shown in a mirror.
"""

import argparse
import hashlib
import json
import math
import multiprocessing
import tempfile
import time
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path

import cv2
import numpy as np

import calib
from calib.cameras.camera import camera_or_preset
from calib.core.types import Detections
from calib.detector.pipeline import detect
from calib.renderer import RenderOptions, View, render_view
from designer.base.arrays import Flags
from designer.target import TargetGeometry, bounding_radius_mm
from tests.benchmarks.synthetic import (
    SPECS,
    Array,
    crashed,
    due_rings,
    look_at,
    random_direction,
    readable_faces,
    row,
    target_of,
    wrong_names,
)

MIRROR_EVERY = 5
BINARY_POSES, BINARY_DISTANCE_MM, BINARY_RAD = 40, 400.0, math.radians(75)


@dataclass(frozen=True)
class Record:
    """What one view gave; sums, so that views add up."""

    seed: int
    target: str
    named: int
    wrong: tuple[int, ...]  # rows
    wrong_faces: tuple[int, ...]  # faces of which most names are wrong
    shown: bool  # whether a board's dots, or all marks of some face's code, are well in view: else nobody could name it
    expected: int  # clean rings that must be found
    missed: tuple[tuple[int, float, float], ...]  # row, incidence in degrees, minor radius in px
    square: tuple[float, float, float]  # of errors (2-D) of clean rings: all, up to 75 deg, up to 65 deg
    count: tuple[int, int, int]
    variance: tuple[float, float, float]  # reported
    chi_square: tuple[float, float, float]
    outliers: tuple[tuple[int, float, float], ...]  # clean, up to 75 deg, over 6 sigma: row, error px, sigma px
    seconds: float
    mirror: str  # "": not tried, "free": may be named, "refused" or "named"
    reasons: tuple[tuple[str, int], ...]
    remarks: tuple[str, ...]


def drawn(seed: int) -> tuple[str, View]:
    """The target's name and the view of a seed."""
    rng = np.random.default_rng(seed)
    name = list(SPECS)[int(rng.integers(len(SPECS)))]
    target = target_of(name)
    white = rng.uniform(0.45, 0.8)
    options = RenderOptions(
        black=white * rng.uniform(0.05, 0.25),
        white=white,
        background=rng.uniform(0.05, 0.7),
        blur_px=rng.uniform(0.5, 2.0),
        contrast_to_noise=math.exp(rng.uniform(math.log(20), math.log(100))),
        light_gradient=rng.uniform(0, 0.5),
        vignetting=0.3 * float(rng.integers(2)),
        shading=rng.uniform(0, 0.5),
        glare=float(rng.integers(2)) * rng.uniform(0, 0.8),
        clutter=int(rng.integers(2) * rng.integers(1, 60)),
        occlusion=float(rng.integers(2)) * rng.uniform(0, 0.3),
    )
    direction = random_direction(rng, name.startswith("board"))
    aim = rng.uniform(-0.3, 0.3, 3) * bounding_radius_mm(target)
    pose = look_at(rng, direction, rng.uniform(250, 800), aim)
    return name, render_view(target, camera_or_preset("machine-vision"), pose, options, rng)


def mirror_outcome(view: View, target: TargetGeometry) -> str:
    """How a mirrored image fares: it must be refused where two faces, or a board's dots, are well in view."""
    named = len(detect(np.ascontiguousarray(view.image[:, ::-1]), target, name="mirrored").ring)
    if readable_faces(view, target) < min(2, target.face_count):
        return "free"
    return "named" if named else "refused"


def measure(seed: int) -> Record:
    """Draw a view, detect, compare."""
    name, view = drawn(seed)
    target = target_of(name)
    began = time.perf_counter()
    try:
        found = detect(view.image, target, name=str(seed))
        seconds = time.perf_counter() - began
        mirror = mirror_outcome(view, target) if seed % MIRROR_EVERY == 0 else ""
    except (ArithmeticError, AssertionError, LookupError, ValueError, TypeError, np.linalg.LinAlgError) as error:
        found, seconds, mirror = crashed(view, target, repr(error)), 0.0, ""
    return compared(seed, name, found, view, target, seconds, mirror)


def compared(
    seed: int, name: str, found: Detections, view: View, target: TargetGeometry, seconds: float, mirror: str
) -> Record:
    """The record of one view."""
    wrong = wrong_names(found, target, view.center_px, view.visible)
    faces = Counter(target.ring_face[found.ring].tolist())
    wrong_of = Counter(target.ring_face[found.ring[wrong]].tolist())
    due = due_rings(view)
    missed = np.setdiff1d(np.flatnonzero(due), found.ring[~wrong])
    good = ~wrong & view.clean[found.ring]
    rows, cov = found.ring[good], found.cov_px2[good]
    error = found.center_px[good] - view.center_px[rows]
    square, variance = (error**2).sum(axis=1), np.trace(cov, axis1=1, axis2=2)
    chi = np.einsum("ni,nij,nj->n", error, np.linalg.inv(cov), error) if len(rows) else np.zeros(0)
    angle = view.incidence_rad[rows]
    parts = [angle <= limit for limit in (math.pi, math.radians(75), math.radians(65))]
    far = parts[1] & (chi > 36)
    size, sigma = np.sqrt(square), np.sqrt(variance)
    degree = np.degrees(view.incidence_rad)
    reasons: Counter[str] = Counter()
    for face in found.faces:
        reasons.update(dict(face.missing))
    return Record(
        seed=seed,
        target=name,
        named=len(found.ring),
        wrong=tuple(found.ring[wrong].tolist()),
        wrong_faces=tuple(face for face, count in wrong_of.items() if 2 * count > faces[face]),
        shown=readable_faces(view, target) > 0,
        expected=int(due.sum()),
        missed=tuple((int(r), round(degree[r], 1), round(view.minor_radius_px[r], 1)) for r in missed),
        square=_sums(square, parts),
        count=(int(parts[0].sum()), int(parts[1].sum()), int(parts[2].sum())),
        variance=_sums(variance, parts),
        chi_square=_sums(chi, parts),
        outliers=tuple((int(rows[n]), round(size[n], 3), round(sigma[n], 3)) for n in np.flatnonzero(far)),
        seconds=seconds,
        mirror=mirror,
        reasons=tuple(reasons.items()),
        remarks=found.remarks,
    )


def _sums(values: Array, parts: list[Flags]) -> tuple[float, float, float]:
    return float(values[parts[0]].sum()), float(values[parts[1]].sum()), float(values[parts[2]].sum())


def run(seeds: range, log: Path) -> list[Record]:
    """Measure the seeds that the log does not hold yet, in two processes."""
    lines = log.read_text(encoding="utf-8").splitlines() if log.exists() else []
    records = {record.seed: record for record in (Record(**json.loads(line)) for line in lines if line.endswith("}"))}
    open_seeds = [seed for seed in seeds if seed not in records]
    with ProcessPoolExecutor(2, mp_context=multiprocessing.get_context("spawn")) as pool, log.open("a") as file:
        for record in pool.map(measure, open_seeds, chunksize=4):
            file.write(json.dumps(asdict(record)) + "\n")
            file.flush()
            records[record.seed] = record
            if record.wrong or record.mirror == "named":
                print(f"  seed {record.seed} ({record.target}): wrong {record.wrong[:8]}, mirror {record.mirror}")
    return [records[seed] for seed in seeds]


def default_log() -> Path:
    """A log for this state of renderer and detector."""
    sources = [Path(__file__), *sorted(Path(calib.__file__).parent.rglob("*.py"))]
    digest = hashlib.sha256(b"".join(path.read_bytes() for path in sources)).hexdigest()
    return Path(tempfile.gettempdir()) / f"ringsolid-bench-detection-{digest[:12]}.jsonl"


def report(records: list[Record]) -> None:
    """The tables."""
    for name in [*SPECS, "all"]:
        part = [r for r in records if name in (r.target, "all")]
        if not part:
            continue
        print(f"{name}: {len(part)} views")
        shown = [r for r in part if r.shown]
        wrong, faces = sum(len(r.wrong) for r in part), sum(len(r.wrong_faces) for r in part)
        row("wrong features (faces)", "0", f"{wrong} ({faces})", f"of {sum(r.named for r in part)} named")
        for what, some in (("all views", part), ("code or dots in view", shown)):
            expected, missed = sum(r.expected for r in some), sum(len(r.missed) for r in some)
            nameless = f"{len(some)} views, {sum(not r.named and r.expected > 0 for r in some)} of them unnamed"
            share = f"{1 - missed / max(expected, 1):.3%}"
            row(f"recall <= 65 deg, minor >= 5 px; {what}", ">= 99 %", share, f"of {expected} clean; {nameless}")
        for n, what in ((2, "<= 65 deg"), (1, "<= 75 deg"), (0, "all")):
            count, square = sum(r.count[n] for r in part), sum(r.square[n] for r in part)
            variance, chi = sum(r.variance[n] for r in part), sum(r.chi_square[n] for r in part)
            if count:
                ratio = f"sigma reported/observed {math.sqrt(variance / square):.3f}; chi2/2 {chi / count / 2:.2f}"
                row(f"centre RMSE 2-D px, clean, {what}", "", f"{math.sqrt(square / count):.4f}", ratio)
        crashes = [r.seed for r in part if any(remark.startswith("crash") for remark in r.remarks)]
        row("crashes", "0", f"{len(crashes)}", f"seeds {crashes[:6]}" if crashes else "")
        outliers = [(r.seed, *o) for r in part for o in r.outliers]
        row("clean, <= 75 deg, over 6 sigma", "", f"{len(outliers)}", f"{sorted(outliers, key=lambda o: -o[2])[:3]}")
        seconds = np.array([r.seconds for r in part])
        row("seconds a view: median, worst", "", f"{np.median(seconds):.2f}, {seconds.max():.2f}")
    mirrors = Counter(r.mirror for r in records if r.mirror)
    row("mirrored views refused, where two faces or dots show", "all", f"{mirrors['refused']}", f"{dict(mirrors)}")
    reasons: Counter[str] = Counter()
    for r in records:
        reasons.update(dict(r.reasons))
    print(f"  missing, as the detector says: {dict(reasons.most_common(8))}")
    worst = sorted(records, key=lambda r: -len(r.missed))[:8]
    print(f"  most missed (seed, target, missed of expected): "
          f"{[(r.seed, r.target, len(r.missed), r.expected) for r in worst if r.missed]}")  # fmt: skip


def overlay(seed: int, path: Path) -> None:
    """Replay one view and draw what was found over what is there."""
    name, view = drawn(seed)
    target = target_of(name)
    found = detect(view.image, target, name=str(seed))
    picture = cv2.cvtColor(np.asarray(view.image, dtype=np.uint8), cv2.COLOR_GRAY2BGR)
    for ring in np.flatnonzero(view.visible):
        colour = (0, 160, 0) if view.clean[ring] else (0, 200, 220)
        cv2.circle(picture, np.rint(view.center_px[ring]).astype(int).tolist(), 3, colour, 1)
    for center, is_wrong in zip(found.center_px, wrong_names(found, target, view.center_px, view.visible), strict=True):
        colour = (0, 0, 255) if is_wrong else (255, 80, 0)
        cv2.drawMarker(picture, np.rint(center).astype(int).tolist(), colour, cv2.MARKER_TILTED_CROSS, 9, 1)
    cv2.imwrite(str(path), picture)
    print(compared(seed, name, found, view, target, 0.0, ""))
    for face in found.faces:
        print(face)


def binary() -> None:
    """The paper's scenario: one ray a pixel, black or white, 400 mm."""
    goals = {"board, square": 0.125 / 2, "ico 100 mm": 0.135 / 2}
    for name, goal in goals.items():
        target, near, far = target_of(name), [], []
        rng = np.random.default_rng(1)
        for _ in range(BINARY_POSES):
            direction = random_direction(rng, name.startswith("board"))
            pose = look_at(rng, direction, BINARY_DISTANCE_MM, np.zeros(3))
            options = RenderOptions(sampling="binary", background=0.0)
            view = render_view(target, camera_or_preset("machine-vision"), pose, options, rng)
            found = detect(view.image, target, name=name)
            good = ~wrong_names(found, target, view.center_px, view.visible)
            square = ((found.center_px - view.center_px[found.ring]) ** 2).sum(axis=1)
            is_near = view.incidence_rad[found.ring] <= BINARY_RAD
            near.append(square[good & is_near])
            far.append(square[good & ~is_near])
        for what, parts in (("<= 75 deg", near), ("> 75 deg", far)):
            square = np.concatenate(parts)
            value = math.sqrt(square.mean()) if len(square) else math.nan
            limit = f"<= {goal:.4f}" if parts is near else ""
            row(f"binary, {name}, {what}: RMSE 2-D px", limit, f"{value:.4f}", f"{value / goal / 2:.2f} x the paper's; "
                f"{len(square)} features")  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--views", type=int, default=2000)
    parser.add_argument("--first", type=int, default=0, help="the first seed")
    parser.add_argument("--quick", action="store_true", help="40 views")
    parser.add_argument("--binary", action="store_true", help="the paper's scenario as well")
    parser.add_argument("--only", type=int, help="replay this seed")
    parser.add_argument("--overlay", type=Path, help="where to draw the replayed view")
    arguments = parser.parse_args()
    if arguments.only is not None:
        overlay(arguments.only, arguments.overlay or Path(tempfile.gettempdir()) / f"view-{arguments.only}.png")
        return
    first = arguments.first
    log = default_log()
    print(f"log: {log}", flush=True)
    report(run(range(first, first + (40 if arguments.quick else arguments.views)), log))
    if arguments.binary:
        binary()


if __name__ == "__main__":
    main()
