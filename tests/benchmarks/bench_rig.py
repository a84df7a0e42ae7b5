"""Rigs of cameras against what they truly are: coverage, bounds, time, order, delays, and lengths in millimetres.

Run from the repository's root: `python -m tests.benchmarks.bench_rig [PART ...] [--rigs N]`; the parts are ring,
others, large, order, delays and pair, all by default. Goals stand beside the figures.

*ring*: the template `ring-of-eight` around an icosahedron, and around a board of equal size, in simulated photos:
normal noise, as our detector has it, on every ring within an image. Each of N rigs stands a little differently, and its
target is held anew. Told are how many rings two neighbours share of those that either sees, how often the 95 %
ellipsoid of a camera's place holds the truth, errors of baselines in sigmas, and the error of the farthest pair
against the Cramer-Rao bound, from a dense design matrix at the truth (`tests.support.rig_views`), which no code of the
solver makes.
*others*: coverage of the other templates, and with few frames.
*large*: 4 cameras, 1,500 frames, 300 rings a photo, fisheyes and pinholes, solved from nothing.
*order*: the same rig with cameras and frames shuffled.
*delays*: a moving target, each camera at its own time.
*pair*: rendered photos of a stereo pair, detected and solved; then a second target as a check object, at 1, 2 and 4 m.
"""

import argparse
import resource
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

import calib
import calib.rigs.adjust
from calib.app.render import render_rig
from calib.cameras.camera import camera_or_preset
from calib.cameras.rig import Rig
from calib.core.se3 import compose, exp_rotation, invert, look_at, make_pose, skew
from calib.core.types import Observations, RigObservations
from calib.observe.observations import known_points
from calib.renderer.held_target import held_poses
from calib.renderer.options import RenderOptions
from calib.renderer.rig_template import HeldTarget, SimulatedRig, read_simulated_rig
from calib.rigs.problem import CameraChoice, RigOptions
from calib.rigs.result import RigCalibration
from calib.rigs.solve import solve_rig
from designer.base.arrays import Array, Rows
from designer.base.errors import InputError
from designer.kinds.layout import lay_out
from designer.kinds.sizing import size_job
from designer.target import TargetGeometry
from tests.support import rig_views
from tests.support.designs import asked_for
from tests.support.rig_views import RigScene, scene_of

NOISE_PX = 0.04
FRAMES = 30
CHI2_3_95 = 7.815
FAR = 4
"""The camera across the ring from the first."""
SHIFT_MM, TURN_RAD = 15.0, 0.03
"""By which simulated rigs differ from the template and from each other."""


def target(kind: str, **values: object) -> TargetGeometry:
    """A target as `design` makes it."""
    return lay_out(size_job(asked_for(kind, values)).job.target)


def simulated(
    rig: str | SimulatedRig, shown: TargetGeometry, rng: np.random.Generator, frames: int = FRAMES
) -> RigScene:
    """A rig like another, or like that of a template, and what it sees of a target."""
    found = read_simulated_rig(rig) if isinstance(rig, str) else rig
    if found.held is None:
        raise ValueError(f"{found.name}: no target is held before it")
    count = len(found.rig.names)
    step = make_pose(exp_rotation(rng.normal(0, TURN_RAD, (count, 3))), rng.normal(0, SHIFT_MM, (count, 3)))
    pose = compose(step, found.rig.cam_from_rig)
    true = replace(found.rig, cam_from_rig=pose @ invert(pose[0]))
    held = held_poses(true, shown, found.held, frames, rng)
    return scene_of(true.names, true.cameras, true.cam_from_rig, held, known_points(shown), rng, NOISE_PX)


def solved(scene: RigScene) -> RigCalibration:
    """The rig from nothing."""
    return solve_rig(scene.observations, [CameraChoice(one.model) for one in scene.cameras])


def place_derivative(cam_from_rig: Array) -> Array:
    """Of a camera's place in the rig's frame by the six of its pose.  # (3, 6)"""
    rotation, shift = cam_from_rig[:3, :3], cam_from_rig[:3, 3]
    return -rotation.T @ np.hstack([skew(shift), np.eye(3)])


def place_covariance(found: RigCalibration) -> Array:
    """Of all cameras' places in the rig's frame.  # (C, 3, C, 3)"""
    rig = found.rig
    rows = np.concatenate([np.r_[rig.pose_rows(number)] for number in range(len(rig.names))])
    count = len(rig.names)
    pose = found.covariance[np.ix_(rows, rows)].reshape(count, 6, count, 6)
    by_pose = np.stack([place_derivative(one) for one in found.cam_from_rig])
    return np.einsum("aip,apbq,bjq->aibj", by_pose, pose, by_pose)


