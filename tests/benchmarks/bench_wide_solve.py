"""Wide lenses from nothing: how often the optimum is found, what is dropped, and how long it takes.

Run from the repository's root: `python -m tests.benchmarks.bench_wide_solve [--cases N] [--models a,b]`. Cases are
drawn at random: lenses of 90 to 280 degrees of the projections that makers aim at (equidistant, equisolid,
stereographic, orthographic), of the unified model as lens and as mirror (whose picture is mirrored and blind in the
middle), and of the double sphere; image circles inside the frame or cut by it, the axis off the middle, pixels that
are not square; boards and icosahedra, one photo to forty, near and far off the axis, noise .1 to 1 px, none to 5 %
outliers. Every model is solved from nothing, and again from the truth (the model fitted to the true rays, the true
poses): the optimum is found where no view is lost and the root mean square distance is no more than a thousandth above
that.
"""

import argparse
import os
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from designer.base.arrays import Array, Rows

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[name] = "1"  # before NumPy is loaded

import numpy as np  # noqa: E402

from calib.cameras import ABILITIES, fitted_models  # noqa: E402
from calib.cameras.refit import fit_rays, image_grid  # noqa: E402
from calib.core.se3 import exp_rotation, make_pose, rotation_between, transform  # noqa: E402
from calib.core.types import KnownPoints, Observations  # noqa: E402
from calib.solver.descend import descend  # noqa: E402
from calib.solver.problem import SolveOptions, pack, tie_parameters  # noqa: E402
from calib.solver.solve import solve  # noqa: E402
from designer.base.errors import InputError  # noqa: E402
from tests.support.solver_scenes import board, icosahedron  # noqa: E402

Radius = Callable[[Array], Array]

CASES = 60
SIZES = ((640, 480), (1280, 800), (1920, 1080), (1024, 1024))
WORSE = 1e-3
REJECT_SIGMA = 6.0
TRIES = 4000
SCREEN = 40


def double_sphere(xi: float, alpha: float) -> Radius:
    """Its distance from the centre."""

    def radius(theta: Array) -> Array:
        z = xi + np.cos(theta)
        return np.asarray(np.sin(theta) / (alpha * np.hypot(np.sin(theta), z) + (1 - alpha) * z))

    return radius


def unified(xi: float) -> Radius:
    """Its distance from the centre."""
    return lambda theta: np.asarray(np.sin(theta) / (np.cos(theta) + xi))


@dataclass(frozen=True)
class Shape:
    """A kind of lens."""

    radius: Radius  # of the angle off the axis, up to a factor
    fields_deg: tuple[float, float]  # least and largest field of view
    least_deg: float = 0.0  # off the axis: nearer it sees itself
    is_mirrored: bool = False


SHAPES = {
    "equidistant": Shape(lambda theta: theta, (90, 280)),
    "equisolid": Shape(lambda theta: np.asarray(np.sin(theta / 2)), (90, 280)),
    "stereographic": Shape(lambda theta: np.asarray(np.tan(theta / 2)), (90, 260)),
    "orthographic": Shape(lambda theta: np.asarray(np.sin(0.97 * theta)), (90, 170)),
    "bent polynomial": Shape(lambda theta: theta * (1 - 0.09 * theta**2 + 0.012 * theta**4), (100, 220)),
    "double sphere": Shape(double_sphere(-0.2, 0.6), (100, 220)),
    "unified xi 2.5": Shape(unified(2.5), (100, 190)),
    "mirror xi .96": Shape(unified(0.96), (190, 230), 25.0, is_mirrored=True),
    "mirror xi 1.4": Shape(unified(1.4), (180, 200), 20.0, is_mirrored=True),
}
TARGETS: dict[str, Callable[[], KnownPoints]] = {
    "board 8 x 6": lambda: board(8, 6, 30.0),
    "board 12 x 9": lambda: board(12, 9, 20.0),
    "board 20 x 20": lambda: board(20, 20, 12.0),
    "icosahedron": lambda: icosahedron(100.0, 5),
}
PHOTOS = (1, 3, 5, 8, 12, 20, 40)


@dataclass(frozen=True, eq=False)
class Case:
    """What was seen, and the truth of it."""

    words: tuple[tuple[str, str], ...]  # what it is to be counted under
    seen: Observations
    pixel: Array  # (N, 2)
    ray: Array  # (N, 3) of these pixels
    cam_from_target: Array  # (V, 4, 4)
    options: SolveOptions


def draw(seed: int) -> Case:
    """A case at random."""
    rng = np.random.default_rng(seed)
    while True:
        case = _draw(rng)
        if case is not None:
            return case


