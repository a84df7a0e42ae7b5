"""Where a robot's flange was, from its bag: `transforms_in(bag).poses("base_link", "tool0")`, `poses_in(bag, topic)`.

A transform takes points from the child's frame to the parent's, in metres: parent_from_child (REP 105, tf2). Between
two frames stands the product of those on the way, each at one time; what moves is interpolated between its stamps.
"""

from array import array
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import cast

import numpy as np

from calib.core.se3 import MAX_DISTANCE_MM, interpolated, invert, make_pose, rotation_of_quaternion
from calib.images.bag import OLD_TRANSFORMS, POSE, TRANSFORM, TRANSFORMS, Bag, stamp_ns
from calib.observe.robot_poses import RobotPoses
from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.base.words import first_few, printable, shown, suggestion

MOST_TRANSFORMS, MOST_FRAMES = 3_000_000, 2000
BACK_S = 1.0
"""Stamps that go back by more are of a clock that was set, or of two recordings."""
ROW = 8
"""Numbers of a transform: its time in s, x y z in m, qx qy qz qw."""


_MOVED = attrgetter(
    "header.frame_id", "child_frame_id", *(f"transform.translation.{one}" for one in "xyz"),
    *(f"transform.rotation.{one}" for one in "xyzw"),
)  # fmt: skip
_POSED = attrgetter(*(f"pose.position.{one}" for one in "xyz"), *(f"pose.orientation.{one}" for one in "xyzw"))


@dataclass(frozen=True, eq=False)
class FrameTrack:
    """A child's frame in its parent's, over time."""

    time_s: Array  # (N,) ascending; (1,) of one that stands still
    parent_from_child: Array  # (N, 4, 4)

    def at(self, time_s: Array) -> Array:
        """At times (T,), held before its first and after its last.  # (T, 4, 4)"""
        if len(self.time_s) == 1:
            return np.broadcast_to(self.parent_from_child, (len(time_s), 4, 4))
        return interpolated(self.time_s, self.parent_from_child, time_s)


@dataclass(frozen=True, eq=False)
class Transforms:
    """The frames of a bag: `transforms.poses("base_link", "tool0").base_from_flange`."""

    origin: str
    edges: Mapping[tuple[str, str], FrameTrack]  # by parent and child

    def poses(self, base: str, flange: str) -> RobotPoses:
        """The flange in the base's frame, at the stamps of what moves most often between them.

        Raises:
            InputError: no such frame, no way between them, or nothing on it moves.
        """
        keys, downs = self._way(base.strip("/"), flange.strip("/"))
        way = [self.edges[key] for key in keys]
        moving = [edge for edge in way if len(edge.time_s) > 1]
        if not moving:
            raise InputError(
                f"{self.origin}: {shown(flange)} does not move against {shown(base)}; name the moving flange"
            )
        begin, end = (max(edge.time_s[0] for edge in moving), min(edge.time_s[-1] for edge in moving))
        time_s = max((edge.time_s for edge in moving), key=len)
        time_s = time_s[(time_s >= begin) & (time_s <= end)]
        if len(time_s) < 2:
            raise InputError(
                f"{self.origin}: the transforms between {shown(base)} and {shown(flange)} are of other times"
            )
        pose = np.broadcast_to(np.eye(4), (len(time_s), 4, 4))
        for edge, is_down in zip(way, downs, strict=True):
            step = edge.at(time_s)
            pose = pose @ (step if is_down else invert(step))
        return stream(f"{self.origin}: {base} to {flange}", time_s, pose)

    def _way(self, base: str, flange: str) -> tuple[list[tuple[str, str]], list[bool]]:
        """The edges from one frame to another, and whether each leads from a parent to its child."""
        frames = sorted({frame for key in self.edges for frame in key})
        for frame in (base, flange):
            if frame not in frames:
                hint = suggestion(frame, frames) or f"; there are {first_few([printable(one) for one in frames], 20)}"
                raise InputError(f"{self.origin}: no frame {shown(frame)}{hint}")
        came: dict[str, tuple[str, tuple[str, str]]] = {base: ("", ("", ""))}
        row = [base]
        for frame in row:
            for key in self.edges:
                other = key[1] if key[0] == frame else key[0] if key[1] == frame else frame
                if other not in came:
                    came[other] = frame, key
                    row.append(other)
        if flange not in came:
            others = [one for one in frames if one not in came]
            raise InputError(
                f"{self.origin}: no transforms lead from {shown(base)} to {shown(flange)}: {first_few(row, 12)} are "
                f"connected, and apart from them {first_few(others, 12)}"
            )
        keys, downs = list[tuple[str, str]](), list[bool]()
        while flange != base:
            before, key = came[flange]
            if len(parents := [one for one, child in self.edges if child == key[1]]) > 1:
                raise InputError(
                    f"{self.origin}: frame {shown(key[1])} has two parents, {' and '.join(map(shown, parents[:2]))}; a "
                    "tree has one: leave out the publisher of the other"
                )
            keys, downs, flange = [key, *keys], [key[0] == before, *downs], before
        return keys, downs