@dataclass(frozen=True, eq=False)
class RingErrors:
    """Of one simulated ring."""

    is_inside: Array  # (C - 1,) whether the 95 % ellipsoid of a camera's place holds the truth
    baseline: Array  # (B,) error in sigmas
    far_mm: float  # of the farthest pair
    far_bound_mm: float


def ring_errors(scene: RigScene, *, with_bound: bool) -> RingErrors:
    """What is wrong with one solution, and what it says of it."""
    found = solved(scene)
    covariance = place_covariance(found)
    place, true = found.rig.center_mm, invert(scene.cam_from_rig)[:, :3, 3]
    error = place - true
    count = len(place)
    square = [float(error[c] @ np.linalg.solve(covariance[c, :, c], error[c])) for c in range(1, count)]
    first, second = np.triu_indices(count, 1)
    way = true[second] - true[first]
    length = np.linalg.norm(way, axis=1)
    unit = way / length[:, None]
    between = [covariance[a, :, a] + covariance[b, :, b] - covariance[a, :, b] - covariance[b, :, a]
               for a, b in zip(first, second, strict=True)]  # fmt: skip
    sigma = np.sqrt(np.einsum("bi,bij,bj->b", unit, np.array(between), unit))
    baseline = (np.linalg.norm(place[second] - place[first], axis=1) - length) / sigma
    bound = far_bound_mm(scene) if with_bound else np.nan
    return RingErrors(np.array(square) < CHI2_3_95, baseline, float(np.linalg.norm(error[min(FAR, count - 1)])), bound)


def far_bound_mm(scene: RigScene) -> float:
    """The least error of an unbiased estimate of where the farthest camera is: by dense equations at the truth."""
    exact = rig_views.solved_slowly(scene, steps=0)
    rig = exact.rig
    rows = rig.pose_rows(FAR)
    by_pose = place_derivative(scene.cam_from_rig[FAR])
    # The dense solution states its covariance by what is left over; at the truth that is the noise.
    return float(np.sqrt(np.trace(by_pose @ exact.covariance[rows, rows] @ by_pose.T)))


def shared_share(scene: RigScene) -> float:
    """Of the rings that either of two neighbours sees in a frame, those that both see."""
    both = either = 0
    seen = scene.observations
    keys = [set(zip(seen.frame[c][one.view].tolist(), one.point.tolist(), strict=True))
            for c, one in enumerate(seen.sightings)]  # fmt: skip
    for number, one in enumerate(keys):
        other = keys[(number + 1) % len(keys)]
        both, either = both + len(one & other), either + len(one | other)
    return both / either


