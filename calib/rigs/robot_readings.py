"""What a robot's poses mean: the reading of their numbers that explains the photos, by turns and by ways.

A file of poses may be in another unit than is said, the other way round, in another order of quaternions or angles,
of a left-handed frame, or a row beside its photos. Turns alone never tell: the inverse of `Rz(c) Ry(b) Rx(a)` turns as
`Rz(a) Ry(b) Rx(c)` does, and a quaternion of which the numbers are shifted turns as the inverse. So of each reading the
equation `A_v = X B_v Z` (see `calib.rigs.hand_eye`) is solved in closed form, turns first, then ways. A mirror of both
frames changes no turn and the sign of all ways: so units and left-handed frames are factors of the robot's ways.
What counts is how many photos a reading explains, and that none with fewer changes explains as many.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from itertools import product

import numpy as np

from calib.core.se3 import invert, log_rotation
from calib.observe.robot_poses import ANGLES, LENGTHS, MOST_TURNS_RAD, RobotPoses
from calib.observe.rotations import RotationReading, angle_readings, quaternion_readings
from designer.base.arrays import Array, Flags, Rows
from designer.base.words import figure

_Rotation = tuple[RotationReading | None, bool, Array]
"""How rotations are read, None: as is said; whether their angles are in the other unit; and (V, 3, 3)."""

FEWEST = 5
"""Poses, of fewer of which anything may fit."""
MOST, MOST_PAIRS = 48, 400
"""Poses, evenly spread, and pairs of them that are compared."""
LEAST_TURN_RAD = 0.03
"""About a second axis, root mean square, of which less tells no reading."""
NEAR_HALF_TURN_RAD = 2.9
"""Beyond it the axis of a turn may show the other way by a little noise."""
ROUNDS = 8
FAR_OFF = 4.0
"""Times what most poses of the best reading are off, from which on a reading does not explain a photo."""
FLOOR_RAD, FLOOR_MM, FLOOR_PART = 5e-4, 0.1, 2e-4
"""What no camera's pose is surer of: radians, and millimetres or parts of the distance."""
MOST_OFF = 0.1
"""Of how far the camera turned, or moved: what most poses may be off by a reading that is to be named."""
LOST = 0.3
"""Of the same, from which on poses do not belong to the photos."""
LEAST_EXPLAINED = 0.6
"""Of the photos, by a reading that is to be named."""
SIZES = (0.8, 1.25)
"""Of a target, as parts of what its file says: beyond, a unit is another."""
MOST_NAMED = 3
SAME = 1e-6
"""Parts by which two units' ratio is another."""


@dataclass(frozen=True, eq=False)
class PoseReading:
    """A way to read a robot's poses, and what it leaves over."""

    rotation: RotationReading | None  # None: as it was read
    is_angle_unit_other: bool
    is_turned_back: bool  # each rotation the other way, as matrices written column by column
    is_inverted: bool  # against what was said
    shift: int  # rows by which poses are later than their photos
    factor: float  # of the robot's ways against what was said; < 0: of a left-handed frame
    turn_rad: Array  # (V,) off; nan: not compared
    way_mm: Array  # (V,) likewise

    @property
    def changes(self) -> frozenset[tuple[str, object]]:
        """What is other than it was said."""
        told = {
            "rotation": (self.rotation.what if self.rotation else "", ""),
            "angle unit": (self.is_angle_unit_other, False),
            "turned back": (self.is_turned_back, False),
            "inverted": (self.is_inverted, False),
            "shift": (self.shift, 0),
            "left-handed": (self.factor < 0, False),
            "unit": (abs(self.factor), 1.0),
        }
        return frozenset((name, value) for name, (value, as_said) in told.items() if value != as_said)

    @property
    def off(self) -> tuple[float, float]:
        """What most poses are off: rad, mm."""
        return float(np.nanmedian(self.turn_rad)), float(np.nanmedian(self.way_mm))

    def explains(self, rad: float, mm: float) -> int:
        """How many photos it explains, if most poses may be off so much."""
        return int(((self.turn_rad <= FAR_OFF * rad) & (self.way_mm <= FAR_OFF * mm)).sum())


