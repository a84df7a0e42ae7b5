"""The joint adjustment of a rig: its equations, its minimum, its sigmas, and what it does when photos contradict."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from calib.cameras import parameter_names, project
from calib.core.se3 import exp_rotation, invert, look_at, make_pose, skew, steps_between, transform
from calib.core.types import RigObservations, keep_frames, keep_views
from calib.judge.joint_halves import half_solver
from calib.rigs.accuracy import motion_covariance, shared_inverse
from calib.rigs.carrier import turned_by
from calib.rigs.descend import assembled, descend_rig, rig_equations
from calib.rigs.motion import Motion
from calib.rigs.problem import (
    FREE_SIZE,
    CameraChoice,
    Mechanism,
    OffsetPrior,
    RigOptions,
    RigProblem,
    RigState,
    pack_rig,
    without_params,
)
from calib.rigs.result import RigCalibration
from calib.rigs.rig_start import start_rig
from calib.rigs.solve import solve_rig
from calib.rigs.start import solve_alone
from calib.solver.in_space import in_space
from calib.solver.levenberg import DescentSteps, move_poses
from calib.solver.problem import SolveOptions
from calib.solver.solve import solve
from calib.space.propagate import of_rows
from calib.space.triangulate import triangulate_points
from designer.base.arrays import Array, Flags
from designer.base.errors import InputError
from tests.support import rig_views, solver_scenes


def choices(scene: rig_views.RigScene) -> list[CameraChoice]:
    """Each camera by the model that it has."""
    return [CameraChoice(camera.model) for camera in scene.cameras]


def moved(state: RigState, problem: RigProblem, step: Array) -> RigState:
    """The state after a step of the shared unknowns, then of the frames, the simplest way."""
    shared, frames = np.append(step[: problem.shared_count], 0.0), step[problem.shared_count :].reshape(-1, 6)
    cameras = tuple(
        replace(camera, params=camera.params + shared[one.params])
        for camera, one in zip(state.cameras, problem.seen, strict=True)
    )
    cam = np.concatenate(
        [move_poses(state.cam_from_rig[c : c + 1], shared[one.pose][None]) for c, one in enumerate(problem.seen)]
    )
    target = state.carrier_from_target
    if problem.prior is not None:
        target = move_poses(target[None], shared[problem.prior.column][None])[0]
    return replace(
        state, cameras=cameras, cam_from_rig=cam, rig_from_target=move_poses(state.rig_from_target, frames),
        delay_s=state.delay_s + np.array([shared[one.delay[0]] for one in problem.seen]), carrier_from_target=target,
        amount=state.amount + shared[problem.amount],
    )  # fmt: skip


@pytest.mark.parametrize(
    "kind", ["plain", "delays", "camera in hand", "target in hand", "slack", "in the planes, in hand", "bent, in hand"]
)
def test_gradients_are_those_of_the_cost(kind: str) -> None:
    """The cost's derivative by every unknown is the equations' own: chains, delays, carriers, size, planes, bend."""
    is_bent = kind.startswith("bent")
    points = solver_scenes.board(9, 7) if is_bent else None
    scene = rig_views.ring(points, count=2, frames=5, noise_px=0.5)
    frames = scene.observations.frame_count
    rng = np.random.default_rng(3)
    base = make_pose(exp_rotation(rng.normal(0, 0.5, (frames, 3))), rng.normal(0, 200.0, (frames, 3)))
    carrier = Mechanism("robot", base, is_camera_in_hand=kind != "target in hand", size_sigma=FREE_SIZE)
    carried = kind.endswith("in hand")
    observations = replace(
        scene.observations, time_s=tuple(0.1 * rows + 0.01 * c for c, rows in enumerate(scene.observations.frame))
    )
    ties = [np.arange(len(camera.params)) for camera in scene.cameras]
    options = RigOptions(
        estimates_delays=kind == "delays", carrier=carrier if carried else None, free_bend=is_bent,
        bend_sigma_mm=(0.1,) * 5,
    )  # fmt: skip
    problem = pack_rig(observations, ties, [not carried, False], np.ones(2), options)
    if kind.startswith("in the planes"):
        spaced = [
            replace(one, problem=in_space(one.problem, "intersection", own.points, own.point))
            for one, own in zip(problem.seen, observations.sightings, strict=True)
        ]
        problem = replace(problem, seen=tuple(spaced))
    amount = problem.seen[0].problem.amount + (0.05 if is_bent else 0.0)
    state = RigState(
        scene.cameras, scene.cam_from_rig, scene.rig_from_target, np.array([0.0, 0.02]), base[0], amount=amount
    )
    if kind == "delays":
        way = rng.normal(0, 1.0, (2, frames, 6))
        problem = replace(problem, motion=Motion(np.arange(frames), way, np.ones(6), np.ones(6), np.ones(6)))
    if problem.prior is not None:
        problem = replace(problem, prior=replace(problem.prior, sigma=np.array([0.5, 100.0])))
    if kind == "slack":
        own = [one.products[:, -7:-1, -7:-1] for one in rig_equations(problem, state, "squares").blocks]
        problem = replace(problem, slack=tuple(OffsetPrior(weight, 4.0) for weight in own))
        state = replace(state, slack=tuple(rng.normal(0, 1e-3, (len(weight), 6)) for weight in own))
    equations = rig_equations(problem, state, "squares")
    given = assembled(replace(problem, slack=()), state, equations.blocks, equations.chains).normal
    gradient = np.concatenate([given.other[:, -1], given.pose_row[:, :, -1].ravel()])
    for row in range(len(gradient)):
        step = np.zeros(len(gradient))
        step[row] = 1e-6
        cost = [rig_equations(problem, moved(state, problem, sign * step), "squares").normal.cost for sign in (1, -1)]
        assert (cost[0] - cost[1]) / 4e-6 == pytest.approx(gradient[row], rel=1e-4, abs=1e-4 * abs(gradient).mean())


@pytest.mark.parametrize("scene", [rig_views.stereo_pair(), rig_views.ring(models=("opencv", "fisheye"))])
def test_minimum_and_covariance_are_those_of_dense_least_squares(scene: rig_views.RigScene) -> None:
    """A slow solution by one dense matrix, from the truth, ends at the same rig and states the same sigmas."""
    found, slow = solve_rig(scene.observations, choices(scene)), rig_views.solved_slowly(scene)
    sigma = np.sqrt(np.diagonal(slow.covariance))
    for camera in range(1, len(scene.cameras)):
        rows = slow.rig.pose_rows(camera)
        # Noise of each camera is estimated on its own, so that weights differ by a percent.
        assert (np.abs(_off(found, slow.cam_from_rig, camera)) < 0.2 * sigma[rows]).all()
    stated = np.sqrt(np.diagonal(found.covariance))
    assert stated[sigma > 0] == pytest.approx(sigma[sigma > 0], rel=0.06)
    for one, other in zip(found.pose_covariance, slow.pose_covariance, strict=True):
        unit = np.sqrt(np.diagonal(other, axis1=1, axis2=2))
        size = unit[:, :, None] * unit[:, None]
        np.testing.assert_allclose(one / size, other / size, atol=0.12)  # twice that of deviations
    assert found.status == "converged"


def _taken_elsewhere(scene: rig_views.RigScene, offset: float, rng: np.random.Generator) -> RigObservations:
    """What is seen if each photo is taken a little elsewhere: offsets in deviations of its pose."""
    moved = []
    for pose, one, seen in zip(scene.cam_from_rig, scene.cameras, scene.observations.sightings, strict=True):
        kept = tuple(zip(parameter_names(one.model), one.params.tolist(), strict=True))
        root = np.linalg.cholesky(solve(seen, one.model, SolveOptions(fixed=kept)).pose_covariance)
        off = offset * (root @ rng.normal(size=(len(root), 6, 1)))[:, :, 0]
        moved.append(move_poses(pose @ scene.rig_from_target, off))
    names = scene.observations.camera_names
    return rig_views.seen_by_all(names, scene.cameras, np.stack(moved), scene.observations.points, rng)


def test_offsets_of_photos_that_only_show_once_the_noise_is_judged_are_solved() -> None:
    """The rounds that judge what is worth what go on with one size more."""
    scene = rig_views.stereo_pair(frames=14)
    seen = _taken_elsewhere(scene, 10.0, np.random.default_rng(0))
    assert solve_rig(seen, choices(scene), RigOptions(allows_offsets=True)).slack is not None


@pytest.mark.parametrize(("offset", "draws"), [(0.0, 40), (20.0, 6)])
def test_poses_of_every_camera_scatter_as_stated(offset: float, draws: int) -> None:
    """By noise, and where photos are each taken a little elsewhere."""
    scene = rig_views.stereo_pair(frames=14)
    true = scene.cam_from_rig[:, None] @ scene.rig_from_target
    squares = np.zeros((draws, 2))
    for draw in range(draws):
        seen = _taken_elsewhere(scene, offset, np.random.default_rng(draw))
        found = solve_rig(seen, choices(scene), RigOptions(allows_offsets=True))
        assert (found.slack is not None) == (offset > 0)
        for camera in range(2):
            off = steps_between(true[camera], found.cam_from_rig[camera] @ found.rig_from_target)
            inverse = np.linalg.inv(found.pose_covariance[camera])
            squares[draw, camera] = np.einsum("vi,vij,vj->v", off, inverse, off).mean()
    assert squares.mean(axis=0) == pytest.approx([6.0, 6.0], rel=0.2)


def _off(found: RigCalibration, cam_from_rig: Array, camera: int) -> Array:
    """Of a camera's pose: rotation vector, shift.  # (6,)"""
    return steps_between(cam_from_rig, found.cam_from_rig)[camera]


