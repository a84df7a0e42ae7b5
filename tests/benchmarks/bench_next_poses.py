"""What the proposed next poses of a robot give, and whether turntables that wobble end at their minimum.

Run from the repository's root: `python -m tests.benchmarks.bench_next_poses [poses] [tables] [--draws N]`.

*poses*: simulated robots of two qualities, camera in hand and target in hand, 12 photos of a board, the lens kept or
solved, the robot's noise given or estimated. Told are solved sigmas with photos from the proposed poses over those
that were promised, and the place's sigma with as many poses, drawn from all that were tried, over that.
*tables*: simulated turntables, angles given and solved, the lens solved: mean squares of the errors of the axis'
direction and place in what is stated, 1 if that is honest.
"""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from calib.core.se3 import exp_rotation, invert, look_at, make_pose, skew
from calib.core.types import keep_frames
from calib.judge.halves import NoHalves
from calib.judge.next_frames import some_points
from calib.judge.next_robot_poses import _candidates, next_robot_poses
from calib.rigs.carrier import turned_by
from calib.rigs.problem import FREE_SIZE, CameraChoice, Mechanism, RigOptions
from calib.rigs.relative import center_sigma_mm
from calib.rigs.result import RigCalibration
from calib.rigs.solve import solve_rig
from designer.base.arrays import Array
from tests.benchmarks.bench_hand_eye import IN_HAND, ROBOTS
from tests.support import rig_views, solver_scenes

PHOTOS, NOISE_PX = 12, 0.05


@dataclass(frozen=True, eq=False)
class Arm:
    """A robot as it truly is."""

    kind: str
    cam_from_rig: Array
    carrier_from_target: Array
    base_from_flange: Array  # (V, 4, 4) where it was sent
    noise: tuple[float, float]  # rad, mm

    def solved(self, sent: Array, rng: np.random.Generator, *, is_free: bool, is_given: bool) -> RigCalibration:
        """By photos from poses that it was sent to."""
        in_hand = self.kind == IN_HAND[0]
        told = invert(sent) if in_hand else sent
        size = (len(sent), 3)
        off = make_pose(exp_rotation(rng.normal(0, self.noise[0], size)), rng.normal(0, self.noise[1], size))
        frames = off @ told if in_hand else told @ off
        poses, lens = self.cam_from_rig @ frames @ self.carrier_from_target, rig_views.camera()
        board = solver_scenes.board(9, 7, 20.0)
        scene = rig_views.scene_of(("cam",), (lens,), np.eye(4)[None], poses, board, rng, NOISE_PX)
        rows = scene.observations.frame[0]
        seen = keep_frames(scene.observations, np.isin(np.arange(len(sent)), rows))
        sigma = self.noise if is_given else (None, None)
        carrier = Mechanism(
            self.kind,
            told[rows],
            is_camera_in_hand=in_hand,
            sigma_rad=sigma[0],
            sigma_mm=sigma[1],
            size_sigma=FREE_SIZE,
        )
        choice = CameraChoice("opencv") if is_free else CameraChoice("opencv", given=lens, is_refined=False)
        return solve_rig(seen, [choice], RigOptions(carrier=carrier, allows_offsets=not is_given))


def arm(seed: int, kind: str, noise: tuple[float, float]) -> Arm:
    """A robot that turns the camera, or the target, at random."""
    rng = np.random.default_rng(seed)
    turn, shift = rng.uniform(-0.5, 0.5, (PHOTOS, 3)), rng.uniform(-60, 60, (PHOTOS, 3))
    first = look_at(np.array([0.0, -500.0, 0.0]), np.zeros(3)) @ make_pose(
        exp_rotation(np.array([1.5, 0.0, 0.0])), np.zeros(3)
    )
    x = make_pose(exp_rotation(rng.normal(0, 0.5, 3)), rng.uniform(-60, 60, 3))
    z = make_pose(exp_rotation(rng.normal(0, 0.5, 3)), rng.uniform(-300, 300, 3))
    carried = invert(x) @ make_pose(exp_rotation(turn), shift) @ first @ invert(z)
    return Arm(kind, x, z, invert(carried) if kind == IN_HAND[0] else carried, noise)


def sigmas(found: RigCalibration) -> Array:
    """Of the camera's direction and its place: rad, mm."""
    turn = np.sqrt(np.diagonal(found.covariance)[found.rig.pose_rows(0)][:3].max())
    return np.array([turn, center_sigma_mm(found.rig)[0].max()])