def why_wrong(cam_from_target: Array, poses: RobotPoses, row: Rows, *, is_camera_in_hand: bool) -> str:
    """What a robot's poses look like if they are not what was said; "" if they may be right.

    Args:
        cam_from_target: (V, 4, 4) by the camera alone; nan: not known.
        poses: as they were read.
        row: of each photo among them (V,).
        is_camera_in_hand: else the target is.
    """
    known = np.flatnonzero(np.isfinite(cam_from_target[:, 0, 0]))
    if len(known) < FEWEST:
        return ""
    some = known[np.linspace(0, len(known) - 1, min(len(known), MOST)).astype(int)]
    seen = cam_from_target[some]
    if _second_turn(seen) < LEAST_TURN_RAD:
        return ""
    found = readings(seen, poses, row[some], is_camera_in_hand=is_camera_in_hand)
    return _judged(seen, found, poses, is_camera_in_hand=is_camera_in_hand)


def readings(seen: Array, poses: RobotPoses, row: Rows, *, is_camera_in_hand: bool) -> list[PoseReading]:
    """All ways to read a robot's poses that turn as the camera did, the first as they were read.

    Args:
        seen: cam_from_target (V, 4, 4).
        poses: as they were read.
        row: of each photo among them (V,).
        is_camera_in_hand: else the target is.
    """
    file_pose = invert(poses.base_from_flange) if poses.is_inverted else poses.base_from_flange
    rotations: list[_Rotation] = [(None, False, file_pose[:, :3, :3]), *_rotations(poses, file_pose[:, :3, :3])]
    batches = []
    for shift in (0, -1, 1):
        is_there = (row + shift >= 0) & (row + shift < len(poses.images))
        if is_there.sum() < FEWEST:
            continue
        at = (row + shift)[is_there]
        turned = np.stack([rotation[at] for _, _, rotation in rotations])
        likely = _turning_alike(seen[is_there], turned)
        likely[0] |= shift == 0
        for is_turned_back, is_inverted in product((False, True), repeat=2):
            carried, way = _carried(
                turned[likely], file_pose[at, :3, 3], is_turned_back=is_turned_back,
                is_back=is_inverted ^ poses.is_inverted ^ is_camera_in_hand,
            )  # fmt: skip
            x, turn_rad = _turns(seen[is_there], carried)
            which = np.flatnonzero(likely)
            batches.append(_Batch(shift, is_turned_back, is_inverted, is_there, which, carried, way, x, turn_rad))
    typical = [np.median(one.turn_rad, axis=1) for one in batches]
    near = FAR_OFF * max(min(float(one.min()) for one in typical), FLOOR_RAD)
    factors, found = _factors(poses), []
    for one, rad in zip(batches, typical, strict=True):
        keep = np.flatnonzero((rad <= near) | (one.which == 0))
        way_mm = _ways(seen[one.is_there], one.carried[keep], one.way[keep], one.x[keep], factors)
        for row_of, off in zip(keep.tolist(), way_mm, strict=True):
            rotation, is_other, _ = rotations[one.which[row_of]]
            turn_rad = _spread_out(one.turn_rad[row_of], one.is_there)
            found += [
                PoseReading(
                    rotation, is_other, one.is_turned_back, one.is_inverted, one.shift, factor, turn_rad,
                    _spread_out(mm, one.is_there),
                )
                for factor, mm in zip(factors, off, strict=True)
            ]  # fmt: skip
    return found


@dataclass(frozen=True, eq=False)
class _Batch:
    """Readings (R,) of rotations in one sense, for the photos that have a pose so."""

    shift: int
    is_turned_back: bool
    is_inverted: bool
    is_there: Flags  # (V,)
    which: Rows  # (R,) of the rotations
    carried: Array  # (R, V', 3, 3)
    way: Array  # (R, V', 3)
    x: Array  # (R, 3, 3)
    turn_rad: Array  # (R, V')


def _spread_out(value: Array, is_there: Flags) -> Array:
    """Values of some photos among those of all (V,), nan elsewhere."""
    wide = np.full(len(is_there), np.nan)
    wide[is_there] = value
    return wide