def _chi_square(found: RigCalibration, cam_from_rig: Array, camera: int) -> float:
    """How far a camera is from the truth in what is stated, squared: of six numbers."""
    rows, off = found.rig.pose_rows(camera), _off(found, cam_from_rig, camera)
    return float(off @ np.linalg.solve(found.covariance[rows, rows], off))


def _reordered(observations: RigObservations, cameras: Sequence[int], frames: Array) -> RigObservations:
    """The same with cameras and frames in another order, which their views follow."""
    place = np.argsort(frames)
    sightings, rows = [], []
    for camera in cameras:
        seen, old = observations.sightings[camera], place[observations.frame[camera]]
        order = np.argsort(old)
        rank = np.argsort(order)
        view = rank[seen.view]
        by_view = np.argsort(view, kind="stable")
        names = tuple(seen.view_names[k] for k in order.tolist())
        sightings.append(
            replace(
                seen, view_names=names, view=view[by_view], point=seen.point[by_view],
                center_px=seen.center_px[by_view], cov_px2=seen.cov_px2[by_view],
            )
        )  # fmt: skip
        rows.append(old[order])
    return replace(
        observations, camera_names=tuple(observations.camera_names[k] for k in cameras),
        frame_names=tuple(observations.frame_names[k] for k in frames.astype(int).tolist()),
        sightings=tuple(sightings), frame=tuple(rows),
    )  # fmt: skip