def print_poses(draws: int) -> None:
    """Promised, solved, and by poses at random."""
    for is_given in (True, False):
        kept, random = [], []
        cases = product(IN_HAND, ROBOTS.values(), (True, False), range(draws))
        for kind, noise, is_free, draw in cases:
            one, rng = arm(draw, kind, noise), np.random.default_rng([3, draw])
            found = one.solved(one.base_from_flange, rng, is_free=is_free, is_given=is_given)
            poses = next_robot_poses(found, NoHalves("not compared"))
            assert found.carrier is not None
            reach = _candidates(found, found.carrier, some_points(found)).base_from_flange
            drawn = reach[rng.choice(len(reach), len(poses), replace=False)]
            proposed = np.stack([pose.base_from_flange for pose in poses])
            ours, others = (
                sigmas(
                    one.solved(np.concatenate([one.base_from_flange, more]), rng, is_free=is_free, is_given=is_given)
                )
                for more in (proposed, drawn)
            )
            kept.append(ours / [poses[-1].turn_sigma_rad_after, poses[-1].place_sigma_mm_after])
            random.append(others / ours)
        low, high = np.min(kept), np.max(kept)
        middle, most = (np.percentile(np.array(random)[:, 1], part) for part in (50, 95))
        print(
            f"poses, robot's noise {'given' if is_given else 'estimated'}, {len(kept)} robots: solved over promised "
            f"{low:.2f} to {high:.2f}; place with poses at random over that with those proposed: median {middle:.2f}, "
            f"{np.percentile(np.array(random)[:, 1], 5):.2f} to {most:.2f} of 90 %"
        )


def table_errors(seed: int, *, are_free: bool) -> tuple[Array, int]:
    """Squares of the errors of an axis' direction and place, in what is stated, and steps; nan: not converged."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(10, 25))
    angle = np.sort(rng.uniform(0, 2 * np.pi, count))
    is_solid = rng.random() < 0.5
    points = solver_scenes.icosahedron(100.0, 5) if is_solid else solver_scenes.board(9, 7, 20.0)
    held = make_pose(exp_rotation(rng.normal(0, 0.4, 3)), np.append(rng.uniform(-40, 40, 2), 0.0))
    above = rng.uniform(0.1, 1.2) if is_solid else rng.uniform(0.5, 1.4)
    true = look_at(500 * np.array([np.cos(above), 0.0, np.sin(above)]), np.zeros(3))
    wobble = float(rng.choice([0.0, 1e-4, 1e-3]))
    off = make_pose(exp_rotation(rng.normal(0, wobble, (count, 3))), rng.normal(0, 100 * wobble, (count, 3)))
    noise_px = float(rng.choice([0.02, 0.1, 0.3]))
    poses = true @ turned_by(angle) @ off @ held
    scene = rig_views.scene_of(("cam",), (rig_views.camera(),), np.eye(4)[None], poses, points, rng, noise_px)
    rows = scene.observations.frame[0]
    seen = keep_frames(scene.observations, np.isin(np.arange(count), rows))
    carrier = Mechanism("turntable", turned_by(angle[rows]), is_turntable=True, has_free_angles=are_free)
    found = solve_rig(seen, [CameraChoice("opencv")], RigOptions(carrier=carrier))
    if found.status != "converged":
        return np.full(2, np.nan), found.iterations
    axis, place = found.cam_from_rig[0, :3, 2], found.cam_from_rig[0, :3, 3]
    covariance = found.covariance[found.rig.pose_rows(0), found.rig.pose_rows(0)]
    across = np.linalg.svd(axis[None])[2][1:]
    along = true[:3, 2] * np.sign(axis @ true[:3, 2])
    by_turn = across @ skew(axis)
    level = true[:3, 3] + axis @ (place - true[:3, 3]) / (axis @ along) * along
    steps = (
        (across @ (along - axis), by_turn @ covariance[:3, :3] @ by_turn.T),
        (across @ (level - place), across @ covariance[3:, 3:] @ across.T),
    )
    return np.array([step @ np.linalg.solve(own, step) for step, own in steps]), found.iterations


def print_tables(draws: int) -> None:
    """Coverage and steps."""
    for are_free in (False, True):
        found = [table_errors(100 + draw, are_free=are_free) for draw in range(draws)]
        square = np.array([one[0] for one in found])
        print(
            f"tables, angles {'solved' if are_free else 'given'}: {np.isfinite(square[:, 0]).sum()} of {draws} "
            f"converged, after {max(one[1] for one in found)} steps at most; mean squares of direction and place over "
            f"stated {np.nanmean(square[:, 0]) / 2:.2f}, {np.nanmean(square[:, 1]) / 2:.2f}"
        )


def main(arguments: Sequence[str] | None = None) -> None:
    """What is asked for, all by default."""
    parser = argparse.ArgumentParser()
    parser.add_argument("parts", nargs="*", default=["poses", "tables"], metavar="PART")
    parser.add_argument("--draws", type=int, default=0, help="robots of a case, or tables (default: 4, 30)")
    asked = parser.parse_args(arguments)
    if "poses" in asked.parts:
        print_poses(asked.draws or 4)
    if "tables" in asked.parts:
        print_tables(asked.draws or 30)


if __name__ == "__main__":
    main()