def _rotations(poses: RobotPoses, rotation: Array) -> list[_Rotation]:
    """What the file's numbers may mean but as they were read, and whether its angles are then in the other unit."""
    if poses.angles_rad is None:
        others = quaternion_readings(rotation) if poses.has_quaternions else []
        return [(one, False, one.rotation) for one in others]
    readings_of = partial(angle_readings, poses.angle_names)
    as_said = [one for one in readings_of(poses.angles_rad) if np.abs(one.rotation - rotation).max() < SAME]
    said = {one.what for one in as_said}
    found: list[_Rotation] = [
        (one, False, one.rotation) for one in readings_of(poses.angles_rad) if one.what not in said
    ]
    other = poses.angles_rad * (ANGLES["deg"] if poses.angle_unit == "rad" else 1 / ANGLES["deg"])
    if np.abs(other).max() <= MOST_TURNS_RAD:
        found += [(None if one.what in said else one, True, one.rotation) for one in readings_of(other)]
    return found


def _factors(poses: RobotPoses) -> list[float]:
    """Of the robot's ways, if they or the target's points are in another unit, or the frame is left-handed."""
    said = LENGTHS[poses.length_unit]
    of_robot = [unit / said for unit in LENGTHS.values()]
    of_target = [1 / unit for unit in LENGTHS.values()]
    sizes = list(dict.fromkeys(round(value, 12) for value in (1.0, *of_robot, *of_target)))
    return [sign * size for size in sizes for sign in (1.0, -1.0)]


def _carried(rotation: Array, shift: Array, *, is_turned_back: bool, is_back: bool) -> tuple[Array, Array]:
    """Poses as `rig_from_mechanism`: rotations (R, V, 3, 3) and ways (R, V, 3)."""
    turn = rotation.swapaxes(-1, -2) if is_turned_back else rotation
    if not is_back:
        return turn, np.broadcast_to(shift, turn.shape[:-1])
    back = turn.swapaxes(-1, -2)
    return back, -(back @ shift[:, :, None])[..., 0]


def _pairs(count: int) -> tuple[Rows, Rows]:
    """Pairs of poses, evenly spread if there are many."""
    first, second = np.triu_indices(count, 1)
    some = np.linspace(0, len(first) - 1, min(len(first), MOST_PAIRS)).astype(int)
    return first[some], second[some]


def _turns_of_pairs(rotation: Array) -> Array:
    """Rotation vectors (..., P, 3) from the second to the first pose of each pair."""
    first, second = _pairs(rotation.shape[-3])
    return log_rotation(rotation[..., first, :, :] @ rotation[..., second, :, :].swapaxes(-1, -2))


def _second_turn(seen: Array) -> float:
    """How much poses turn about a second axis, root mean square."""
    turns = _turns_of_pairs(seen[:, :3, :3])
    return float(np.sqrt(np.linalg.eigvalsh(turns.T @ turns / len(turns)).clip(min=0.0)[1]))


def _turning_alike(seen: Array, rotation: Array) -> Flags:
    """Which readings (R, V, 3, 3) turn by the camera's angles, as far as the best do; no sense changes these."""
    angle = np.linalg.norm(_turns_of_pairs(seen[:, :3, :3]), axis=-1)
    differs = np.abs(np.linalg.norm(_turns_of_pairs(rotation), axis=-1) - angle)
    near = np.quantile(differs, 0.3, axis=1)
    return np.asarray(near <= FAR_OFF * max(float(near.min()), 5 * FLOOR_RAD))


def _turns(seen: Array, carried: Array) -> tuple[Array, Array]:
    """The rotation in X of each reading (R, 3, 3), and by how much each pose is off (R, V): robust least squares."""
    first, second = _pairs(len(seen))
    a, c = _turns_of_pairs(seen[:, :3, :3]), _turns_of_pairs(carried)
    long_a, long_c = np.linalg.norm(a, axis=-1), np.linalg.norm(c, axis=-1)
    usable = (long_a < NEAR_HALF_TURN_RAD) & (long_c < NEAR_HALF_TURN_RAD)
    off = np.where(usable, np.abs(long_a - long_c), np.pi)
    error = np.stack([np.median(off[:, (first == v) | (second == v)], axis=1) for v in range(len(seen))], axis=1)
    x = np.zeros((len(carried), 3, 3))
    for _ in range(ROUNDS):
        weight = _robust(error, FLOOR_RAD)
        of_pair = weight[:, first] * weight[:, second] * usable
        x = _nearest_rotation(np.einsum("rp,pi,rpj->rij", of_pair, a, c))
        around = x[:, None] @ carried
        z = _nearest_rotation(np.einsum("rv,rvji,vjk->rik", weight, around, seen[:, :3, :3]))
        error = np.linalg.norm(log_rotation(seen[:, :3, :3] @ (around @ z[:, None]).swapaxes(-1, -2)), axis=-1)
    return x, error