def test_order_of_cameras_and_frames_does_not_matter() -> None:
    """From any order the same rig comes, to a ten-thousandth of its sigmas."""
    scene = rig_views.ring()
    first = solve_rig(scene.observations, choices(scene))
    order = [2, 0, 3, 1]
    mixed = _reordered(scene.observations, order, np.random.default_rng(0).permutation(14).astype(float))
    reference = RigOptions(reference=order.index(0))
    second = solve_rig(mixed, [choices(scene)[k] for k in order], reference)
    for camera in range(1, 4):
        off = _off(first, second.cam_from_rig[np.argsort(order)], camera)
        sigma = np.sqrt(np.diagonal(first.covariance))[first.rig.pose_rows(camera)]
        assert (np.abs(off) < 1e-4 * sigma).all()


def test_cameras_without_a_common_frame_are_chained_by_others() -> None:
    """Neighbours share frames, opposite cameras none: all are placed, within their sigmas."""
    scene = rig_views.ring(count=4, frames=24)
    observations = scene.observations
    keep = [np.isin(rows % 4, [camera, (camera + 1) % 4]) for camera, rows in enumerate(observations.frame)]
    part = _without_views(observations, keep)
    assert part.shared[0, 2] == 0
    found = solve_rig(part, choices(scene))
    assert max(_chi_square(found, scene.cam_from_rig, camera) for camera in range(1, 4)) < 25


