"""The parts of the joint adjustment, against plain NumPy and SciPy."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from calib.core.types import Observations
from calib.measure_target.blocks import normal_equations
from calib.measure_target.datum import gauge_rows, what_is_seen
from calib.measure_target.problem import Joint, State, joint_problem
from calib.measure_target.solve import measure
from calib.measure_target.unknowns import (
    AsBuiltOptions,
    TargetUnknowns,
    Unknowns,
    in_face_mm,
    moved_shape,
    place_rings,
    unknowns_of,
)
from calib.solver.eliminate import covariance_factor, damped_step
from calib.solver.levenberg import move_poses
from calib.solver.problem import SolveOptions, tie_parameters
from calib.solver.solve import solve
from designer.base.arrays import Array
from designer.kinds.board import BoardSpec
from designer.kinds.layout import lay_out
from designer.target import TargetGeometry
from tests.support.as_built_scenes import dense, photos, plate, printed, random_shape, solid

RINGS = (0.05, 0.02)
BENT = AsBuiltOptions(ring_sigma_mm=RINGS, bow=True)


def test_rings_are_placed_as_the_equation_says() -> None:
    """Offset and bow in the face, then the face's motion, then the print's strain about the target's origin."""
    rng = np.random.default_rng(1)
    shape = random_shape(solid(), rng, turn_rad=0.1, ring_mm=RINGS, bow_mm=0.2)
    unknowns = unknowns_of(solid(), BENT)
    rings = place_rings(unknowns, shape)
    strain = np.zeros((3, 3))
    for value, (i, j) in zip(shape.strain, [(0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1)], strict=True):
        strain[i, j] = strain[j, i] = value
    for ring in (0, 17, 200):
        face = solid().ring_face[ring]
        frame = solid().target_from_face[face]
        local = frame[:3, :3].T @ (solid().center_mm[ring] - frame[:3, 3]) + shape.offset_mm[ring]
        local[2] += unknowns.basis[ring] @ shape.bow[face]
        moved = Rotation.from_rotvec(shape.motion[face, :3]).apply(local) + shape.motion[face, 3:]
        expected = (np.eye(3) + strain) @ (frame[:3, :3] @ moved + frame[:3, 3])
        assert rings.position_mm[ring] == pytest.approx(expected, abs=1e-12)


def test_bow_neither_shifts_nor_tilts_a_face() -> None:
    """Over the rings of a face each bow has zero mean and no plane, and at most about 1 mm per mm."""
    for target in (solid(), plate()):
        basis = unknowns_of(target, BENT).basis
        for face in range(target.face_count):
            rows = target.ring_face == face
            plane = np.column_stack([np.ones(rows.sum()), target.center_in_face_mm[rows, :2]])
            assert plane.T @ basis[rows] == pytest.approx(np.zeros((3, 3)), abs=1e-9)
            assert np.linalg.matrix_rank(basis[rows]) == 3


@pytest.mark.parametrize("target", [solid(), plate()], ids=["solid", "plate"])
def test_derivatives_of_rings(target: TargetGeometry) -> None:
    """Analytic derivatives by every unknown equal finite differences, also far from the nominal shape."""
    rng = np.random.default_rng(2)
    unknowns = unknowns_of(target, BENT)
    shape = random_shape(target, rng, strain=0.02, turn_rad=0.3, shift_mm=5.0, ring_mm=(0.5, 0.5), bow_mm=1.0)
    rings = place_rings(unknowns, shape)
    column = unknowns.column[target.ring_face]
    none = np.zeros_like(shape.offset_mm)
    for k in range(unknowns.count):
        step = np.zeros(unknowns.count)
        step[k] = 1e-5
        ahead, behind = (place_rings(unknowns, moved_shape(unknowns, shape, s * step, none)) for s in (1, -1))
        slope = (ahead.position_mm - behind.position_mm) / 2e-5
        is_own = column == k
        analytic = (rings.by_shared * is_own[:, None, :]).sum(axis=2)
        assert slope == pytest.approx(analytic, abs=1e-6)
    for axis in range(3):
        step = 1e-5 * np.eye(3)[axis] + none
        still = np.zeros(unknowns.count)
        ahead, behind = (place_rings(unknowns, moved_shape(unknowns, shape, still, s * step)) for s in (1, -1))
        slope = (ahead.position_mm - behind.position_mm) / 2e-5
        assert slope == pytest.approx(rings.by_offset[:, :, axis], abs=1e-8)


