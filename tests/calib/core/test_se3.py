"""Rotations and rigid motions."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib.core.se3 import (
    compose,
    exp_rotation,
    invert,
    log_rotation,
    look_at,
    make_pose,
    quaternion_wxyz,
    rotation_of_quaternion,
    skew,
    transform,
)


def vectors(seed: int = 0) -> np.ndarray:
    """Rotation vectors from zero to pi long, the ends included."""
    rng = np.random.default_rng(seed)
    direction = rng.standard_normal((400, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    length = np.concatenate([[0, 1e-12, 1e-9, 1e-5, 9e-5, 1.1e-4, np.pi - 1e-9], rng.uniform(0, np.pi, 393)])
    return length[:, None] * direction


def test_exp_agrees_with_scipy() -> None:
    """exp_rotation is SciPy's rotation of a rotation vector, for angles from 0 to pi."""
    expected = Rotation.from_rotvec(vectors()).as_matrix()
    assert np.abs(exp_rotation(vectors()) - expected).max() < 1e-14


def test_log_undoes_exp() -> None:
    """log(exp(v)) is v up to pi, close to 0 and close to pi too."""
    assert np.abs(log_rotation(exp_rotation(vectors())) - vectors()).max() < 1e-7
    short = vectors()[np.linalg.norm(vectors(), axis=1) < 3]
    assert np.abs(log_rotation(exp_rotation(short)) - short).max() < 1e-14


def test_log_of_half_a_turn() -> None:
    """A half turn about any axis has a rotation vector of length pi that turns back into it."""
    axis = vectors()[10:]
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    half_turn = 2 * axis[:, :, None] * axis[:, None, :] - np.eye(3)
    vector = log_rotation(half_turn)
    assert np.abs(np.linalg.norm(vector, axis=1) - np.pi).max() < 1e-7
    assert np.abs(exp_rotation(vector) - half_turn).max() < 1e-7


def test_quaternions_are_those_of_scipy() -> None:
    """Scalar first and not negative, and back from any length and sign, at zero and half a turn, too."""
    wxyz = quaternion_wxyz(exp_rotation(vectors()))
    expected = np.roll(Rotation.from_rotvec(vectors()).as_quat(canonical=True), 1, axis=1)
    assert np.abs(wxyz - expected).max() < 1e-14
    assert np.abs(rotation_of_quaternion(-1.01 * wxyz) - exp_rotation(vectors())).max() < 1e-14
    assert np.array_equal(rotation_of_quaternion(wxyz[5]), rotation_of_quaternion(wxyz)[5])


def test_functions_broadcast() -> None:
    """Any leading axes, also none, give the same numbers."""
    batch = vectors().reshape(20, 20, 3)
    assert np.array_equal(exp_rotation(batch)[3, 4], exp_rotation(batch[3, 4]))
    assert np.array_equal(log_rotation(exp_rotation(batch))[3, 4], log_rotation(exp_rotation(batch[3, 4])))


def test_skew_is_the_cross_product() -> None:
    """skew(a) b = a x b."""
    a, b = vectors(1), vectors(2)
    assert np.allclose((skew(a) @ b[..., None])[..., 0], np.cross(a, b), atol=1e-15)


def test_invert_and_compose() -> None:
    """A pose after its inverse changes nothing, and compose applies its last pose first."""
    poses = make_pose(exp_rotation(vectors(1)), 100 * vectors(2))
    assert np.abs(compose(invert(poses), poses) - np.eye(4)).max() < 1e-12
    point = vectors(3)
    once = transform(poses, transform(invert(poses[::-1]), point))
    assert np.allclose(transform(compose(poses, invert(poses[::-1])), point), once, atol=1e-12)


@pytest.mark.parametrize("roll", [0.0, 0.7, -2.5])
def test_look_at(roll: float) -> None:
    """The eye is the camera's origin, the aim lies on its axis in front, and the rotation is right-handed."""
    eye, aim = 300 * vectors(4)[10:], 20 * vectors(5)[10:]
    pose = look_at(eye, aim, roll)
    assert np.abs(transform(pose, eye)).max() < 1e-10
    distance = np.linalg.norm(aim - eye, axis=1)
    assert np.allclose(transform(pose, aim), distance[:, None] * [0, 0, 1], atol=1e-9)
    assert np.allclose(np.linalg.det(pose[:, :3, :3]), 1)


def test_look_at_has_up_upwards() -> None:
    """Without roll z is up in the image; looking down z, y is; a quarter roll turns the camera clockwise."""
    up = transform(look_at(np.array([300.0, 200, 100]), np.zeros(3)), np.array([0.0, 0, 10]))
    assert up[1] < 0
    assert abs(up[0]) < 1e-12
    down_z = transform(look_at(np.array([0.0, 0, 500]), np.zeros(3)), np.array([[0.0, 10, 0], [10, 0, 0]]))
    assert np.allclose(down_z[:, :2], [[0, -10], [10, 0]])
    turned = transform(look_at(np.array([0.0, 0, 500]), np.zeros(3), np.pi / 2), np.array([0.0, 10, 0]))
    assert np.allclose(turned[:2], [-10, 0])  # the scene turns against the clock