def print_ring(rigs: int) -> None:
    """The ring of eight with a solid, and with a board of equal size."""
    print(f"ring of eight, {FRAMES} frames, {NOISE_PX} px, {rigs} simulated rigs, of the board a fifth")
    shown = {
        "icosahedron, edge 100 mm": target("ico", edge="100mm"),
        "board, 190 x 190 mm": target("board", size="190x190mm"),
    }
    rows: list[tuple[str, str, list[str]]] = []
    for number, one in enumerate(shown.values()):
        count = rigs if number == 0 else max(rigs // 5, 1)
        begin, errors, shares, frames, failed = time.perf_counter(), [], [], [], 0
        for rig in range(count):
            scene = simulated("ring-of-eight", one, np.random.default_rng([number, rig]))
            shares.append(shared_share(scene) if rig < 3 else np.nan)
            together = scene.observations.shared
            frames.append((np.diagonal(together).mean(), together[0, FAR]))
            try:
                errors.append(ring_errors(scene, with_bound=rig % 10 == 0))
            except Exception as error:
                failed += 1
                print(f"  rig {rig}: {type(error).__name__}: {error}")
        bound = np.array([e.far_bound_mm for e in errors])
        far = np.array([e.far_mm for e in errors])
        known = np.isfinite(bound)
        inside = np.concatenate([e.is_inside for e in errors])
        baseline = np.concatenate([e.baseline for e in errors])
        seconds = (time.perf_counter() - begin) / count
        figures = [
            ("rigs with every camera placed", f"{count - failed} of {count}", "all"),
            ("neighbours share of their rings", f"{100 * np.nanmean(shares):.0f} %", ""),
            ("frames a camera, and shared by the farthest pair", "{:.1f}, {:.1f}".format(*np.mean(frames, axis=0)), ""),
            ("truth within the 95 % ellipsoids of places", f"{100 * inside.mean():.1f} %", "93-97 %"),
            ("baselines' errors in sigmas, RMS", f"{np.sqrt((baseline**2).mean()):.3f}", "1"),
            ("baselines within 2 sigmas", f"{100 * (np.abs(baseline) < 2).mean():.1f} %", "95.4 %"),
            ("farthest pair: RMS error", f"{1e3 * np.sqrt((far**2).mean()):.1f} um", ""),
            ("farthest pair: Cramer-Rao bound", f"{1e3 * np.sqrt((bound[known] ** 2).mean()):.1f} um", ""),
            ("farthest pair: error over bound", f"{np.sqrt((far**2).mean() / (bound[known] ** 2).mean()):.2f}", "<= 3"),
            ("time of a rig, simulation included", f"{seconds:.2f} s", ""),
        ]
        rows = rows or [(name, goal, []) for name, _, goal in figures]
        for row, (_, value, _) in zip(rows, figures, strict=True):
            row[2].append(value)
    print(f"{'':50}" + "".join(f"{name:>27}" for name in shown) + f"{'goal':>10}")
    for name, goal, values in rows:
        print(f"{name:50}" + "".join(f"{value:>27}" for value in values) + f"{goal:>10}")


def facing_pair() -> SimulatedRig:
    """Two cameras that look at each other."""
    lens, eye = camera_or_preset("machine-vision"), np.array([[600.0, 0, 0], [-600.0, 0, 0]])
    pose = look_at(eye, np.zeros((2, 3)))
    rig = Rig(("one", "other"), (lens, lens), pose @ invert(pose[0]))
    return SimulatedRig("facing", "two cameras that face each other", "", rig, HeldTarget((500.0, 700.0)))


def print_others(rigs: int) -> None:
    """The other templates, and few frames."""
    ico, large = target("ico", edge="100mm", rings_per_side=5), target("ico", edge="130mm", rings_per_side=5)
    board, pair, fisheyes = target("board", size="190x190mm"), "stereo-pair", "back-to-back-fisheyes"
    cases: tuple[tuple[str | SimulatedRig, str, TargetGeometry, int], ...] = (
        (pair, "icosahedron", ico, 30), (pair, "board", board, 30), (pair, "board", board, 6),
        (fisheyes, "icosahedron", ico, 30), (fisheyes, "icosahedron", ico, 8), (fisheyes, "board", board, 30),
        ("four-webcams", "large icosahedron", large, 30), ("ring-of-eight", "icosahedron", ico, 6),
        (facing_pair(), "icosahedron", ico, 30), (facing_pair(), "board", board, 30),
    )  # fmt: skip
    print(f"other rigs, {NOISE_PX} px, {rigs} simulated of each; truth within the 95 % ellipsoids (goal 93-97 %)")
    for number, (rig, words, shown, frames) in enumerate(cases):
        name = rig if isinstance(rig, str) else rig.title
        errors = []
        for seed in range(rigs):
            scene = simulated(rig, shown, np.random.default_rng([10 + number, seed]), frames)
            with suppress(InputError):  # frames may leave cameras apart, and that is said
                errors.append(ring_errors(scene, with_bound=False))
        print(f"  {name}, {words}, {frames} frames: {len(errors)} of {rigs} solved", end="")
        if not errors:
            print()
            continue
        inside = np.concatenate([one.is_inside for one in errors])
        baseline = np.concatenate([one.baseline for one in errors])
        far_um = 1e3 * np.sqrt(np.mean([one.far_mm**2 for one in errors]))
        print(f"; {100 * inside.mean():.1f} %; baselines in sigmas, RMS {np.sqrt((baseline**2).mean()):.2f}; "
              f"RMS error of the last {far_um:.1f} um")  # fmt: skip


@contextmanager
def phases_told(*names: str) -> Iterator[None]:
    """Say how long functions of the solver take."""
    module = calib.rigs.adjust
    originals = {name: getattr(module, name) for name in names}
    spent = dict.fromkeys(names, 0.0)

    def watched(name: str, function: Callable[..., object]) -> Callable[..., object]:
        def call(*values: object, **named: object) -> object:
            begin = time.perf_counter()
            try:
                return function(*values, **named)
            finally:
                spent[name] += time.perf_counter() - begin

        return call

    try:
        for name, function in originals.items():
            setattr(module, name, watched(name, function))
        yield
    finally:
        for name, function in originals.items():
            setattr(module, name, function)
        print("  " + ", ".join(f"{name.strip('_')} {seconds:.2f} s" for name, seconds in spent.items()))


def print_large(frames: int = 1500) -> None:
    """Fisheyes and pinholes around an icosahedron, in very many frames."""
    rng = np.random.default_rng(0)
    models = ("fisheye-190", "machine-vision") * 2
    angle = np.arange(4) * np.pi / 2
    radius = np.array([300.0, 550.0, 300.0, 550.0])
    eye = radius[:, None] * np.stack([np.cos(angle), np.sin(angle), np.full(4, 0.2)], axis=1)
    turn = exp_rotation(rng.normal(0, 2.0, (frames, 3)))
    held = make_pose(turn, rng.uniform(-110, 110, (frames, 3)))
    scene = scene_of(
        ("a", "b", "c", "d"), tuple(camera_or_preset(name) for name in models), look_at(eye, np.zeros((4, 3))), held,
        known_points(target("ico", edge="100mm")), rng, NOISE_PX,
    )  # fmt: skip
    sightings = [len(one.view) for one in scene.observations.sightings]
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    print(
        f"large: 4 cameras ({', '.join(one.model for one in scene.cameras)}), {frames} frames, {sum(sightings)} rings"
    )
    for run in ("with compilation or its cache", "again"):
        begin = time.perf_counter()
        with phases_told("start_rig", "_down", "_calibration"):
            found = solved(scene)
        seconds = time.perf_counter() - begin
        most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
        print(f"  {run}: {found.status}, {found.iterations} steps, {seconds:.1f} s (goal 10 s), at most {most:.2f} GB "
              f"(goal 1 GB), {before:.2f} GB before")  # fmt: skip


def shuffled(observations: RigObservations, rng: np.random.Generator) -> tuple[RigObservations, Array, Array]:
    """The same sightings, cameras and frames in another order; where each camera and each frame was."""
    cameras = np.concatenate([[0], 1 + rng.permutation(observations.camera_count - 1)])
    frames = rng.permutation(observations.frame_count)
    number = np.argsort(frames)
    sightings, rows = [], []
    for camera in cameras.tolist():
        new = number[observations.frame[camera]]
        order = np.argsort(new)
        rows.append(new[order])
        sightings.append(_reordered(observations.sightings[camera], order))
    return (
        replace(
            observations, camera_names=tuple(observations.camera_names[c] for c in cameras.tolist()),
            frame_names=tuple(observations.frame_names[f] for f in frames.tolist()), sightings=tuple(sightings),
            frame=tuple(rows),
        ),
        cameras, frames,
    )  # fmt: skip


def _reordered(seen: Observations, order: Rows) -> Observations:
    """Views in another order."""
    place = np.argsort(order)
    rows = np.argsort(place[seen.view], kind="stable")
    return replace(
        seen, view_names=tuple(seen.view_names[v] for v in order.tolist()), view=place[seen.view][rows],
        point=seen.point[rows], center_px=seen.center_px[rows],
        cov_px2=None if seen.cov_px2 is None else seen.cov_px2[rows],
    )  # fmt: skip


def print_order() -> None:
    """The same answer from any order."""
    shown = target("ico", edge="100mm", rings_per_side=5)
    for name in ("ring-of-eight", "back-to-back-fisheyes"):
        scene = simulated(name, shown, np.random.default_rng(5))
        found, worst = solved(scene), 0.0
        for seed in range(3):
            seen, cameras, _ = shuffled(scene.observations, np.random.default_rng(seed))
            other = solve_rig(seen, [CameraChoice(scene.cameras[c].model) for c in cameras.tolist()])
            back = np.argsort(cameras)
            sigma = np.sqrt(np.einsum("aiai->ai", place_covariance(found))[1:])
            apart = np.abs(other.rig.center_mm[back] - found.rig.center_mm)[1:]
            worst = max(worst, float((apart / sigma).max()))
        print(f"order: {name}, cameras and frames shuffled: places differ by {worst:.1e} sigma (goal 1e-6)")


def print_delays(rigs: int) -> None:
    """Delays of cameras' clocks, from a target in motion."""
    shown = target("ico", edge="100mm", rings_per_side=5)
    for name in ("stereo-pair", "ring-of-eight"):
        late, stated = [], []
        for seed in range(rigs):
            moving = render_rig(shown, name, frames=60, unsynchronised_s=0.03, seed=seed)
            found = solve_rig(
                rig_views.seen_by_all(
                    moving.rig.names, moving.rig.cameras, moving.rig.cam_from_rig[:, None] @ moving.held.as_seen,
                    known_points(shown), np.random.default_rng(seed), NOISE_PX, moving.held.stamp_s,
                ),
                [CameraChoice(one.model) for one in moving.rig.cameras], RigOptions(estimates_delays=True),
            )  # fmt: skip
            if found.delay_s is None or found.delay_sigma_s is None or moving.rig.delay_s is None:
                raise ValueError("no delays")
            late.append((found.delay_s - moving.rig.delay_s)[1:])
            stated.append(found.delay_sigma_s[1:])
        error, sigma = np.concatenate(late), np.concatenate(stated)
        print(
            f"delays: {name}, up to 30 ms, 60 frames at 10 Hz and 150 mm/s, {rigs} rigs: RMS error "
            f"{1e6 * np.sqrt((error**2).mean()):.0f} us, in sigmas {np.sqrt(((error / sigma) ** 2).mean()):.2f} "
            f"(goal 1), within 2 sigmas {100 * (np.abs(error) < 2 * sigma).mean():.0f} %"
        )


CALIBRATED_IN, CHECKED_IN = 16, 4
"""Frames."""
CHECKED_MM = (1000.0, 2000.0, 4000.0)
LIGHT = RenderOptions(blur_px=0.7, contrast_to_noise=40)


def print_pair() -> None:
    """A rendered stereo pair measures a board that it was not calibrated with."""
    shown = target("ico", edge="100mm")
    check = target("board", size="400x400mm", pitch="36mm", ring_diameter="24mm")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        photos = render_rig(shown, "stereo-pair", frames=CALIBRATED_IN, options=LIGHT)
        photos.save(folder / "seen", jobs=None)
        found = calib.rig(shown, [folder / "seen"], reference="left")
        error = found.rig.center_mm[found.rig.row("right")] - photos.rig.center_mm[1]
        lenses = dict(zip(found.rig.names, found.rig.cameras, strict=True))
        print(
            f"pair: {CALIBRATED_IN} rendered frames, verdict {found.verdict.grade}, right camera off by "
            f"{1e3 * np.linalg.norm(error):.2f} um; then a board of 400 mm, {CHECKED_IN} frames at each distance"
        )
        for away_mm in CHECKED_MM:
            place = folder / f"{away_mm:.0f}"
            render_rig(check, photos.rig, frames=CHECKED_IN, distance_mm=away_mm, options=LIGHT, seed=7).save(
                place, jobs=None
            )
            seen = calib.rig(check, [place], cameras=lenses, reference="left").calibration.observations
            lengths = calib.triangulate(found.rig, seen).lengths
            if lengths is None:
                raise ValueError("no lengths")
            print(
                f"  {away_mm / 1000:.0f} m: {lengths.pairs} lengths, RMS error {lengths.rms_mm:.4f} mm, expected "
                f"{lengths.expected_mm:.4f} mm ({lengths.expected_by_noise_mm:.4f} by noise alone), within their 95 %: "
                f"{100 * lengths.within_95:.1f} % (goal 95), errors in sigmas {lengths.ratio:.2f}, scale "
                f"{1e6 * lengths.scale:.0f} +- {1e6 * lengths.scale_sigma:.0f} ppm"
            )


PARTS: dict[str, Callable[[int], None]] = {
    "ring": print_ring,
    "others": lambda rigs: print_others(rigs // 2),
    "large": lambda rigs: print_large(),
    "order": lambda rigs: print_order(),
    "pair": lambda rigs: print_pair(),
    "delays": lambda rigs: print_delays(max(rigs // 20, 2)),
}


def main(words: Sequence[str] | None = None) -> None:
    """All parts, or some."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("parts", nargs="*", choices=[*PARTS, []], default=list(PARTS))
    parser.add_argument("--rigs", type=int, default=200)
    asked = parser.parse_args(words)
    for part in asked.parts or PARTS:
        PARTS[part](asked.rigs)


if __name__ == "__main__":
    main()