def joint_of(target: TargetGeometry, views: int, options: AsBuiltOptions) -> tuple[Joint, State]:
    """A problem of two sets, and a state that is not its minimum."""
    rng = np.random.default_rng(3)
    shape = random_shape(target, rng, ring_mm=RINGS)
    angle = 150.0 if target.face_count > 1 else 50.0
    sets = [photos(printed(target, shape), rng, views, half_angle_deg=angle) for _ in range(2)]
    unknowns = unknowns_of(target, options)
    tie = tie_parameters("opencv", SolveOptions(shared=(("fx_px", "fy_px"),), fixed=(("k3", None),)))
    seen = what_is_seen(unknowns, [(one, np.ones(len(one.view), dtype=bool)) for one in sets])
    joint = joint_problem(sets, [tie, tie], unknowns, gauge_rows(unknowns, seen, 100.0), weighted=False)
    solved = [solve(one, "opencv") for one in sets]
    state = State(tuple(one.camera for one in solved), tuple(one.cam_from_target for one in solved), shape)
    return replace(joint, scale=0.05), state


CASES = [
    pytest.param((plate(), 6, BENT), id="rings first"),
    pytest.param((plate(), 40, BENT), id="poses first"),
    pytest.param((solid(), 8, AsBuiltOptions(ring_sigma_mm=None, bow=True)), id="rigid"),
]


@pytest.fixture(scope="module", params=CASES)
def problem(request: pytest.FixtureRequest) -> tuple[Joint, State]:
    """Of a target, so many photos, and options."""
    return joint_of(*request.param)


def test_steps_solve_the_whole_system(problem: tuple[Joint, State]) -> None:
    """The step by blocks is that of the dense damped system, promises what it says, and factors the inverse."""
    normal = normal_equations(*problem)
    matrix, gradient = dense(normal)
    damping = 1e-3
    expected = np.linalg.solve(matrix + damping * np.diag(np.diagonal(matrix)), -gradient)
    step = damped_step(normal, damping)
    got = np.concatenate([step.pose.ravel(), step.ring.ravel(), step.other])
    unit = 1 / np.sqrt(np.diagonal(matrix))
    assert got / unit == pytest.approx(expected / unit, abs=1e-6 * np.abs(expected / unit).max())
    assert step.predicted == pytest.approx(-(2 * gradient @ got + got @ matrix @ got), rel=1e-6)
    factor = covariance_factor(normal)
    inverse = np.linalg.inv(matrix * unit[:, None] * unit) * unit[:, None] * unit
    others = len(normal.other)
    assert factor.other @ factor.other.T == pytest.approx(inverse[-others:, -others:], rel=1e-4, abs=1e-12)
    for ring in range(0, len(normal.ring), 20):
        here = slice(6 * len(normal.pose) + 3 * ring, 6 * len(normal.pose) + 3 * ring + 3)
        block = factor.ring[ring] @ factor.ring[ring].T + factor.ring_own[ring] @ factor.ring_own[ring].T
        assert block == pytest.approx(inverse[here, here], rel=1e-4, abs=1e-12)


def test_gradient_is_that_of_the_cost(problem: tuple[Joint, State]) -> None:
    """The gradient of every kind of unknown is half the slope of the cost, priors and gauge included."""
    joint, state = problem
    matrix, gradient = dense(normal_equations(joint, state))
    rng = np.random.default_rng(4)
    poses, rings = 6 * joint.view_count, 3 * len(normal_equations(joint, state).ring)
    kinds = [np.arange(poses), np.arange(poses, poses + rings), np.arange(poses + rings, len(gradient))]
    for kind in kinds:
        if not len(kind):
            continue
        direction = np.zeros(len(gradient))
        direction[kind] = rng.standard_normal(len(kind)) / np.sqrt(np.diagonal(matrix)[kind])
        step = 1e-3
        ahead, behind = (normal_equations(joint, moved(joint, state, s * step * direction)).cost for s in (1, -1))
        assert (ahead - behind) / (4 * step) == pytest.approx(gradient @ direction, rel=1e-4, abs=1e-2)


def moved(joint: Joint, state: State, step: Array) -> State:
    """A state after a step (poses, rings, others), without what makes long steps better."""
    poses, shared = 6 * joint.view_count, joint.unknowns.count
    offset = step[poses : len(step) - joint.param_count - shared].reshape(-1, 3)
    other = step[len(step) - joint.param_count - shared :]
    cameras, placed = [], []
    for one, camera, pose in zip(joint.sets, state.cameras, state.poses, strict=True):
        change = [other[one.first_param + k] if k >= 0 else 0.0 for k in one.tie.row]
        cameras.append(replace(camera, params=camera.params + change))
        part = step[:poses].reshape(-1, 6)[one.first_view : one.first_view + len(pose)]
        placed.append(move_poses(pose, part))
    offset = offset if len(offset) else np.zeros_like(state.shape.offset_mm)
    shape = moved_shape(joint.unknowns, state.shape, other[joint.param_count :], offset)
    return State(tuple(cameras), tuple(placed), shape)