def _without_views(observations: RigObservations, keep: Sequence[Flags]) -> RigObservations:
    """Some views of each camera."""
    return replace(
        observations,
        sightings=tuple(keep_views(seen, ok) for seen, ok in zip(observations.sightings, keep, strict=True)),
        frame=tuple(rows[ok] for rows, ok in zip(observations.frame, keep, strict=True)),
    )


def test_a_rig_in_parts_is_refused_with_the_parts() -> None:
    """Cameras that nothing joins are named, and which photos would join them."""
    scene = rig_views.ring(count=4, frames=16)
    keep = [(rows % 2 == 0) == (camera < 2) for camera, rows in enumerate(scene.observations.frame)]
    with pytest.raises(InputError, match=r"2 parts: front, left \| back, right: .*take frames"):
        solve_rig(_without_views(scene.observations, keep), choices(scene))


def _moving(
    delay_s: Sequence[float], jitter_s: float, seed: int = 1, step_s: float = 0.1
) -> tuple[RigObservations, Array, list[CameraChoice]]:
    """Four cameras around an icosahedron that moves, each with a clock of its own; cam_from_rig, and choices."""
    rng = np.random.default_rng(seed)
    stamp = step_s * np.arange(30)
    angle = 0.5 * np.pi * np.arange(4)
    eye = 600 * np.stack([np.cos(angle), np.sin(angle), 0.2 * np.cos(2 * angle)], axis=1)
    cam_from_world, points = look_at(eye, np.zeros((4, 3))), solver_scenes.icosahedron(100.0, 5)
    parts = []
    for camera in range(4):
        t = stamp - delay_s[camera] + rng.normal(0, jitter_s, len(stamp))
        turn = np.stack([1.2 * np.sin(1.1 * t), 1.5 * np.cos(0.7 * t), 0.9 * t], axis=1)
        way = np.stack([60 * np.sin(1.3 * t), 50 * np.cos(1.7 * t), 40 * np.sin(0.9 * t)], axis=1)
        lens = (rig_views.camera(1000.0 + 40 * camera),)
        pose = make_pose(exp_rotation(turn), way)
        parts.append(rig_views.scene_of(("one",), lens, cam_from_world[camera : camera + 1], pose, points, rng, 0.05))
    seen = [part.observations for part in parts]
    joint = RigObservations(
        ("a", "b", "c", "d"), seen[0].frame_names, tuple(one.sightings[0] for one in seen),
        tuple(one.frame[0] for one in seen), tuple(stamp[one.frame[0]] for one in seen),
    )  # fmt: skip
    return joint, cam_from_world @ invert(cam_from_world[0]), [CameraChoice("opencv")] * 4


def test_time_offsets_are_found_within_their_sigmas() -> None:
    """Clocks that run 20 to 50 ms apart, and jitter by 4 ms: the offsets and the rig lie within what is stated.

    Few frames show the motion here, so what it is in between is a guess.
    """
    delay = (0.0, 0.02, -0.03, 0.05)
    observations, truth, models = _moving(delay, 0.004, step_s=0.4)
    found = solve_rig(observations, models, RigOptions(estimates_delays=True))
    assert (np.abs(found.delay_s - delay)[1:] < 4 * found.delay_sigma_s[1:]).all()
    assert (found.delay_sigma_s[1:] < 0.002).all()
    assert max(_chi_square(found, truth, camera) for camera in range(1, 4)) < 25


