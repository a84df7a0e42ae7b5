"""What photos do not tell of a target: where it is, how it is turned, and how large it is.

The measured target is laid over the nominal one so that its rings come nearest, in least squares: the inner constraints
of a free network (Grafarend and Schaffrin 1974), which prefer no ring. Only rings take part whose faces the views join,
and of them not those that few views show, or that lie unlike all others: what is not known, or odd, of them would be
told of all faces.
The scale is that of the rings as they are; the rigid motion is that of the rings without the strain of the whole print,
which acts about the target's origin: a print that is only shrunk has then no face that moved, even if half of it was
seen.
"""

from dataclasses import dataclass, replace

import numpy as np

from calib.core.linear_algebra import pseudo_inverse
from calib.core.se3 import exp_rotation, invert, log_rotation, make_pose, skew, transform
from calib.core.types import Observations
from calib.measure_target.problem import HeldPoses, State
from calib.measure_target.unknowns import (
    RingPlaces,
    TargetUnknowns,
    Unknowns,
    in_face_mm,
    nominal_shape,
    place_rings,
    strain_matrix,
    strain_numbers,
)
from designer.base.arrays import Array, Flags, Rows

LEAST_RINGS = 3
"""Of a face in a view that tell its pose."""
FEW_VIEWS = 3
"""With fewer views of a face of several a mistake in one of them would not be seen."""
THIN = 1e-3
"""Points this much thinner than long lie on a line."""
NO_STRAIN = 1e-7
"""Standard deviation of a strain that is none: 0.01 um on 100 mm."""
SHAPE = np.array(
    [[1.0, -1, 0, 0, 0, 0], [1, 1, -2, 0, 0, 0], [0, 0, 0, 1, 0, 0], [0, 0, 0, 0, 1, 0], [0, 0, 0, 0, 0, 1]]
)
"""What a strain's six numbers have beside size."""
GAUGE_PART = 1e-3
"""Standard deviation of the constraints of the descent, as a part of the target's size, for observations of 1 px. They
hold what the photos do not tell, so any value gives the same shape."""


@dataclass(frozen=True, eq=False)
class SeenParts:
    """Which rings and faces were seen, and which faces the views join."""

    ring: Flags  # (R,)
    face: Flags  # (F,) enough of it for a pose in some view
    group: Rows  # (F,) faces with one number are joined by views; -1: not seen
    views: Rows  # (F,) in how many views
    outlying: Flags  # (F,) lie unlike all others, see `calib.measure_target.accuracy`

    @property
    def main(self) -> Flags:
        """The faces of the largest group."""
        seen = self.group[self.group >= 0]
        main: Flags = self.group == np.bincount(seen).argmax() if len(seen) else self.face
        return main

    @property
    def datum(self) -> Flags:
        """The faces by which the target is laid over the nominal one.  # (F,)"""
        often = self.main & ~few_views(self.views) & ~self.outlying
        return often if often.any() else self.main


def few_views(views: Rows) -> Flags:
    """The faces of several that few views show, from how many show each.  # (F,)"""
    return (views < FEW_VIEWS) & (len(views) > 1)


def what_is_seen(
    unknowns: Unknowns, sets: list[tuple[Observations, Flags]], frame: tuple[Rows, ...] | None = None
) -> SeenParts:
    """Which rings and faces the used observations (M,) of some sets show; photos of one frame join their faces."""
    target = unknowns.target
    ring, views = np.zeros(target.ring_count, dtype=bool), np.zeros(target.face_count, dtype=np.int64)
    shown: list[Flags] = []
    for seen, is_used in sets:
        ring[seen.point[is_used]] = True
        count = np.zeros((seen.view_count, target.face_count), dtype=np.int64)
        np.add.at(count, (seen.view[is_used], target.ring_face[seen.point[is_used]]), 1)
        shown.extend(count >= LEAST_RINGS)
    for one in shown:
        views += one
    joined = np.array(shown)
    if frame is not None:
        joined = np.zeros((max(int(rows.max(initial=-1)) for rows in frame) + 1, target.face_count), dtype=bool)
        np.logical_or.at(joined, np.concatenate(frame), np.array(shown))
    # Faces that do not move against each other need no view that joins them.
    group = _groups(joined) if unknowns.has_motion else np.where(views > 0, 0, -1)
    return SeenParts(ring, views > 0, group, views, np.zeros_like(views, dtype=bool))