def plain_residuals(x: Array, seen: Observations, unknowns: Unknowns, start: Array, sigma: float) -> Array:
    """What SciPy minimises: OpenCV's projection, priors, no elimination. x: camera, poses, strain, bow, offsets."""
    camera, views = x[:9], seen.view_count
    poses, rest = x[9 : 9 + 6 * views].reshape(-1, 6), x[9 + 6 * views :]
    strain, bow, offset = rest[:3], rest[3:6], rest[6:].reshape(-1, 3)
    shape = TargetUnknowns(np.array([strain[0], strain[1], 0, 0, 0, strain[2]]), np.zeros((1, 6)), bow[None], offset)
    target = unknowns.target
    affine = np.eye(3)
    affine[0, 0] += strain[0]
    affine[1, 1] += strain[1]
    affine[0, 1] = affine[1, 0] = strain[2]
    frame = target.target_from_face[0]
    position = (in_face_mm(unknowns, shape) @ frame[:3, :3].T + frame[:3, 3]) @ affine
    matrix = np.array([[camera[0], 0, camera[2]], [0, camera[1], camera[3]], [0, 0, 1]])
    residuals = []
    for view in range(views):
        rows = seen.view == view
        pixel, _ = cv2.projectPoints(position[seen.point[rows]], poses[view, :3], poses[view, 3:], matrix, camera[4:])
        residuals.append((pixel[:, 0] - seen.center_px[rows]).ravel() / sigma)
    size = np.linalg.norm(target.outline_mm[0], axis=1).max()
    priors = [strain / 0.05, bow / (0.02 * size), (offset / [0.05, 0.05, 0.02]).ravel()]
    # The scale of all rings is a gauge: it is held where our solution has it.
    return np.concatenate([*residuals, *priors, [1e4 * (rest[:2].sum() - start[:2].sum())]])


def test_minimum_is_that_of_scipy() -> None:
    """A plain least-squares solver, started elsewhere, finds the same camera, bow and ring offsets."""
    rng = np.random.default_rng(5)
    board = lay_out(BoardSpec((240.0, 200.0), 3.0, 7, 6, "square", 20.0, 0.45, 32.0, 0.0, 1.0, dots=False))
    shape = random_shape(board, rng, bow_mm=0.3, ring_mm=RINGS)
    seen = photos(printed(board, shape), rng, 6, half_angle_deg=50.0)
    rim_mm = float(np.linalg.norm(board.outline_mm[0], axis=1).max())
    options = AsBuiltOptions(ring_sigma_from_photos=False, strain_sigma=0.05, bow_sigma_mm=0.02 * rim_mm)
    found = measure([seen], board, "opencv", options)
    pose = found.poses[0]
    turn = Rotation.from_matrix(pose[:, :3, :3]).as_rotvec()
    strain = found.strain[[0, 1, 0], [0, 1, 1]]
    start = np.concatenate([
        found.cameras[0].params, np.concatenate([turn, pose[:, :3, 3]], axis=1).ravel(), strain,
        found.bow_mm[0], found.offset_mm.ravel(),
    ])  # fmt: skip
    begin = start.copy()
    begin[9 + 6 * 6 + 3 :] *= 0.5
    args = (seen, unknowns_of(board, AsBuiltOptions(bow=True)), strain, found.scale)
    best = least_squares(
        plain_residuals, begin, args=args, x_scale="jac", xtol=1e-12, ftol=1e-11, gtol=1e-12, max_nfev=30
    )
    sigma = np.sqrt(np.diagonal(np.linalg.inv(best.jac.T @ best.jac)))
    ours = plain_residuals(start, *args)
    assert (ours**2).sum() == pytest.approx(2 * best.cost, abs=1e-3)
    assert np.abs(start - best.x)[:9] / sigma[:9] == pytest.approx(0, abs=2e-3)
    assert np.abs(start - best.x)[9 + 6 * 6 + 3 :] / sigma[9 + 6 * 6 + 3 :] == pytest.approx(0, abs=2e-3)
    assert np.sqrt(np.diagonal(found.param_covariance[0])) == pytest.approx(sigma[:9], rel=0.02)