def _draw(rng: np.random.Generator) -> Case | None:
    size = SIZES[rng.integers(len(SIZES))]
    kind = list(SHAPES)[rng.integers(len(SHAPES))]
    shape, name, photos = SHAPES[kind], list(TARGETS)[rng.integers(len(TARGETS))], int(rng.choice(PHOTOS))
    points = TARGETS[name]()
    is_solid = name == "icosahedron"
    if is_solid and shape.is_mirrored:  # a mirrored solid is another solid; a mirrored board is one seen from behind
        return None
    if not is_solid and photos < 3:
        photos = 3
    half = np.radians(rng.uniform(*shape.fields_deg) / 2)
    is_cut = rng.random() < 0.5
    circle_px = (0.5 * np.hypot(*size) if is_cut else rng.uniform(0.4, 0.5) * min(size)) * rng.uniform(0.9, 1.0)
    middle = 0.5 * (np.array(size) - 1) + rng.uniform(-0.05, 0.05, 2) * size
    aspect = 1.0 if rng.random() < 0.8 else float(rng.uniform(0.93, 1.08))
    flip = -1.0 if shape.is_mirrored or (not is_solid and rng.random() < 0.1) else 1.0
    focal = circle_px / float(shape.radius(np.array(half))) * np.array([1.0, aspect])
    lens = _Lens(shape, half, focal, flip, middle, size)
    poses, rows, pixels = [], [], []
    is_far = rng.random() < 0.3
    for _ in range(TRIES):
        pose = _pose(points, half, max(np.radians(shape.least_deg), 0.5 * half if is_far else 0.0), rng)
        pixel, shown = lens.shown(points, pose)
        if len(shown) >= (max(0.5 * len(points.position_mm), 12) if not is_solid else 12):
            poses.append(pose)
            rows.append(shown)
            pixels.append(pixel)
        if len(poses) == photos:
            break
    if len(poses) < photos:
        return None
    noise, outliers = float(np.exp(rng.uniform(np.log(0.1), 0.0))), float(rng.choice([0, 0, 0.01, 0.05]))
    measured = np.concatenate(pixels)
    measured = measured + noise * rng.standard_normal(measured.shape)
    wrong = rng.random(len(measured)) < outliers
    measured[wrong] += rng.uniform(-1, 1, (int(wrong.sum()), 2)) * 0.05 * size[0]
    seen = Observations(
        size, tuple(f"view{n}" for n in range(photos)), np.repeat(np.arange(photos), [len(one) for one in rows]),
        np.concatenate(rows), measured, None, points,
    )  # fmt: skip
    words = (
        ("lens", kind),
        ("field", f"{60 * round(np.degrees(2 * half) / 60)} deg"),
        ("target", name),
        ("photos", str(photos)),
        ("outliers", f"{100 * outliers:g} %"),
        ("poses", "far off the axis" if is_far else "anywhere"),
        ("picture", "mirrored" if flip < 0 else "as it is"),
        ("circle", "cut by the frame" if is_cut else "inside the frame"),
        ("noise", "> .3 px" if noise > 0.3 else "<= .3 px"),
    )
    truth = np.array(poses)
    if flip < 0:  # in the mirrored scene a board is seen from behind
        truth = np.diag([1.0, -1, 1, 1]) @ truth @ np.diag([1.0, 1, -1, 1])
    grid = image_grid(size, SCREEN).reshape(-1, 2)
    options = SolveOptions(reject_sigma=REJECT_SIGMA if outliers else None)
    return Case(words, seen, grid, lens.rays(grid), truth, options)


@dataclass(frozen=True, eq=False)
class _Lens:
    """A lens and its image."""

    shape: Shape
    half_rad: float
    focal_px: Array  # (2,)
    flip: float  # -1: the picture is mirrored
    middle_px: Array
    size: tuple[int, int]

    def shown(self, points: KnownPoints, pose: Array) -> tuple[Array, Rows]:
        """Pixels of the points that are seen, and which these are."""
        place = transform(pose, points.position_mm)
        normal = points.plane[points.face, :3] @ pose[:3, :3].T
        facing = -(place * normal).sum(axis=1) / np.linalg.norm(place, axis=1)
        across = np.hypot(place[:, 0], place[:, 1])
        theta = np.arctan2(across, place[:, 2])
        scale = self.focal_px * (self.shape.radius(theta) / across)[:, None]
        pixel = scale * place[:, :2] * (1, self.flip) + self.middle_px
        inside = ((pixel > 0) & (pixel < np.array(self.size) - 1)).all(axis=1)
        is_seen = inside & (theta < self.half_rad) & (theta >= np.radians(self.shape.least_deg)) & (facing > 0.25)
        rows = np.flatnonzero(is_seen)
        return pixel[rows], rows

    def rays(self, pixel: Array) -> Array:
        """Directions of pixels, of a mirrored picture those of the mirrored scene; nan outside of the circle."""
        offset = (pixel - self.middle_px) / self.focal_px
        angle = np.linspace(0, self.half_rad, 2000)
        length = np.linalg.norm(offset, axis=1)
        theta = np.interp(length, self.shape.radius(angle), angle, right=np.nan)
        return np.column_stack([np.sin(theta)[:, None] * offset / length[:, None], np.cos(theta)])


