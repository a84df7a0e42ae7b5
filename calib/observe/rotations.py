"""How robots write rotations: the columns each way needs, and the rotation they mean.

Euler angles are turns about named axes: `xyz-extrinsic` about the fixed x, then y, then z; `zyx-intrinsic` about z,
then the turned y, then the twice turned x. The two name the same rotations, in opposite order.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from calib.core.se3 import exp_rotation, quaternion_wxyz, rotation_of_quaternion
from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.base.words import shown

UNIT_LENGTH = 1e-2
"""By which a quaternion's length may differ from one: files of three digits are read, other numbers are not."""
NEARLY_RIGID = 5e-3
"""By which a matrix may differ from a rotation, likewise."""
NAMED_EULER = {
    "kuka": "zyx-intrinsic",
    "fanuc": "xyz-extrinsic",
    "rpy": "xyz-extrinsic",
    "staubli": "xyz-intrinsic",
    "kawasaki": "zyz-intrinsic",
}
"""Conventions by the robots that use them: KUKA's A B C, Fanuc's W P R, ROS's roll pitch yaw, Kawasaki's O A T."""
VECTOR = ("rx", "ry", "rz")
_ORDERS = tuple(
    f"{first}{second}{third}-{how}"
    for how in ("intrinsic", "extrinsic")
    for first, second, third in product("xyz", repeat=3)
    if second not in (first, third)
)
_MIXED = ("xzy", "yxz", "yzx", "zxy")
"""Orders of turns about x, y, z that no order of the axes with these three angles in a row has."""


@dataclass(frozen=True)
class RotationColumns:
    """Columns that hold rotations: which, whether they are angles, and what their numbers (V, N) mean."""

    names: tuple[str, ...]
    are_angles: bool  # their names end in _rad or _deg, or a unit is given
    what: str
    rotations: Callable[[Array], Array]  # (V, N) in rad -> (V, 3, 3)


def of_quaternion(value: Array) -> Array:
    """Rotations (V, 3, 3) of quaternions x y z w (V, 4), whose sign is free.

    Raises:
        ValueError: one is far from unit length.
    """
    with np.errstate(over="ignore"):
        length = np.linalg.norm(value, axis=1)
    off = np.flatnonzero(~(np.abs(length - 1) < UNIT_LENGTH))
    if len(off):
        raise RowError(int(off[0]), f"a quaternion of length {length[off[0]]:.4g}; a rotation's is 1")
    return rotation_of_quaternion(np.roll(value, 1, axis=1))


def to_quaternion(rotation: Array) -> Array:
    """Quaternions x y z w (..., 4) of rotations (..., 3, 3)."""
    return np.roll(quaternion_wxyz(rotation), -1, axis=-1)


def of_matrix(value: Array) -> Array:
    """Rotations (V, 3, 3) of matrices, row by row (V, 9), made rigid to the last digit.

    Raises:
        ValueError: one is no rotation.
    """
    matrix = value.reshape(-1, 3, 3)
    left, size, right = np.linalg.svd(matrix)
    ok = (np.abs(size - 1) < NEARLY_RIGID).all(axis=1) & (np.linalg.det(matrix) > 0)
    if not ok.all():
        row = int(np.argmin(ok))
        is_mirror = (np.abs(size[row] - 1) < NEARLY_RIGID).all()
        raise RowError(row, "a mirror image, not a rotation" if is_mirror else "the matrix holds no rotation")
    rotation: Array = left @ right
    return rotation


def of_euler(value: Array, convention: str) -> Array:
    """Rotations (V, 3, 3) of three angles (V, 3) in rad, in the order of the convention's axes."""
    axes, how = convention.split("-")
    turns = [exp_rotation(value[:, k, None] * np.eye(3)["xyz".index(axis)]) for k, axis in enumerate(axes)]
    first, second, third = turns if how == "intrinsic" else turns[::-1]
    rotation: Array = first @ second @ third
    return rotation


class RowError(ValueError):
    """A row that breaks a rule."""

    def __init__(self, row: int, rule: str) -> None:
        super().__init__(rule)
        self.row, self.rule = row, rule


