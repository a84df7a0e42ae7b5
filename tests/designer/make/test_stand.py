"""Laws of the printable stand: it prints, it carries, it stands, and it leaves the rings free."""

import math
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from manifold3d import Manifold, Mesh64

from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.kinds.board import BoardSpec
from designer.kinds.cube import CubeSpec
from designer.kinds.ico import IcoSpec
from designer.kinds.layout import lay_out
from designer.make.mesh import Mesh, plain_plate, plain_solid
from designer.make.stand import CLEARANCE_MM, make_stand, stand_from_target
from designer.spec.spec import Spec
from designer.target import TargetGeometry
from tests.support.designs import small

PRINTING = replace(small("board").job.printing, stand=True)
SPECS: dict[str, Spec] = {
    "ico 20": IcoSpec(20.0, 5, 2.3, 0.45, 2.9, 0.5, 0.4),
    "ico 20, rings near the corners": IcoSpec(20.0, 5, 2.4, 0.45, 3.35, 0.5, 0.1),
    "ico 100": IcoSpec(100.0, 8, 7.0, 0.45, 10.0, 2.0, 3.0),
    "ico 150, few rings": IcoSpec(150.0, 5, 7.0, 0.45, 10.0, 3.0, 3.0),
    "cube 24": CubeSpec(24.0, 5, 2.6, 0.45, 3.6, 1.2, 0.5),
    "cube 80": CubeSpec(80.0, 8, 6.44, 0.45, 9.21, 1.6, 2.9),
    "board 220": BoardSpec((220.0, 220.0), 5.0, 21, 21, "square", 7.0, 0.45, 10.0, 0.0, 5.0, True),
    "board 400": BoardSpec((400.0, 400.0), 3.0, 38, 38, "square", 7.0, 0.45, 10.0, 5.0, 5.0, True),
    "small thick board": BoardSpec((34.0, 28.0), 8.0, 5, 4, "triangular", 4.0, 0.45, 6.0, 0.0, 1.5, True),
    "low wide board": BoardSpec((200.0, 40.0), 4.0, 19, 3, "square", 7.0, 0.45, 10.0, 0.0, 5.0, False),
}


@pytest.fixture(params=SPECS, scope="module")
def target(request: pytest.FixtureRequest) -> TargetGeometry:
    return lay_out(SPECS[request.param])


@pytest.fixture(scope="module")
def stand(target: TargetGeometry) -> Mesh:
    return make_stand(target, PRINTING)


def as_manifold(mesh: Mesh) -> Manifold:
    return Manifold(Mesh64(np.ascontiguousarray(mesh.vertices_mm), mesh.triangles.astype(np.uint64)))


def placed_solid(target: TargetGeometry) -> Manifold:
    """The target as it stands."""
    spec = target.spec
    assert spec is not None
    if spec.solid is not None:
        solid = plain_solid(spec.solid, below_mm=0.0, scale=1.0)
    else:
        solid = plain_plate(target.outline_mm[0], spec.depth_mm)
    return as_manifold(solid).transform(stand_from_target(target)[:3])


def in_stand(target: TargetGeometry, points: Array) -> Array:
    motion = stand_from_target(target)
    return points @ motion[:3, :3].T + motion[:3, 3]


def test_stand_is_one_closed_solid_on_the_bed(stand: Mesh) -> None:
    """One watertight piece with volume, its lowest plane the bed."""
    solid = trimesh.Trimesh(stand.vertices_mm, stand.triangles, process=False)
    assert solid.is_watertight
    assert solid.is_winding_consistent
    assert solid.body_count == 1
    assert stand.volume_mm3 > 0
    assert stand.vertices_mm[:, 2].min() == pytest.approx(0, abs=1e-9)


def test_target_fits_and_is_carried(target: TargetGeometry, stand: Mesh) -> None:
    """The target in its place does not touch the stand; lowered by little more than the clearance, it does."""
    solid, frame = placed_solid(target), as_manifold(stand)
    assert (solid ^ frame).volume() == 0
    assert (solid.translate((0, 0, -CLEARANCE_MM - 0.1)) ^ frame).volume() > 0
    for sideways in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        if not target.is_planar or sideways[0] == 0:
            shift = (2 * CLEARANCE_MM * sideways[0], 2 * CLEARANCE_MM * sideways[1], -CLEARANCE_MM)
            assert (solid.translate(shift) ^ frame).volume() > 0, "it slides off"