def _groups(shown: Flags) -> Rows:
    """Numbers of the groups of faces that views join, from what each view shows (V, F)."""
    linked = shown.T.astype(np.int64) @ shown.astype(np.int64) > 0
    group = np.full(shown.shape[1], -1)
    for face in range(shown.shape[1]):
        if group[face] >= 0 or not linked[face, face]:
            continue
        member = np.zeros(shown.shape[1], dtype=bool)
        grown = linked[face]
        while (grown != member).any():
            member = grown
            grown = linked[member].any(axis=0)
        group[member] = group.max() + 1
    return group


def datum_rings(unknowns: Unknowns, seen: SeenParts) -> Flags:
    """The rings that lie over the nominal ones: the seen ones of the datum's faces.  # (R,)"""
    return seen.ring & seen.datum[unknowns.target.ring_face]


def rigid_design(position_mm: Array) -> Array:
    """Displacements of rings (R, 3, 6) by a rotation vector (rad) and a shift (mm)."""
    design = np.zeros((len(position_mm), 3, 6))
    design[:, :, :3] = -skew(position_mm)
    design[:, :, 3:] = np.eye(3)
    return design


def rigid_fit(position_mm: Array) -> Array:
    """What turns displacements (3 R,) of rings into the rigid motion that fits them best.  # (6, 3 R)"""
    return pseudo_inverse(rigid_design(position_mm).reshape(-1, 6))


def scale_fit(position_mm: Array) -> Array:
    """What turns displacements (3 R,) of rings into the scale that fits them best, a motion aside.  # (3 R,)"""
    offset = position_mm - position_mm.mean(axis=0)
    row: Array = offset.ravel() / (offset**2).sum()
    return row


def gauge_rows(unknowns: Unknowns, seen: SeenParts, size_mm: float) -> Array:
    """Rows over the shared unknowns (G, count): the motion and scale of the datum's rings, whitened.

    What strains a print as a whole, beside its size, an assembly has not: its pieces were printed one by one.
    """
    rings = place_rings(unknowns, nominal_shape(unknowns.target))
    which = datum_rings(unknowns, seen)
    if not unknowns.count or not which.any():
        return np.zeros((0, unknowns.count))
    moved = by_shared_dense(unknowns, rings)[which].reshape(-1, unknowns.count)
    rows: list[Array] = []
    if unknowns.has_motion:  # else poses take the motion up
        moves = np.array(moved)
        moves[:, : unknowns.first_motion] = 0.0
        rigid = rigid_fit(rings.position_mm[which]) @ moves
        rigid[3:] /= size_mm
        rows.extend(rigid)
    if unknowns.has_strain:
        rows.append(scale_fit(rings.position_mm[which]) @ moved)
    gauge = np.array(rows).reshape(-1, unknowns.count) / GAUGE_PART
    if unknowns.is_assembled and unknowns.has_strain:
        shape = np.zeros((len(SHAPE), unknowns.count))
        shape[:, : unknowns.first_motion] = SHAPE / NO_STRAIN
        gauge = np.concatenate([gauge, shape])
    return gauge


def by_shared_dense(unknowns: Unknowns, rings: RingPlaces) -> Array:
    """The rings' derivatives by all shared unknowns.  # (R, 3, count)"""
    dense = np.zeros((len(rings.position_mm), 3, unknowns.count + 1))
    column = unknowns.column[unknowns.target.ring_face]  # -1: into the spare column
    np.put_along_axis(dense, np.repeat(column[:, None], 3, axis=1), rings.by_shared, axis=2)
    return np.ascontiguousarray(dense[:, :, :-1])