def test_what_frames_leave_open_of_the_motion_is_in_the_sigmas_of_time_offsets() -> None:
    """Speeds off by a tenth of what they may be: time offsets of rigs that are solved with them scatter by as much."""
    observations, _, models = _moving((0.0, 0.02, -0.03, 0.05), 0.004, step_s=0.4)
    options, rng = RigOptions(estimates_delays=True), np.random.default_rng(0)
    known = [
        solve_alone(seen, name, choice, options)
        for seen, name, choice in zip(observations.sightings, observations.camera_names, models, strict=True)
    ]
    start = start_rig(observations, known, options)
    problem, motion = without_params(start.problem), start.problem.motion
    found = descend_rig(problem, start.state, DescentSteps(50))
    inverse = shared_inverse(found.equations.normal)
    stated = np.diagonal(motion_covariance(problem, found, inverse.shared, inverse.coupling))
    ((rows, covariance),) = motion.speed_covariance()
    late = []
    for _ in range(16):
        other = motion.derivative.copy()
        other[0, rows] += 0.1 * np.stack(
            [rng.multivariate_normal(np.zeros(len(rows)), one) for one in covariance], axis=1
        )
        there = replace(problem, motion=replace(motion, derivative=other))
        late.append(descend_rig(there, found.state, DescentSteps(50)).state.delay_s - found.state.delay_s)
    for camera, one in enumerate(problem.seen[1:], start=1):
        scatter = 10 * np.sqrt(np.mean(np.square(late), axis=0)[camera])
        assert 0.5 < scatter / np.sqrt(stated[one.delay[0]]) < 1.6


def test_photos_that_do_not_fit_together_are_said_and_widen_the_sigmas() -> None:
    """Unsynchronised photos taken as synchronous give no confident wrong rig: it is said, and the sigmas hold it."""
    observations, truth, models = _moving((0.0, 0.0, 0.0, 0.0), 0.02)
    found = solve_rig(observations, models)
    assert any("do not fit together" in remark and "time offsets" in remark for remark in found.remarks)
    assert max(_chi_square(found, truth, camera) for camera in range(1, 4)) < 80


def test_time_offsets_need_time_stamps() -> None:
    """Without stamps the wish is refused in a line."""
    scene = rig_views.stereo_pair()
    with pytest.raises(InputError, match="time stamps"):
        solve_rig(scene.observations, choices(scene), RigOptions(estimates_delays=True))


def test_a_robots_ways_tell_the_size_of_the_target() -> None:
    """A target printed 3 % too small is told by the robot that carries the camera; its noise comes out right, too."""
    observations, carrier, truth = rig_views.camera_in_hand(np.random.default_rng(2).uniform(-0.5, 0.5, (20, 3)))
    found = solve_rig(observations, [CameraChoice("opencv")], RigOptions(carrier=carrier))
    assert abs(found.carrier.size - 0.97) < 4 * found.carrier.size_sigma < 0.01
    assert found.carrier.sigma_mm == pytest.approx(0.1, rel=0.5)
    assert found.carrier.sigma_rad == pytest.approx(2e-4, rel=0.5)
    assert _chi_square(found, truth[None], 0) < 25


def test_turns_about_one_axis_leave_a_shift_open_and_say_so() -> None:
    """A robot that turns about one axis only: what nothing tells is named, and has no sigma; directions have one."""
    turns = np.random.default_rng(2).uniform(-0.6, 0.6, (12, 1)) * np.array([0.3, 0.2, 1.0])
    observations, carrier, _ = rig_views.camera_in_hand(turns)
    given = CameraChoice("opencv", given=rig_views.camera(), is_refined=False)
    found = solve_rig(observations, [given], RigOptions(carrier=replace(carrier, size_sigma=0.0)))
    assert found.carrier.undetermined
    sigma = np.sqrt(np.diagonal(found.covariance)[found.rig.pose_rows(0)])
    assert not (sigma[3:] < 1.0).all()
    assert (sigma[:2] < 0.01).all()


