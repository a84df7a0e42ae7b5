"""A measured print in 3D: rings coloured by how far out or in they are, with arrows in their plane."""

import numpy as np

from calib.core.se3 import exp_rotation
from calib.draw.style import nice
from calib.measure_target.record import AsBuiltRecord, Deviations, deviations_of, told_motion
from designer.base.arrays import Array
from designer.base.words import figure
from designer.page.blocks import View3d
from designer.page.scene import Layer, Segments, Surface
from designer.target import TargetGeometry
from designer.target_scene import target_scene

BODY, INK, NOT_KNOWN, ARROWS, BAD = "#f2f2ef", "#3d434b", "#b5b8bd", "#009e73", "#cc3377"
COLOURS = ("#3fa7ff", "#1c6bb0", "#222222", "#c25200", "#ff9a3d")
"""In to out, dark in the middle, which is seen on white; colour-blind people tell blue from orange."""
FAR_PERCENT = 98
"""Of the rings are within the colours' scale, and have arrows that are not too long."""
ARROW_SHARE = 1.5
"""Of the distance between rings: the length of the arrow of a ring that is far off."""
ARROW_WIDTH_SHARE, LIFT_SHARE = 0.22, 0.03
"""Of the distance between rings: how wide an arrow is, and how high above its face, not to be hidden by it."""
MOST_RINGS = 15_000
LEAST_MM = 1e-6


def datum_words(record: AsBuiltRecord) -> str:
    """Against what faces are told, of pieces."""
    if record.seats is None:
        return ""
    alike = ", and what all stand out alike is taken off" if record.seats.common_height_mm is not None else ""
    return f" Faces as in the table of them: against the {record.seats.piece}s that sit well{alike}."


def measure_view(record: AsBuiltRecord, target: TargetGeometry) -> View3d | None:
    """The scene; None if no ring is known, or so many that the page would be slow."""
    found = deviations_of(record, target)
    if not 0 < len(found.known) <= MOST_RINGS:
        return None
    known = found.in_face_mm[found.known]
    most_mm = nice(_far(known[:, 2]))
    factor = nice(ARROW_SHARE * ring_distance_mm(target) / max(_far(known[:, :2]), LEAST_MM), is_down=True)
    layers = [Layer(f"where to in the plane, {factor:g} times as far", (_arrows(found, target, factor),))]
    if not target.is_planar:
        title = f"outlines of the faces, {factor:g} times as far off"
        layers.append(Layer(title, (_faces(record, target, factor),), is_shown=record.seats is not None))
    bad = () if record.seats is None or not record.seats.bad else (
        (BAD, f"outline of a {record.seats.piece} that sits badly"),
    )  # fmt: skip
    heights = found.in_face_mm[:, 2].tolist()
    colours = (colour(0.5 + 0.5 * one / most_mm) if np.isfinite(one) else NOT_KNOWN for one in heights)
    scene = target_scene(
        target, body_colour=BODY, ink_colour=INK, ring_colours=tuple(colours),
        legend=(*_legend(most_mm, found), *bad), more=tuple(layers),
        has_numbers=record.seats is not None,
    )  # fmt: skip
    return View3d(
        f"Where faces and {target.feature_word} came out", scene, _alt(found, target),
        f"Colour: out of the face or into it. Green arrows: where to in its plane, {factor:g} times as far. The "
        f"stretch of the whole print is taken off.{datum_words(record)}",
    )  # fmt: skip


def _alt(found: Deviations, target: TargetGeometry) -> str:
    worst = int(found.known[np.argmax(found.size_mm[found.known])])
    middle = float(np.median(found.size_mm[found.known]))
    words = target.feature_word
    return (
        f"{len(found.known)} {words} coloured by how far out or in they lie against the design: half are within "
        f"{figure(middle, 2)} mm of it; {words[:-1]} {worst} on face {int(target.ring_face[worst])} is off most, "
        f"{figure(float(found.size_mm[worst]), 2)} mm."
    )


def _far(values_mm: Array) -> float:
    """What nearly all sizes are below; vectors (N, 2) have a length."""
    size = np.abs(values_mm) if values_mm.ndim == 1 else np.linalg.norm(values_mm, axis=1)
    return float(np.percentile(size, FAR_PERCENT))


def ring_distance_mm(target: TargetGeometry) -> float:
    """Between neighbours of a lattice."""
    return float(np.linalg.norm(target.lattice_mm.reshape(-1, 2), axis=1).min())


def colour(share: float) -> str:
    """The colour of a share of the scale, from the lowest to the highest."""
    channels = np.array([[int(text[k : k + 2], 16) for k in (1, 3, 5)] for text in COLOURS])
    mixed = (round(float(np.interp(share, np.linspace(0, 1, len(COLOURS)), channel))) for channel in channels.T)
    return "#" + "".join(f"{part:02x}" for part in mixed)


def _legend(most_mm: float, found: Deviations) -> tuple[tuple[str, str], ...]:
    named = ((-1.0, f"{most_mm:.3g} mm in, or more"), (0.0, "as designed"), (1.0, f"{most_mm:.3g} mm out, or more"))
    legend = [(colour(0.5 + 0.5 * share), text) for share, text in named]
    unseen = len(found.size_mm) > len(found.known)
    return (*legend, (ARROWS, "where to in the plane"), *(((NOT_KNOWN, "not known"),) if unseen else ()))


def _arrows(found: Deviations, target: TargetGeometry, factor: float) -> Surface:
    """A flat triangle from each ring to where it lies in its face's plane, exaggerated."""
    rings, distance = found.known, ring_distance_mm(target)
    frame = target.target_from_face[target.ring_face[rings]]
    step = factor * found.in_face_mm[rings, :2]
    length = np.linalg.norm(step, axis=1)
    across = np.stack([-step[:, 1], step[:, 0]], axis=1) / np.maximum(length, 1e-12)[:, None]
    half = 0.5 * ARROW_WIDTH_SHARE * distance * across
    start = target.center_in_face_mm[rings]
    corners = np.repeat(start[:, None, :], 3, axis=1)
    corners[:, 0, :2] += half
    corners[:, 1, :2] += step
    corners[:, 2, :2] -= half
    corners[:, :, 2] = LIFT_SHARE * distance
    placed = np.einsum("rij,rkj->rki", frame[:, :3, :3], corners) + frame[:, None, :3, 3]
    return Surface(placed.reshape(-1, 3), np.arange(3 * len(rings)).reshape(-1, 3), ARROWS)


def _faces(record: AsBuiltRecord, target: TargetGeometry, factor: float) -> Segments:
    """The outlines of the faces, moved by a multiple of their motions; those of pieces that sit badly stand out."""
    ends, colours = [], list[str]()
    bad = set() if record.seats is None else {one.face for one in record.seats.bad}
    motion = told_motion(record, target)
    for face in np.flatnonzero(record.face_is_determined & np.isfinite(motion).all(axis=1)).tolist():
        frame, outline = target.target_from_face[face], target.outline_mm[face]
        corners = np.column_stack([outline, np.zeros(len(outline))])
        turn = exp_rotation(factor * motion[face, 3:])
        moved = (corners @ turn.T + factor * motion[face, :3]) @ frame[:3, :3].T + frame[:3, 3]
        ends.append(np.stack([moved, np.roll(moved, -1, axis=0)], axis=1))
        colours += [BAD if face in bad else ARROWS] * len(moved)
    return Segments(np.concatenate(ends), tuple(colours)) if ends else Segments(np.zeros((0, 2, 3)), (ARROWS,))
