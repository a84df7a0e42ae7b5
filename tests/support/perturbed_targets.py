"""Targets to be perturbed, and an error model with every source in it."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
from scipy.spatial.transform import Rotation

from designer.base.arrays import Array
from designer.kinds.board import BoardSpec
from designer.kinds.ico import IcoSpec
from designer.kinds.layout import lay_out
from designer.target import TargetGeometry
from designer.tolerance.made import Made
from designer.tolerance.model import ErrorModel, draw_values
from designer.tolerance.prior import shape_prior
from designer.tolerance.source import Amount
from designer.tolerance.sources import SOURCES

Values = dict[str, Array]

ICO = IcoSpec(60.0, 5, 7.0, 0.45, 10.0, 1.0, 0.5)
BOARD = BoardSpec((90.0, 60.0), 5.0, 7, 5, "triangular", 7.0, 0.45, 10.0, 1.0, 4.0, dots=True)
NATURAL = {"mm": 0.3, "rad": 0.01, "1": 0.004, "K": 20.0}
"""Sizes of errors that are large for a print and small for mathematics."""
MOTIONS = ("face_rotation", "face_tilt", "face_shift", "face_offset")
BENDING = ("face_bow", "warp", "bow_twist")


def made_by_others() -> TargetGeometry:
    """Two squares with rings beside and above their middles, in frames that lie anywhere."""
    rng = np.random.default_rng(5)
    frame = np.tile(np.eye(4), (2, 1, 1))
    frame[:, :3, :3] = Rotation.from_rotvec([[0.3, -0.2, 0.9], [1.4, 0.5, 0.1]]).as_matrix()
    frame[:, :3, 3] = [[10.0, 5.0, 30.0], [-40.0, 8.0, 2.0]]
    outline = np.array([[-1.0, -1.0], [5.0, -1.0], [5.0, 3.0], [-1.0, 3.0]]) * 10
    in_face = np.column_stack([rng.uniform(0, 30, (16, 2)), rng.normal(0, 0.1, 16)])
    face = np.repeat([0, 1], 8)
    return TargetGeometry(
        source="measured",
        spec=None,
        ring_face=face,
        ring_index=np.column_stack([np.arange(16), np.arange(16) ** 2]),
        center_mm=np.einsum("rij,rj->ri", frame[face, :3, :3], in_face) + frame[face, :3, 3],
        radius_outer_mm=np.full(16, 2.0),
        radius_inner_mm=np.where(np.arange(16) % 5 == 0, 0.0, 0.9),
        is_dot=np.arange(16) % 5 == 0,
        target_from_face=frame,
        outline_mm=np.stack([outline, outline + 1]),
        window_mm=np.stack([0.9 * outline, outline + 1]),
        face_code=np.array([-1, 3]),
        lattice_mm=np.tile([[10.0, 0.0], [5.0, 8.66]], (2, 1, 1)),
        face_covariance=np.tile(np.eye(6), (2, 1, 1)),
    )


TARGETS: dict[str, Callable[[], TargetGeometry]] = {
    "ico": cache(lambda: lay_out(ICO)),
    "board": cache(lambda: lay_out(BOARD)),
    "others": cache(made_by_others),
}
FULL = ErrorModel(
    name="full",
    title="every source",
    amounts=tuple(
        (name, Amount("normal", 0.05 if name == "ink_bleed" else NATURAL[source.unit]))  # holes stay open
        for name, source in SOURCES.items()
    ),
    expansion_per_kelvin=1e-4,
    layer_height_mm=0.2,
)


def ico() -> TargetGeometry:
    return TARGETS["ico"]()


def board() -> TargetGeometry:
    return TARGETS["board"]()


def one(name: str, target: TargetGeometry, *numbers: float) -> Values:
    """The same numbers for each instance of one source."""
    return {name: np.tile(np.array(numbers, dtype=np.float64), (SOURCES[name].instances(target), 1))}


def drawn(target: TargetGeometry, seed: int, *names: str) -> Values:
    return draw_values(target, FULL.only(*(names or FULL.sources)), np.random.default_rng(seed))


def made_with(errors: ErrorModel, target: TargetGeometry) -> Made:
    """A way of making by its errors."""
    return Made(errors.name, "", shape_prior(target, errors))


def with_piece(shown: TargetGeometry, drawing: TargetGeometry, place: int, piece: int, thirds: int) -> TargetGeometry:
    """A solid of triangles with the pattern of one face of a drawing in the place of another, turned by thirds."""
    angle = 2 * np.pi * thirds / 3
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    (there,), (drawn,) = np.nonzero(drawing.ring_face == place), np.nonzero(drawing.ring_face == piece)
    moved = drawing.center_in_face_mm[drawn, :2] @ turn.T
    nearest = np.linalg.norm(drawing.center_in_face_mm[there, None, :2] - moved, axis=2).argmin(axis=1)
    outer, inner, is_dot = (np.array(one) for one in (shown.radius_outer_mm, shown.radius_inner_mm, shown.is_dot))
    for values, source in (
        (outer, drawing.radius_outer_mm),
        (inner, drawing.radius_inner_mm),
        (is_dot, drawing.is_dot),
    ):
        values[there] = source[drawn[nearest]]
    return replace(shown, source="perturbed", radius_outer_mm=outer, radius_inner_mm=inner, is_dot=is_dot)