@pytest.mark.parametrize("are_free", [True, False])
def test_a_turntables_axis_is_found_within_its_sigmas(are_free: bool) -> None:
    """With angles given or not: the frames determine it, and nothing is stated less sure than it is.

    What nothing tells, how the table's own frame is turned about its axis, is held and has no part in any sigma.
    """
    rng = np.random.default_rng(0)
    angle = np.linspace(0, np.radians(300), 16) + rng.uniform(-0.1, 0.1, 16)
    table_from_target = make_pose(exp_rotation(np.array([0.35, 0.2, 0.5])), np.array([30.0, 20.0, 0.0]))
    cam_from_table = look_at(np.array([450.0, 0.0, 300.0]), np.zeros(3))
    frames = cam_from_table @ turned_by(angle) @ table_from_target
    board = solver_scenes.board(9, 7, 20.0)
    scene = rig_views.scene_of(("cam",), (rig_views.camera(),), np.eye(4)[None], frames, board, rng, 0.1)
    rows = scene.observations.frame[0]
    observations = keep_frames(scene.observations, np.isin(np.arange(16), rows))
    carrier = Mechanism("turntable", turned_by(angle)[rows], is_turntable=True, has_free_angles=are_free)
    given = CameraChoice("opencv", given=rig_views.camera(), is_refined=False)
    found = solve_rig(observations, [given], RigOptions(carrier=carrier))
    assert found.status == "converged"
    assert found.carrier.covariance is not None
    axis, pose = found.cam_from_rig[0, :3, 2], found.covariance[found.rig.pose_rows(0), found.rig.pose_rows(0)]
    off = cam_from_table[:3, 2] * np.sign(axis @ cam_from_table[:3, 2]) - axis
    sigma = np.sqrt(np.diagonal(pose))
    assert np.linalg.norm(off) < 4 * np.linalg.norm(sigma[:3]) < 1e-3
    assert np.sqrt(axis @ pose[:3, :3] @ axis) < 1e-4
    turned = found.carrier.angle_rad * np.sign(axis @ cam_from_table[:3, 2]) - angle[rows]
    turned = np.angle(np.exp(1j * (turned - turned[0])))
    assert np.abs(turned).max() < 1e-3


@pytest.mark.parametrize("are_free", [True, False])
def test_a_table_that_wobbles_is_solved_with_its_camera_in_few_steps(are_free: bool) -> None:
    """The height of the table's frame, which a wobble hardly tells, is where it was put, and nothing creeps there.

    With the lens as unknowns, and the angles, the axis comes out within its sigmas.
    """
    rng = np.random.default_rng(5)
    angle = np.sort(rng.uniform(0, 2 * np.pi, 14))
    wobble = make_pose(exp_rotation(rng.normal(0, 1e-3, (14, 3))), rng.normal(0, 0.1, (14, 3)))
    table_from_target = make_pose(exp_rotation(np.array([0.3, -0.2, 0.5])), np.array([30.0, 20.0, 0.0]))
    cam_from_table = look_at(np.array([450.0, 0.0, 200.0]), np.zeros(3))
    frames = cam_from_table @ turned_by(angle) @ wobble @ table_from_target
    points = solver_scenes.icosahedron(100.0, 5)
    scene = rig_views.scene_of(("cam",), (rig_views.camera(),), np.eye(4)[None], frames, points, rng, 0.1)
    carrier = Mechanism("turntable", turned_by(angle), is_turntable=True, has_free_angles=are_free)
    found = solve_rig(scene.observations, [CameraChoice("opencv")], RigOptions(carrier=carrier))
    assert found.status == "converged"
    assert found.iterations < 300
    assert abs(found.carrier.carrier_from_target[2, 3]) < 0.5
    assert found.carrier.sigma_rad == pytest.approx(1e-3, rel=0.4)
    axis, rows = found.cam_from_rig[0, :3, 2], found.rig.pose_rows(0)
    off = cam_from_table[:3, 2] * np.sign(axis @ cam_from_table[:3, 2]) - axis
    covariance = skew(axis) @ found.covariance[rows, rows][:3, :3] @ skew(axis).T
    assert off @ np.linalg.pinv(covariance, rcond=1e-9) @ off < 16