def transforms_in(bag: Bag) -> Transforms:
    """All frames that a bag's tf topics tell of.

    Raises:
        InputError: there are none, they are too many, or their stamps go back.
    """
    topics = bag.of_types(TRANSFORMS, OLD_TRANSFORMS)
    if not topics:
        bag.topic(None, "--tf", TRANSFORMS)  # says what there is
    rows: dict[tuple[str, str], array[float]] = {}
    still: set[tuple[str, str]] = set()
    count = 0
    for place, message in bag.messages(topics):
        for one in getattr(message, "transforms"):  # noqa: B009
            parent, child, *move = _MOVED(one)
            key = parent.strip("/"), child.strip("/")
            if place.topic.endswith("tf_static"):
                still.add(key)
            rows.setdefault(key, array("d")).extend((1e-9 * (stamp_ns(one) or place.log_ns), *move))
            count += 1
        if count > MOST_TRANSFORMS or len(rows) > MOST_FRAMES:
            most = f"{MOST_TRANSFORMS} transforms" if count > MOST_TRANSFORMS else f"{MOST_FRAMES} frames"
            raise InputError(f"{bag.path}: more than {most}; cut the bag, or filter its topics")
    edges = {}
    for key, values in rows.items():
        time_s, pose = _ordered(f"{bag.path}: transforms of {shown(key[1])}", values)
        edges[key] = FrameTrack(time_s[-1:], pose[-1:]) if key in still else FrameTrack(time_s, pose)
    return Transforms(str(bag.path), edges)


def poses_in(bag: Bag, name: str | None) -> RobotPoses:
    """Those of a topic of geometry_msgs/PoseStamped or TransformStamped: base_from_flange.

    Raises:
        InputError: no such topic, or its stamps go back.
    """
    topic = bag.topic(name, "--robot", POSE, TRANSFORM)
    values = array("d")
    for place, message in bag.messages([topic]):
        move = _POSED(message) if topic.type == POSE else _MOVED(message)[2:]
        values.extend((1e-9 * (stamp_ns(message) or place.log_ns), *move))
    origin = f"{bag.path}: {printable(topic.name)}"
    return stream(origin, *_ordered(origin, values))


def stream(origin: str, time_s: Array, pose: Array) -> RobotPoses:
    """Poses over time, as a robot's are."""
    names = tuple(f"{one:.9f}" for one in time_s.tolist())
    return RobotPoses(names, pose, origin, length_unit="m", is_unit_named=True, time_s=time_s)


def _ordered(origin: str, values: Sequence[float]) -> tuple[Array, Array]:
    """Times (N,), each once and ascending, and poses (N, 4, 4) of rows of numbers; InputError: no such rows."""
    table = np.frombuffer(cast("array[float]", values), np.float64).reshape(-1, ROW)
    length = np.linalg.norm(table[:, 4:], axis=1)
    is_fine = np.isfinite(table).all(axis=1) & (np.abs(length - 1) < 0.01)
    is_fine &= np.abs(table[:, 1:4]).max(axis=1, initial=0.0) < 1e-3 * MAX_DISTANCE_MM
    if not is_fine.all():
        raise InputError(
            f"{origin}: {int((~is_fine).sum())} of {len(table)} are no rigid motions, such as x y z qx qy qz qw "
            f"{table[~is_fine][0, 1:].tolist()}; mend who publishes them"
        )
    if fault := order_fault(origin, table[:, 0]):
        raise InputError(fault)
    time_s, last = np.unique(table[::-1, 0], return_index=True)  # of one stamp the last that was sent
    table = table[::-1][last]
    return time_s, make_pose(rotation_of_quaternion(table[:, [7, 4, 5, 6]]), 1e3 * table[:, 1:4])


def order_fault(origin: str, time_s: Array) -> str:
    """Where stamps go back far, which a clock that was set does, or a second recording; "": nowhere."""
    late = np.maximum.accumulate(time_s) - time_s
    row = int(np.argmax(late > BACK_S))
    if not late[row] > BACK_S:
        return ""
    return (
        f"{origin}: its time stamps go back by {late[row]:.6g} s at message {row + 1} of {len(late)}: a clock was set, "
        "or two recordings are in one; cut the bag there"
    )
