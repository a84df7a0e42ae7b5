"""Lengths of targets, and the scale that measured ones give."""

from dataclasses import replace

import numpy as np
import pytest

from calib.measure_target.lengths import CaliperLength, length_in, rescaled, scale_from, scaled
from designer.base.errors import InputError
from designer.kinds.ico import icosahedron
from tests.support.as_built_scenes import plate, solid


def test_lengths_of_an_icosahedron() -> None:
    """Opposite faces are two inradii apart and an edge is an edge."""
    assert length_in(solid(), "face-to-face") == pytest.approx(200 * icosahedron().inradius)
    assert length_in(solid(), "edge") == pytest.approx(100.0)
    normal = solid().target_from_face[:, :3, 2]
    opposite = int(np.argmin(normal @ normal[0]))
    assert length_in(solid(), f"face 0 to face {opposite}") == pytest.approx(200 * icosahedron().inradius)


def test_lengths_between_rings() -> None:
    """The distance of their centres, of boards too."""
    assert length_in(plate(), "ring 0 to ring 10") == pytest.approx(200.0)


def test_a_face_that_moved_out_makes_the_caliper_wider() -> None:
    """The distance over two faces is along their normals."""
    normal = solid().target_from_face[:, :3, 2]
    opposite = int(np.argmin(normal @ normal[0]))
    frame = np.array(solid().target_from_face)
    frame[opposite, :3, 3] += 0.3 * normal[opposite] + 0.5 * frame[opposite, :3, 0]
    moved = replace(solid(), target_from_face=frame)
    assert length_in(moved, f"face {opposite} to face 0") == pytest.approx(200 * icosahedron().inradius + 0.3)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("diagonal", "none that a target has"),
        ("ring 1 to ring 1", "two different rings"),
        ("ring 1 to ring 9999", "from 0 to"),
        ("face 0 to face 1", "not opposite"),
        ("ring 1 to face 2", "none that a target has"),
    ],
)
def test_lengths_that_a_target_does_not_have(name: str, message: str) -> None:
    """They are refused with what to give instead."""
    with pytest.raises(InputError, match=message):
        length_in(solid(), name)


def test_a_board_has_no_faces_to_measure_over() -> None:
    """Neither opposite ones nor edges."""
    for name in ("face-to-face", "edge"):
        with pytest.raises(InputError, match=name):
            length_in(plate(), name)


def test_scale_is_the_weighted_mean() -> None:
    """Two lengths count by the squares of their relative accuracies."""
    first = CaliperLength("ring 0 to ring 10", 202.0, 0.5)
    second = CaliperLength("ring 0 to ring 88", length_in(plate(), "ring 0 to ring 88") * 1.006, 1.0)
    weight = np.array([(200 / 0.5) ** 2, (second.value_mm / 1.006 / 1.0) ** 2])
    found = scale_from(plate(), [first, second])
    assert found.value == pytest.approx(weight @ [1.01, 1.006] / weight.sum())
    assert found.sigma == pytest.approx(weight.sum() ** -0.5)
    assert np.sum(np.array([one.residual_sigma for one in found.lengths]) ** 2) > 0


def test_lengths_that_contradict_each_other_are_refused() -> None:
    """The worst one is named, with what the others make it."""
    lengths = [
        CaliperLength("ring 0 to ring 10", 200.0, 0.02),
        CaliperLength("ring 0 to ring 88", length_in(plate(), "ring 0 to ring 88"), 0.02),
        CaliperLength("ring 11 to ring 21", 200.5, 0.02),
    ]
    with pytest.raises(InputError, match=r"ring 11 to ring 21 of 200\.500 mm contradicts .* 200\.000 mm"):
        scale_from(plate(), lengths)
    scale_from(plate(), [*lengths[:2], CaliperLength("ring 11 to ring 21", 200.03, 0.02)])


def test_a_length_in_another_unit_is_refused() -> None:
    """A scale far from 1 is a mistake."""
    with pytest.raises(InputError, match="and the unit"):
        scale_from(solid(), [CaliperLength("edge", 10.0, 0.02)])
    with pytest.raises(InputError, match="more than 0"):
        scale_from(solid(), [CaliperLength("edge", 100.0, 0.0)])


def test_one_length_rescales_a_target() -> None:
    """All its numbers grow alike, and it is a measured one then."""
    large = rescaled(solid(), CaliperLength("edge", 101.0, 0.02))
    assert large.source == "measured"
    assert length_in(large, "edge") == pytest.approx(101.0)
    assert length_in(large, "face-to-face") == pytest.approx(202 * icosahedron().inradius)
    assert large.radius_outer_mm == pytest.approx(1.01 * solid().radius_outer_mm)
    assert large.center_mm == pytest.approx(1.01 * solid().center_mm)
    assert large.lattice_mm == pytest.approx(1.01 * solid().lattice_mm)
    assert large.layout_id == solid().layout_id
    assert scaled(large, 1 / 1.01).center_mm == pytest.approx(solid().center_mm)