def _robust(error: Array, floor: float) -> Array:
    """Weights (..., V) by what most poses are off: Cauchy's."""
    typical = np.maximum(np.median(error, axis=-1, keepdims=True), floor)
    weight: Array = 1 / (1 + (error / (2 * typical)) ** 2)
    return weight


def _nearest_rotation(matrix: Array) -> Array:
    left, _, right = np.linalg.svd(matrix)
    left[..., 2] *= np.linalg.det(left @ right)[..., None]
    rotation: Array = left @ right
    return rotation


def _ways(seen: Array, carried: Array, way: Array, x: Array, factors: Sequence[float]) -> Array:
    """How far each pose is off in mm (R, K, V), with factors (K,) on the robot's ways.

    `t_A = X R z + s factor X t + t_X` is linear in s, one over the target's size, in z and t_X; s keeps its limits.
    """
    factor = np.array(factors)
    turned = x[:, None] @ carried
    moved = (x[:, None] @ way[..., None])[..., 0]
    length = max(float(np.median(np.linalg.norm(seen[:, :3, 3], axis=1))), FLOOR_MM)
    rows = np.concatenate([turned, np.broadcast_to(np.eye(3), turned.shape)], axis=-1)  # (R, V, 3, 6)
    right = np.broadcast_to(seen[:, :3, 3], moved.shape)
    both = np.stack([right, moved], axis=-1)  # (R, V, 3, 2)
    weight = np.ones((len(carried), len(factor), len(seen)))
    ridge = 1e-9 * len(seen) * np.eye(6)
    off = np.zeros_like(weight)
    for _ in range(ROUNDS):
        normal = np.einsum("rkv,rvci,rvcj->rkij", weight, rows, rows, optimize=True) + ridge
        pull = np.einsum("rkv,rvci,rvcs->rkis", weight, rows, both, optimize=True)
        solved = np.linalg.solve(normal, pull)  # (R, K, 6, 2) of the camera's ways, and of the robot's
        left = both[:, None] - np.einsum("rvci,rkis->rkvcs", rows, solved, optimize=True)  # (R, K, V, 3, 2)
        curve = np.einsum("rkv,rkvc,rkvc->rk", weight, left[..., 1], left[..., 1])
        slope = np.einsum("rkv,rkvc,rkvc->rk", weight, left[..., 0], left[..., 1])
        whole = slope / np.maximum(curve, np.finfo(float).tiny) / factor
        scale = np.clip(np.where(np.isfinite(whole), whole, 1.0), *SIZES)
        off = np.linalg.norm(left[..., 0] - (scale * factor)[:, :, None, None] * left[..., 1], axis=-1)
        weight = _robust(off, FLOOR_PART * length)
    return off


def _judged(seen: Array, found: Sequence[PoseReading], poses: RobotPoses, *, is_camera_in_hand: bool) -> str:
    """A line on what poses look like, "" if they may be what was said."""
    turned, moved, away = _extent(seen)
    floor = np.array([FLOOR_RAD, max(FLOOR_MM, FLOOR_PART * away)])
    off = np.maximum([one.off for one in found], floor)
    rad, mm = off[int(np.log(off).sum(axis=1).argmin())]
    count = np.array([one.explains(rad, mm) for one in found])
    as_said = next(number for number, one in enumerate(found) if not one.changes)
    least = int(count.max()) - 1
    if count[as_said] >= least and _is_near(found[as_said].off, turned, moved, LOST):
        return ""
    if _is_near((rad, mm), turned, moved, MOST_OFF) and count.max() >= max(LEAST_EXPLAINED * len(seen), FEWEST):
        fits = [one for one, explained in zip(found, count.tolist(), strict=True) if explained >= least]
        simplest = sorted(
            (one for one in fits if not any(other.changes < one.changes for other in fits)),
            key=lambda one: (len(one.changes), float(np.log(np.maximum(one.off, floor)).sum())),
        )
        told = {_told(one, poses, is_camera_in_hand=is_camera_in_hand): one for one in simplest}
        looks = [f"{what} ({_off_words(one.off)}): {remedy}" for (what, remedy), one in told.items()]
        alike = f"; {len(looks)} readings explain them alike" if len(looks) > 1 else ""
        given = _off_words(found[as_said].off)
        return f"as they are read, {given}; these look like {', or '.join(looks[:MOST_NAMED])}{alike}"
    if _is_near(found[as_said].off, turned, moved, LOST):
        return ""
    return (
        f"the robot's poses do not fit the photos: as they are read, {_off_words(found[as_said].off)}, and no other "
        "unit, order or sense makes them fit; are they of these photos, and of one tool?"
    )