def _pose(points: KnownPoints, half_rad: float, least_rad: float, rng: np.random.Generator) -> Array:
    """The target somewhere in the field, turned to the camera but for a tilt."""
    span = float(np.ptp(points.position_mm, axis=0).max())
    theta, phi = rng.uniform(least_rad, half_rad), rng.uniform(0, 2 * np.pi)
    sight = np.array([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)])
    is_solid = bool(np.ptp(points.position_mm, axis=0).min() > 0.1 * span)
    away = span * np.exp(rng.uniform(np.log(0.4), np.log(4.0))) + (0.5 * span if is_solid else 0)
    tilt = exp_rotation(
        rng.uniform(0, np.radians(50)) * np.array([np.cos(a := rng.uniform(0, 2 * np.pi)), np.sin(a), 0])
    )
    turn = exp_rotation(np.array([0, 0, rng.uniform(-np.pi, np.pi)]))
    facing = np.array([[1.0, 0, 0], [0, -1, 0], [0, 0, -1]])
    look = rotation_between(np.array([[0.0, 0, 1]]), sight[None])[0]
    rotation = look @ tilt @ facing @ turn
    if is_solid:
        rotation = rotation @ exp_rotation(rng.normal(0, 2, 3))
    return make_pose(rotation, away * sight + rng.uniform(-0.2, 0.2, 3) * span)


@dataclass(frozen=True)
class Outcome:
    """Of a model on a case."""

    words: tuple[tuple[str, str], ...]
    is_found: bool
    lost_views: int
    seconds: float
    excess: float  # of the root mean square, over that from the truth
    note: str


def outcome(case: Case, model: str) -> Outcome:
    """Solved from nothing, and from the truth."""
    best_px, best_count = _from_truth(case, model)
    begin = time.perf_counter()
    try:
        solved = solve(case.seen, model, case.options)
    except InputError as error:
        return Outcome(case.words, False, case.seen.view_count, time.perf_counter() - begin, np.inf, str(error))
    seconds = time.perf_counter() - begin
    used = ~solved.is_outlier
    lost = case.seen.view_count - solved.observations.view_count
    rms = float(np.sqrt((solved.residual_px[used] ** 2).sum(axis=1).mean()))
    is_found = lost == 0 and rms <= best_px * (1 + WORSE) and used.sum() >= 0.998 * best_count
    note = f"{solved.status}, {rms:.4f} px of {used.sum()}; from the truth {best_px:.4f} px of {best_count}"
    return Outcome(case.words, is_found, lost, seconds, rms / best_px - 1, note)


def _from_truth(case: Case, model: str) -> tuple[float, int]:
    """Root mean square distance and number of what counts; infinite if even the truth leads nowhere."""
    seen, tie = case.seen, tie_parameters(model, case.options)
    problem = pack(seen, weighted=False)
    poses = np.array(case.cam_from_target)
    poses[:, :3, 3] += poses[:, :3, :3] @ problem.origin_mm
    try:
        camera = fit_rays(case.pixel, case.ray, seen.image_size, model).camera
        found = descend(problem, camera, poses, tie, case.options, None)
    except InputError:
        return np.inf, 0
    used = found.is_used
    if found.is_lost.any() or not used.any():
        return np.inf, 0
    residual = found.minimum.blocks.residual_px[:, used]
    return float(np.sqrt((residual**2).sum(axis=0).mean())), int(used.sum())


def table(outcomes: list[Outcome]) -> Iterator[str]:
    """Shares by what the cases are."""
    groups: dict[tuple[str, str], list[Outcome]] = defaultdict(list)
    for one in outcomes:
        for word in (("all", ""), *one.words):
            groups[word].append(one)
    for (what, which), of in sorted(groups.items()):
        share = sum(one.is_found for one in of) / len(of)
        seconds = np.array([one.seconds for one in of])
        yield (
            f"  {what + ' ' + which:32s} {len(of):4d} cases: optimum {100 * share:5.1f} %, "
            f"views lost in {sum(one.lost_views > 0 for one in of):3d}, "
            f"{1e3 * np.median(seconds):6.0f} ms (at most {1e3 * seconds.max():.0f})"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=CASES, help=f"how many (default {CASES})")
    parser.add_argument("--first", type=int, default=0, help="seed of the first case")
    parser.add_argument("--models", default="", help="some models only, such as fisheye,ds")
    parser.add_argument("--failures", action="store_true", help="print the cases without the optimum")
    asked = parser.parse_args()
    wide = [model for model in fitted_models() if ABILITIES[model].is_wide]
    for model in asked.models.split(",") if asked.models else wide:
        outcome(draw(0), model)  # compile
        outcomes = []
        for seed in range(asked.first, asked.first + asked.cases):
            one = outcome(draw(seed), model)
            outcomes.append(one)
            if asked.failures and not one.is_found:
                print(f"    case {seed}: {', '.join(word for _, word in one.words)}: {one.note[:160]}", flush=True)
        print(model)
        print("\n".join(table(outcomes)), flush=True)


if __name__ == "__main__":
    main()