def best_motion(source: Array, aim: Array, *, with_scale: bool = False) -> tuple[float, Array, Array]:
    """Scale, rotation (3, 3) and shift (3,) that bring points (N, 3) nearest to others (Umeyama 1991)."""
    a, b = source - source.mean(axis=0), aim - aim.mean(axis=0)
    u, values, vt = np.linalg.svd(b.T @ a)
    sign = np.array([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    rotation: Array = (u * sign) @ vt
    scale = float((values * sign).sum() / (a**2).sum()) if with_scale else 1.0
    shift: Array = aim.mean(axis=0) - scale * rotation @ source.mean(axis=0)
    return scale, rotation, shift


def laid_over(unknowns: Unknowns, seen: SeenParts, state: State) -> State:
    """The same state with the target laid over the nominal one, rings' offsets without a motion of their face."""
    which = datum_rings(unknowns, seen)
    nominal = unknowns.target.center_mm[which]
    if len(nominal) >= LEAST_RINGS:
        if unknowns.has_strain:
            scale, _, _ = best_motion(place_rings(unknowns, state.shape).position_mm[which], nominal, with_scale=True)
            state = moved_target(unknowns, state, scale, np.eye(3), np.zeros(3))
        _, rotation, shift = best_motion(place_rings(unknowns, state.shape).unstrained_mm[which], nominal)
        strained = rotation @ (np.eye(3) + strain_matrix(state.shape.strain)) @ rotation.T
        state = moved_target(unknowns, state, 1.0, rotation, strained @ shift)
    return replace(state, shape=folded(unknowns, seen, state.shape))


def moved_target(unknowns: Unknowns, state: State, scale: float, rotation: Array, shift_mm: Array) -> State:
    """The state with each ring x at `scale rotation x + shift`; the poses follow, so the images stay as they are.

    With `A = I + strain`, `s R A T M p + t = A' T M' p` holds for `A' = s R A R'` and
    `M' = T^-1 (R, A'^-1 t) T M`.
    """
    frame, shape = unknowns.target.target_from_face, state.shape
    affine = scale * rotation @ (np.eye(3) + strain_matrix(shape.strain)) @ rotation.T
    change = make_pose(rotation, np.linalg.inv(affine) @ shift_mm)
    motion = invert(frame) @ change @ frame @ make_pose(exp_rotation(shape.motion[:, :3]), shape.motion[:, 3:])
    numbers = np.concatenate([log_rotation(motion[:, :3, :3]), motion[:, :3, 3]], axis=1)

    def follow(pose: Array) -> Array:
        turned = pose[:, :3, :3] @ rotation.T
        return make_pose(turned, scale * pose[:, :3, 3] - turned @ shift_mm)

    moved = TargetUnknowns(strain_numbers(affine - np.eye(3)), numbers, shape.bow, shape.offset_mm)
    held = state.held
    if held is not None:  # a larger target is seen by cameras that are farther apart
        apart = make_pose(held.cam_from_rig[:, :3, :3], scale * held.cam_from_rig[:, :3, 3])
        held = HeldPoses(apart, follow(held.rig_from_target))
    return State(state.cameras, tuple(map(follow, state.poses)), moved, held)


def fit_rings(unknowns: Unknowns, seen: SeenParts) -> list[Rows]:
    """Of each face the rings that tell where it is: the seen ones, or all where these are few or on a line."""
    target = unknowns.target
    rows = []
    for face in range(target.face_count):
        own = np.flatnonzero(target.ring_face == face)
        some = own[seen.ring[own]]
        rows.append(some if len(some) > LEAST_RINGS and _span_a_plane(target.center_in_face_mm[some]) else own)
    return rows


def _span_a_plane(position_mm: Array) -> bool:
    """Whether points (N, 3) lie on no line, which they could be turned about."""
    length = np.linalg.svd(position_mm - position_mm.mean(axis=0), compute_uv=False)
    return bool(length[1] > THIN * length[0])


def folded(unknowns: Unknowns, seen: SeenParts, shape: TargetUnknowns) -> TargetUnknowns:
    """The same rings, what their offsets have of a rigid motion given to the faces."""
    target = unknowns.target
    inside = in_face_mm(unknowns, shape)
    bent = inside - shape.offset_mm
    motion, offset = np.array(shape.motion), np.array(shape.offset_mm)
    for face, rows in enumerate(fit_rings(unknowns, seen)):
        if len(rows) < LEAST_RINGS:
            continue
        own = target.ring_face == face
        _, rotation, shift = best_motion(target.center_in_face_mm[rows], inside[rows])
        part = make_pose(rotation, shift)
        whole = make_pose(exp_rotation(motion[face, :3]), motion[face, 3:]) @ part
        motion[face] = np.concatenate([log_rotation(whole[:3, :3]), whole[:3, 3]])
        offset[own] = transform(invert(part), inside[own]) - bent[own]
    return TargetUnknowns(shape.strain, motion, shape.bow, offset)