def _extent(seen: Array) -> tuple[float, float, float]:
    """How much the camera turned (rad) and moved (mm) from photo to photo, and how far off the target was (mm)."""
    turned = float(np.sqrt((_turns_of_pairs(seen[:, :3, :3]) ** 2).sum(axis=1).mean()))
    moved = max(float(np.linalg.norm(pose[:, :3, 3].std(axis=0))) for pose in (seen, invert(seen)))
    return turned, moved, float(np.median(np.linalg.norm(seen[:, :3, 3], axis=1)))


def _is_near(off: tuple[float, float], turned: float, moved: float, share: float) -> bool:
    """Whether most poses are off by no more than a share of what the camera turned and moved."""
    return off[0] <= share * turned and off[1] <= share * moved


def _off_words(off: tuple[float, float]) -> str:
    return f"turns off by {figure(float(np.rad2deg(off[0])), 2)} deg and ways by {figure(off[1], 2)} mm"


def _told(one: PoseReading, poses: RobotPoses, *, is_camera_in_hand: bool) -> tuple[str, str]:
    """What a reading is, and how to say it."""
    looks, remedies = [], []
    if one.rotation is not None:
        looks.append(one.rotation.what)
        remedies.append(one.rotation.remedy)
    if one.is_angle_unit_other:
        unit = "deg" if poses.angle_unit == "rad" else "rad"
        looks.append(f"angles in {unit}")
        remedies.append(f"name their columns so, or give --unit {unit}")
    if one.is_turned_back:
        looks.append("rotations written the other way, as transposed matrices")
        remedies.append("transpose them")
    if one.is_inverted:
        looks.append("base_from_flange" if poses.is_inverted else "flange_from_base")
        hand = (
            "leave out --target-in-hand"
            if not is_camera_in_hand
            else "give --target-in-hand if the robot holds the target"
        )
        remedies.append(f"{'leave out' if poses.is_inverted else 'give'} --inverted, or {hand}")
    if one.shift:
        looks.append(f"poses that stand a row too {'early' if one.shift < 0 else 'late'}")
        remedies.append("name each pose's own photo")
    if one.factor < 0:
        looks.append("poses in a left-handed frame")
        remedies.append("change the sign of x, y and z, of the positions alone")
    if abs(one.factor) != 1:
        _add_unit(abs(one.factor), poses, looks, remedies)
    return "; ".join(looks), " and ".join(remedies)


def why_size(poses: RobotPoses, size: float) -> str:
    """What the size of a target by the robot's ways, as a part of what its file says, looks like; "" if it may be."""
    if SIZES[0] <= size <= SIZES[1]:
        return ""
    looks: list[str] = []
    remedies: list[str] = []
    for factor in _factors(poses):
        if factor > 0 and SIZES[0] <= size * factor <= SIZES[1]:
            _add_unit(factor, poses, looks, remedies)
    told = f"by the robot's ways the target has {figure(100 * size, 3)} % of the size that its file says"
    if not looks:
        return f"{told}, which no unit explains: measure the target, and a way of the robot"
    return f"{told}; these look like {', or '.join(looks)}: {', or '.join(remedies)}"


def _add_unit(factor: float, poses: RobotPoses, looks: list[str], remedies: list[str]) -> None:
    """What a factor on the robot's ways means."""
    said = poses.length_unit
    of_robot = [unit for unit, mm in LENGTHS.items() if abs(mm / LENGTHS[said] / factor - 1) < SAME]
    of_target = [unit for unit, mm in LENGTHS.items() if abs(factor * mm - 1) < SAME]
    parts = [
        (
            f"positions in {unit} that are taken for {said}",
            f"name the columns x_{unit}, y_{unit}, z_{unit}" if poses.is_unit_named else f"give --unit {unit}",
        )
        for unit in of_robot
    ]
    parts += [(f"target's points in {unit} that are taken for mm", "give them in mm") for unit in of_target]
    looks.append(" or ".join(look for look, _ in parts))
    remedies.append(" or ".join(remedy for _, remedy in parts))
