"""What making a target takes, in money or hours, by its size: `parse_effort("12EUR + 3EUR/dm2", "EUR").of(size)`.

An estimate to compare ways of making with: a part for each target, and parts that grow with its faces, their area, the
volume of the body, or its height.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from designer.base.words import shown
from designer.kinds.layout import face_down
from designer.target import TargetGeometry

MM2_PER_DM2, MM3_PER_CM3, MM_PER_CM = 1e4, 1e3, 10.0
_TERM = re.compile(r"(\d{1,9}(?:\.\d{1,9})?)\s*([A-Za-z]+)(?:/([a-z0-9]+))?")


@dataclass(frozen=True)
class TargetSize:
    """How large a target is, in what efforts grow with."""

    face: int
    dm2: float  # of all faces
    cm3: float  # of the body
    cm: float  # of height, as it lies on the printer's bed


@dataclass(frozen=True)
class Effort:
    """A sum of parts: `Effort({"": 12, "dm2": 3})` is 12 for each target, and 3 for each square decimetre."""

    per: Mapping[str, float]

    def of(self, size: TargetSize) -> float:
        """What a target of this size takes."""
        grown = {"": 1.0, "face": float(size.face), "dm2": size.dm2, "cm3": size.cm3, "cm": size.cm}
        return sum(amount * grown[what] for what, amount in self.per.items())


UNITS = ("", "face", "dm2", "cm3", "cm")


def parse_effort(text: str, unit: str) -> Effort:
    """An effort as people write it: `0.5h + 0.1h/face`.

    Args:
        text: terms joined by plus signs, each with the unit, by itself or over face, dm2, cm3 or cm.
        unit: of all of them.

    Raises:
        ValueError: no such sum.
    """
    parts: dict[str, float] = {}
    for term in text.split("+"):
        found = _TERM.fullmatch(term.strip())
        if found is None or found[2] != unit or (found[3] or "") not in UNITS or (found[3] or "") in parts:
            raise ValueError(f"{shown(term.strip())}: expected a sum such as 2{unit} + 0.5{unit}/dm2, "
                             f"each of face, dm2, cm3 and cm once")  # fmt: skip
        parts[found[3] or ""] = float(found[1])
    return Effort(parts)


def size_of(target: TargetGeometry) -> TargetSize:
    """The size of a target; of a plate of unknown thickness the body counts as nothing.

    The volume behind face f of area A is A (n . p) / 3, with its normal n and a point p of it (Gauss).
    """
    x, y = target.outline_mm[:, :, 0], target.outline_mm[:, :, 1]
    area = 0.5 * (x * np.roll(y, -1, axis=1) - y * np.roll(x, -1, axis=1)).sum(axis=1)  # (F,)
    frame = target.target_from_face
    corner = np.einsum("fij,fkj->fki", frame[:, :3, :2], target.outline_mm) + frame[:, None, :3, 3]
    depth = target.spec.depth_mm if target.spec is not None else 0.0
    if target.is_plate:
        height, volume = depth, float(area[0]) * depth
    else:
        height = float(np.ptp(corner.reshape(-1, 3) @ face_down(target)[2]))
        offset = np.einsum("fi,fi->f", frame[:, :3, 2], frame[:, :3, 3])
        volume = float((area * (depth if target.form == "trihedron" else offset / 3)).sum())
    return TargetSize(target.face_count, float(area.sum()) / MM2_PER_DM2, volume / MM3_PER_CM3, height / MM_PER_CM)