def test_rings_stay_free(target: TargetGeometry, stand: Mesh) -> None:
    """No part of the stand lies in front of a ring, up to one ring diameter away."""
    frame = as_manifold(stand)
    discs = []
    for row in range(target.ring_count):
        radius = target.radius_outer_mm[row]
        face = target.target_from_face[target.ring_face[row]].copy()
        face[:3, 3] = target.center_mm[row]
        disc = Manifold.cylinder(2 * radius, radius / math.cos(math.pi / 24), circular_segments=24)
        discs.append(disc.transform((stand_from_target(target) @ face)[:3]))
    low = [disc for disc in discs if disc.bounding_box()[2] < stand.vertices_mm[:, 2].max()]
    assert low
    assert max((disc ^ frame).volume() for disc in low) == 0


def test_target_does_not_tip_over(target: TargetGeometry, stand: Mesh) -> None:
    """Seen from above, the target's centre of gravity lies within the stand's footprint, by a tenth of its depth."""
    on_bed = stand.vertices_mm[np.abs(stand.vertices_mm[:, 2]) < 1e-6][:, :2]
    spec = target.spec
    own = np.array([[0.0, 0.0, -spec.thickness_mm / 2 if isinstance(spec, BoardSpec) else 0.0]])
    centre = in_stand(target, own)[0, :2]
    hull = trimesh.convex.hull_points(on_bed)
    hull = hull[np.argsort(np.arctan2(*(hull - hull.mean(axis=0)).T[::-1]))]
    along = np.roll(hull, -1, axis=0) - hull
    inward = np.stack([-along[:, 1], along[:, 0]], axis=1) / np.linalg.norm(along, axis=1, keepdims=True)
    inside = np.einsum("ij,ij->i", centre - hull, inward)
    assert inside.min() > 0.1 * np.ptp(on_bed, axis=0).min()


def test_stand_prints_without_supports(stand: Mesh) -> None:
    """Off the bed, no surface faces down by more than 45 degrees."""
    corners = stand.vertices_mm[stand.triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(normal, axis=1)
    down = -normal[:, 2] > math.sin(math.radians(45)) * area
    on_bed = (np.abs(corners[:, :, 2]) < 1e-6).all(axis=1)
    assert area[down & ~on_bed].sum() < 1e-6


def test_walls_hold_three_lines(target: TargetGeometry, stand: Mesh) -> None:
    """Layers in the base, beside the target's lowest edge and near the top hold three lines in every piece."""
    three_lines = 3 * PRINTING.printer.line_width_mm
    beside_target = placed_solid(target).bounding_box()[2] + 0.5
    for height in (0.5, beside_target, 0.9 * stand.vertices_mm[:, 2].max()):
        layer = as_manifold(stand).slice(height)
        assert not layer.is_empty()
        assert len(layer.offset(-0.5 * three_lines).decompose()) == len(layer.decompose())


def test_lift_shows_the_lower_faces() -> None:
    """An icosahedron stands on face 19, at least 10 mm and 0.3 edges above the table."""
    for edge in (20.0, 100.0):
        target = lay_out(replace(SPECS["ico 20"], edge_mm=edge, margin_mm=0.0))
        outline = np.column_stack([target.outline_mm[19], np.zeros(3)])
        frame = target.target_from_face[19]
        corners = in_stand(target, outline @ frame[:3, :3].T + frame[:3, 3])
        np.testing.assert_allclose(corners[:, 2], max(10.0, 0.3 * edge))
        assert placed_solid(target).bounding_box()[2] == pytest.approx(max(10.0, 0.3 * edge))


def test_shrink_compensation_scales_the_stand(target: TargetGeometry, stand: Mesh) -> None:
    """The printed stand is larger by the compensation, as the printed target is."""
    larger = make_stand(target, replace(PRINTING, shrink_compensation_percent=0.5))
    np.testing.assert_allclose(larger.vertices_mm, 1.005 * stand.vertices_mm)


@pytest.mark.parametrize(
    "spec",
    [
        IcoSpec(20.0, 8, 1.4, 0.45, 2.3, 0.4, 0.1),
        BoardSpec((30.0, 30.0), 3.0, 6, 6, "square", 4.0, 0.45, 5.0, 0, 0.5, True),
    ],
)
def test_no_room_for_a_stand_is_refused(spec: Spec) -> None:
    """Where rings leave no room to hold the target, the message names the room."""
    with pytest.raises(InputError, match=r"rings come within .*mm"):
        make_stand(lay_out(spec), PRINTING)


def test_a_target_without_spec_is_refused() -> None:
    """A target made by others has unknown solids."""
    with pytest.raises(InputError, match="no spec"):
        make_stand(replace(lay_out(SPECS["ico 20"]), spec=None), PRINTING)