def euler_convention(text: str) -> str:
    """A convention by its name or its axes: `kuka`, `xyz-extrinsic`.

    Raises:
        InputError: it is neither.
    """
    words = text.strip().lower()
    convention = NAMED_EULER.get(words, words)
    if convention not in _ORDERS:
        raise InputError(
            f"--euler {shown(text)}: give the axes and whether they turn along, such as xyz-extrinsic or zyx-intrinsic,"
            f" or {', '.join(NAMED_EULER)}"
        )
    return convention


@dataclass(frozen=True, eq=False)
class RotationReading:
    """What rotations may mean: `reading.rotation`, and how a person would say so."""

    what: str
    remedy: str
    rotation: Array  # (V, 3, 3)


def angle_readings(names: Sequence[str], value: Array) -> list[RotationReading]:
    """All that three angles (V, 3) in rad can mean: Euler angles of each order, or a rotation vector.

    Args:
        names: of their columns, without unit.
        value: as they stand there.
    """
    is_by_axis = tuple(names) == VECTOR
    read = []
    for convention in _ORDERS:
        remedy = f"give --euler {convention}"
        if is_by_axis and convention[:3] != "xyz":
            remedy = f"name the columns e1, e2, e3 and {remedy}"
        users = ", ".join(name for name, meant in NAMED_EULER.items() if meant == convention)
        what = f"Euler angles {convention}" + (f" ({users})" if users else "")
        read.append(RotationReading(what, remedy, of_euler(value, convention)))
    for axes in _MIXED:  # the columns are about x, y, z, and the turns in another order
        convention = f"{axes}-extrinsic"
        remedy = f"{'' if is_by_axis else 'name the columns rx, ry, rz and '}give --euler {convention}"
        order = value[:, ["xyz".index(axis) for axis in axes]]
        read.append(RotationReading(f"Euler angles {convention}", remedy, of_euler(order, convention)))
    remedy = "leave --euler out" if is_by_axis else "name the columns rx, ry, rz"
    return [*read, RotationReading("rotation vectors", remedy, exp_rotation(value))]


def quaternion_readings(rotation: Array) -> list[RotationReading]:
    """What rotations (V, 3, 3) were if their quaternions' four numbers had been taken in another order."""
    value = to_quaternion(rotation)
    return [
        RotationReading(
            f"quaternions {what}", f"name the four columns {names}", of_quaternion(np.roll(value, by, axis=1))
        )
        for what, names, by in (("w first", "qw, qx, qy, qz", -1), ("w last", "qx, qy, qz, qw", 1))
    ]


def rotation_columns(euler: str | None) -> tuple[RotationColumns, ...]:
    """The ways a file may say rotations; of angles about x, y, z with a convention, if one is given."""
    convention = None if euler is None else euler_convention(euler)
    quaternions = [
        RotationColumns(("qx", "qy", "qz", "qw"), False, "quaternions", of_quaternion),
        RotationColumns(("q2", "q3", "q4", "q1"), False, "quaternions", of_quaternion),  # ABB: w first
    ]
    matrices = [
        RotationColumns(tuple(f"{letter}{i}{j}" for i in range(3) for j in range(3)), False, "matrices", of_matrix)
        for letter in "mr"
    ]
    angles = [
        _euler_columns(names, convention or usual)
        for names, usual in ((("a", "b", "c"), "kuka"), (("w", "p", "r"), "fanuc"), (("roll", "pitch", "yaw"), "rpy"),
                             (("o", "a", "t"), "kawasaki"))
    ]  # fmt: skip
    if convention is None:
        turned = RotationColumns(("rx", "ry", "rz"), True, "rotation vectors", exp_rotation)
        return (*quaternions, *matrices, *angles, turned)
    axes = convention[:3]
    named = [_euler_columns(("e1", "e2", "e3"), convention)]
    if len(set(axes)) == 3:
        named.append(_euler_columns(tuple(f"r{axis}" for axis in axes), convention))
    return (*quaternions, *matrices, *angles, *named)


def _euler_columns(names: tuple[str, ...], convention: str) -> RotationColumns:
    meant = NAMED_EULER.get(convention, convention)
    return RotationColumns(names, True, f"Euler angles {meant}", lambda value: of_euler(value, meant))