@pytest.mark.parametrize("is_moved", [False, True])
def test_one_bad_photo_is_left_out_and_named(is_moved: bool) -> None:
    """Of a false detection, or of a target that was moved before one camera took it: the rest is as without it."""
    scene = rig_views.ring(count=3, frames=16, noise_px=0.1, seed=4)
    seen = scene.observations
    own = seen.sightings[2]
    bad = own.view == 5
    rng = np.random.default_rng(0)
    off = np.array([6.0, 0.0]) if is_moved else 1.5 * rng.normal(size=(int(bad.sum()), 2))
    center = own.center_px.copy()
    center[bad] += off
    spoilt = replace(seen, sightings=(*seen.sightings[:2], replace(own, center_px=center)))
    choices = [CameraChoice("opencv")] * 3
    found = solve_rig(spoilt, choices)
    keep = np.arange(own.view_count) != 5
    without = replace(
        seen, sightings=(*seen.sightings[:2], keep_views(own, keep)), frame=(*seen.frame[:2], seen.frame[2][keep])
    )
    (line,) = [line for line in found.remarks if "left out" in line]
    assert line.startswith(f"cam2, {own.view_names[5]}: left out")
    assert found.slack is None
    assert np.allclose(found.cam_from_rig, solve_rig(without, choices).cam_from_rig, atol=1e-5)


def test_poses_of_a_robot_that_do_not_fit_are_left_out_and_named() -> None:
    """From the start on: what is found is what the other photos tell, halves of them too."""
    turns = np.random.default_rng(3).uniform(-0.5, 0.5, (14, 3))
    observations, carrier, _ = rig_views.camera_in_hand(turns)
    lost = np.arange(len(carrier.rig_from_mechanism)) % 5 == 2
    moved = carrier.rig_from_mechanism.copy()
    moved[lost] = moved[lost] @ make_pose(exp_rotation(np.array([0.2, 0.1, 0.0])), np.array([40.0, 0.0, 20.0]))
    given = [CameraChoice("opencv", given=rig_views.camera(), is_refined=False)]
    found = solve_rig(observations, given, RigOptions(carrier=replace(carrier, rig_from_mechanism=moved)))
    named = [line.partition(":")[0] for line in found.remarks if "left out: its robot pose" in line]
    assert named == [name for name, off in zip(observations.frame_names, lost.tolist(), strict=True) if off]
    kept = replace(carrier, rig_from_mechanism=carrier.rig_from_mechanism[~lost])
    alone = solve_rig(keep_frames(observations, ~lost), given, RigOptions(carrier=kept))
    assert np.allclose(found.cam_from_rig, alone.cam_from_rig, atol=1e-4)
    halves = half_solver(found, given, RigOptions(carrier=replace(carrier, rig_from_mechanism=moved)))
    assert halves(np.arange(len(found.rig_from_target)) % 2 == 0).status == "converged"


@pytest.mark.parametrize("seed", [1, 4])
def test_a_photo_that_hardly_tells_its_pose_is_no_wrong_pose_of_the_robot(seed: int) -> None:
    """A few corners at the border: the robot is not blamed for what the camera does not know."""
    turns = np.random.default_rng(seed).uniform(-0.5, 0.5, (20, 3))
    observations, carrier, _ = rig_views.camera_in_hand(turns, noise_px=0.1)
    found = solve_rig(observations, [CameraChoice("opencv")], RigOptions(carrier=carrier))
    assert not any("left out" in remark for remark in found.remarks)
    assert found.observations.frame_count == observations.frame_count


