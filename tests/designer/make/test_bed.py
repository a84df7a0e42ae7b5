"""How the part lies on the bed."""

from dataclasses import replace

import numpy as np
import pytest

from designer.base.solid import Solid
from designer.kinds.ico import icosahedron
from designer.make.bed import bed_from_target, printed_size_mm
from designer.produce import Design
from tests.support.designs import ink_of, small_board, small_ico

PHI = (1 + 5**0.5) / 2


@pytest.fixture(params=[small_ico, small_board], ids=["ico", "board"], scope="module")
def design(request: pytest.FixtureRequest) -> Design:
    return request.param()


def vertices_of(design: Design) -> np.ndarray:
    """Body and ink: the icosahedron's corners belong to the border.  # (V, 3)"""
    return np.concatenate([design.part.body.vertices_mm, ink_of(design).vertices_mm])


def on_bed(design: Design, motion: np.ndarray) -> np.ndarray:
    return vertices_of(design) @ motion[:3, :3].T + motion[:3, 3]


def test_last_face_lies_on_the_bed(design: Design) -> None:
    """The motion is rigid and right-handed, and the last face's normal points into the bed, at z = 0."""
    motion = bed_from_target(design.target, design.job.printing)
    assert motion[:3, :3] @ motion[:3, :3].T == pytest.approx(np.eye(3), abs=1e-9)
    assert np.linalg.det(motion[:3, :3]) == pytest.approx(1.0)
    frame = motion @ design.target.target_from_face[-1]
    assert frame[:3, 2] == pytest.approx(np.array([0.0, 0.0, -1.0]), abs=1e-9)
    assert frame[2, 3] == pytest.approx(0.0, abs=1e-9)
    assert on_bed(design, motion)[:, 2].min() == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("bed_mm", [(250.0, 210.0, 220.0), (210.0, 250.0, 220.0)])
def test_part_is_centred_with_its_long_side_along_the_beds(design: Design, bed_mm: tuple[float, float, float]) -> None:
    """The bounding box is in the middle of the bed, its longer side along the bed's longer side."""
    printing = replace(design.job.printing, printer=replace(design.job.printing.printer, bed_mm=bed_mm))
    vertices = on_bed(design, bed_from_target(design.target, printing))
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    assert ((low + high) / 2)[:2] == pytest.approx(np.array(bed_mm)[:2] / 2)
    size = printed_size_mm(design.target, printing)
    assert high - low == pytest.approx(np.array(size))
    if size[0] != pytest.approx(size[1]):
        assert (size[1] > size[0]) == (bed_mm[1] > bed_mm[0])


def test_icosahedron_size_on_its_face() -> None:
    """Face down, an icosahedron of edge a needs 1.868 a by 1.618 a on the bed and is 1.512 a high."""
    design = small_ico()
    expected = 20 * np.array([2 * PHI / 3**0.5, PHI, PHI**2 / 3**0.5])
    assert printed_size_mm(design.target, design.job.printing) == pytest.approx(expected)


def test_size_follows_shrinkage_compensation(design: Design) -> None:
    """A part printed 1 % larger needs 1 % more, in height too, and still stands on the bed."""
    printing = replace(design.job.printing, shrink_compensation_percent=1.0)
    assert np.array(printed_size_mm(design.target, printing)) == pytest.approx(
        1.01 * np.array(printed_size_mm(design.target, design.job.printing))
    )
    motion = bed_from_target(design.target, printing)
    height = 1.01 * vertices_of(design) @ motion[2, :3] + motion[2, 3]
    assert height.min() == pytest.approx(0.0, abs=1e-9)


def test_body_under_stickers_is_smaller() -> None:
    """Each face of a body for stickers lies their thickness further in, so the body is lower by twice as much."""
    design = small_ico()
    printing = replace(design.job.printing, build="stickers", sticker_thickness_mm=0.25)
    height = np.ptp(Solid(icosahedron(), 20.0).corners_mm() @ bed_from_target(design.target, printing)[2, :3])
    assert printed_size_mm(design.target, printing)[2] == pytest.approx(height - 0.5)