def _three_cameras(seed: int, third_focal: float) -> tuple[rig_views.RigScene, RigObservations]:
    """Two that see a board ten times, and one that sees it three times, of a focal length that is told as a part."""
    rng = np.random.default_rng(seed)
    one = rig_views.camera()
    lenses = [
        replace(
            one, params=one.params * (1 + np.r_[rng.normal(0, 0.004) * np.ones(2), rng.normal(0, 0.01, 2), np.zeros(5)])
        )
        for _ in range(3)
    ]
    lenses[2] = replace(lenses[2], params=lenses[2].params * np.r_[third_focal * np.ones(2), np.ones(7)])
    eye, aim = (
        np.array([[-200.0, 0, 0], [0, 0, 0], [200.0, 0, 0]]),
        np.array([[-60.0, 900, 0], [0, 900, 0], [60.0, 900, 0]]),
    )
    turned = make_pose(exp_rotation(rng.uniform(-0.4, 0.4, (10, 3))), rng.uniform(-120, 120, (10, 3)))
    world = (
        make_pose(np.eye(3), np.array([0.0, 900, 0]))
        @ turned
        @ make_pose(exp_rotation(np.array([np.pi / 2, 0, 0])), np.zeros(3))
    )
    names = ("left", "middle", "right")
    scene = rig_views.scene_of(names, lenses, look_at(eye, aim), world, solver_scenes.board(9, 7, 20.0), rng, 0.15)
    seen = scene.observations
    every = np.ones(10, dtype=bool)
    return scene, _without_views(seen, [every, every, np.isin(np.arange(10), [1, 4, 6])])


def _length_error_mm(scene: rig_views.RigScene, found: RigCalibration, frames: Array) -> float:
    """Of the sides of the board in frames, as the last two cameras place what they truly show."""
    shown, count = scene.observations.points.position_mm, len(frames)
    there = transform(scene.rig_from_target[frames, None], shown).reshape(-1, 3)
    pixel = [project(scene.cameras[k], transform(scene.cam_from_rig[k], there)) for k in (1, 2)]
    camera, names = np.repeat([1, 2], len(there)), tuple(map(str, range(len(there)))) * 2
    seen = of_rows(camera, ("all",) * len(camera), names, np.concatenate(pixel))
    placed = triangulate_points(found.rig, seen, rejects=False).position_mm.reshape(count, -1, 3)
    long = np.linalg.norm(placed[:, 0] - placed[:, -1], axis=1) - np.linalg.norm(shown[0] - shown[-1])
    return float(np.sqrt(np.mean(long**2)))


def test_a_lens_that_few_photos_leave_open_is_near_to_another_of_its_kind() -> None:
    """What is not photographed lies far nearer than by its own photos alone, and no farther than is stated."""
    off_mm, squares = [], []
    for seed in range(4):
        scene, seen = _three_cameras(seed, 1.0)
        found = solve_rig(seen, [CameraChoice("opencv")] * 3)
        assert any(remark.startswith("right: its photos leave its lens open") for remark in found.remarks)
        off_mm.append(_length_error_mm(scene, found, np.array([0, 2, 3, 5, 7, 8, 9])))
        squares.append(_chi_square(found, scene.cam_from_rig, 2))
    assert max(off_mm) < 0.6
    assert np.mean(squares) < 12.0


def test_lenses_of_different_kinds_are_not_drawn_together() -> None:
    """A focal length that is another by half, which even three photos tell."""
    _, seen = _three_cameras(0, 1.5)
    found = solve_rig(seen, [CameraChoice("opencv")] * 3)
    assert not any(remark.startswith("right: its photos leave") for remark in found.remarks)
    assert found.priors == ((), (), ())
