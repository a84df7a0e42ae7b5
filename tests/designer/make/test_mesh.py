"""Body and ink: two closed meshes that fill the solid exactly."""

import math
from dataclasses import replace

import manifold3d
import numpy as np
import pytest
import shapely
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from designer.base.errors import InputError
from designer.base.solid import Solid
from designer.builds.design import Design
from designer.kinds.ico import IcoSpec, icosahedron
from designer.kinds.regular_solid import SolidSpec
from designer.kinds.spec_file import RawValue
from designer.make.bed import against_skew
from designer.make.mesh import Mesh, inlaid, plain_plate, plain_solid, plate_hull, solid_hull, solid_of
from designer.make.pattern import make_pattern
from tests.support.designs import SMALL, design_of, wishes

UNIT_VOLUME = 5 * (3 + math.sqrt(5)) / 12
"""Of the icosahedron with edge length 1."""


COARSE = "50um"  # chord error, to keep the meshes small where roundness does not matter
LETTERED_ICO = {"kind": "ico", "edge": "60mm", "nozzle": "0.2mm", "border": "4mm", "chord_error": COARSE}
DESIGNS = {
    "paper's ico": design_of(kind="ico", edge="100mm", ring_diameter="7mm", pitch="10mm", chord_error=COARSE),
    "20 mm ico": design_of(kind="ico", edge="20mm", chord_error=COARSE),
    "lettered ico": design_of(**LETTERED_ICO),
    "shrunk lettered ico": design_of(**LETTERED_ICO, shrink_compensation=-20, inlay_depth="3mm"),
    "tight lettered ico": design_of(kind="ico", edge="18mm", nozzle="0.2mm", border="2.4mm", chord_error=COARSE),
    "grown ico": design_of(kind="ico", edge="40mm", ink_offset="0.1mm", shrink_compensation=2, chord_error=COARSE),
    "lettered cube": design_of(kind="cube", edge="50mm", border="5mm", chord_error=COARSE),
    "paper's board": design_of(kind="board", size="220x220mm", ring_diameter="7mm", pitch="10mm", chord_error=COARSE),
    "bordered board": design_of(kind="board", size="220x220mm", pitch="10mm", border="5mm", chord_error=COARSE),
    "plain grid": design_of(kind="board", columns=7, rows=5, pitch="10mm", dots=False, chord_error=COARSE),
    "triangular board": design_of(
        kind="board", size="70x90mm", pitch="9mm", lattice="triangular", border="1mm", chord_error=COARSE
    ),
}


@pytest.fixture(params=DESIGNS, scope="module")
def design(request: pytest.FixtureRequest) -> Design:
    return DESIGNS[request.param]


def ink_of(design: Design) -> Mesh:
    assert design.part.ink is not None
    return design.part.ink


def solid_volume(design: Design) -> float:
    spec = design.job.target
    of_unit_edge = {"ico": UNIT_VOLUME, "cube": 1.0}
    if isinstance(spec, SolidSpec):
        return of_unit_edge[spec.kind] * (spec.edge_mm * design.scale) ** 3
    return math.prod(np.ptp(design.target.outline_mm[0], axis=0)) * spec.depth_mm * design.scale**3


def corners_of(mesh: Mesh) -> np.ndarray:
    """(T, 3, 3)."""
    return mesh.vertices_mm[mesh.triangles]


def areas_of(mesh: Mesh) -> np.ndarray:
    corner = corners_of(mesh)
    return np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1) / 2


def assert_closed(mesh: Mesh) -> None:
    """Every directed edge occurs once, and so does its reverse; no vertex is idle or doubled."""
    ends = np.concatenate([mesh.triangles[:, [k, (k + 1) % 3]] for k in range(3)]).astype(np.int64)
    count = len(mesh.vertices_mm)
    forth, back = ends @ [count, 1], ends @ [1, count]
    assert len(np.unique(forth)) == len(forth)
    assert (np.sort(forth) == np.sort(back)).all()
    assert (np.unique(mesh.triangles) == np.arange(count)).all()
    assert len(np.unique(mesh.vertices_mm, axis=0)) == count


def components_of(mesh: Mesh) -> list[np.ndarray]:
    """The triangles of each connected piece, as row numbers."""
    ends = np.concatenate([mesh.triangles[:, [k, (k + 1) % 3]] for k in range(3)])
    size = len(mesh.vertices_mm)
    graph = coo_matrix((np.ones(len(ends)), ends.T), shape=(size, size))
    _, piece = connected_components(graph, directed=False)
    order = np.argsort(piece[mesh.triangles[:, 0]], kind="stable")
    return np.split(order, np.flatnonzero(np.diff(piece[mesh.triangles[order, 0]])) + 1)


def part_of(mesh: Mesh, rows: np.ndarray) -> Mesh:
    return Mesh(mesh.vertices_mm, mesh.triangles[rows])


def euler_characteristic(mesh: Mesh) -> int:
    """Vertices - edges + triangles; 2 - 2 genus for one closed piece."""
    return len(np.unique(mesh.triangles)) - len(mesh.triangles) * 3 // 2 + len(mesh.triangles)


def assert_fills_the_solid(design: Design) -> None:
    """Body and ink are closed; walls cancel, and what is left over is the solid's own surface."""
    body, ink = design.part.body, ink_of(design)
    assert_closed(body)
    assert_closed(ink)
    assert body.volume_mm3 + ink.volume_mm3 == pytest.approx(solid_volume(design), rel=1e-9)
    solid = bare(design)
    # One numbering for the vertices of both, by their coordinates, bit for bit.
    vertices, numbers = np.unique(np.concatenate([body.vertices_mm, ink.vertices_mm]), axis=0, return_inverse=True)
    triangles = numbers.ravel()[np.concatenate([body.triangles, ink.triangles + len(body.vertices_mm)])]
    normal, height = planes_of(solid)
    above = vertices @ normal.T - height  # (V, P)
    assert above.max() < 1e-6
    touches = np.abs(above) < 1e-6
    plane_of = np.logical_and.reduce([touches[triangles[:, k]] for k in range(3)])  # (T, P)
    on_surface = plane_of.any(axis=1)
    a, b, c = (vertices[triangles[on_surface, k]] for k in range(3))
    doubled = np.einsum("ti,ti->t", np.cross(b - a, c - a), normal[plane_of[on_surface].argmax(axis=1)])
    assert doubled.min() > 0  # outward, so with the right sum none lies on another
    assert doubled.sum() / 2 == pytest.approx(areas_of(solid).sum(), rel=1e-9)
    assert_cancelling(triangles[~on_surface])
    # The body's floors under the ink look outward too: their triangles do not overlap.
    a, b, c = (body.vertices_mm[body.triangles[:, k]] for k in range(3))
    for n, h in zip(normal, height - design.job.printing.inlay_mm, strict=True):
        on_floor = np.logical_and.reduce([np.abs(corner @ n - h) < 1e-6 for corner in (a, b, c)])
        assert (np.cross(b - a, c - a)[on_floor] @ n > 0).all()


def bare(design: Design) -> Mesh:
    spec = design.job.target
    if spec.solid is not None:
        solid = plain_solid(spec.solid, below_mm=0.0, scale=design.scale)
    else:
        solid = plain_plate(design.target.outline_mm[0] * design.scale, spec.depth_mm * design.scale)
    return replace(solid, vertices_mm=against_skew(design.target, design.job.printing, solid.vertices_mm))


def planes_of(solid: Mesh) -> tuple[np.ndarray, np.ndarray]:
    """Outward normals and distances from the origin of a solid's triangles."""
    corner = corners_of(solid)
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    return normal, (normal * corner[:, 0]).sum(axis=1)


def assert_cancelling(triangles: np.ndarray) -> None:
    """Every triangle occurs once in each direction.  # (T, 3)"""
    first = triangles.argmin(axis=1)
    a, b, c = np.take_along_axis(triangles, (first[:, None] + np.arange(3)) % 3, axis=1).T.astype(object)
    size = int(triangles.max()) + 1
    forth, back = (a * size + b) * size + c, (a * size + c) * size + b
    assert len(set(forth.tolist())) == len(forth)
    assert set(forth.tolist()) == set(back.tolist())


def test_body_and_ink_fill_the_solid(design: Design) -> None:
    """Both meshes are closed and manifold, and their walls coincide, so that nothing overlaps or is left empty.

    Every triangle has an area, so it has a normal.
    """
    assert_fills_the_solid(design)
    assert min(areas_of(design.part.body).min(), areas_of(ink_of(design)).min()) > 1e-9


def test_pieces_of_ink_are_solid(design: Design) -> None:
    """Each ring is a torus and each dot a disc with its own volume to its own outside; the border is one piece."""
    ink, target = ink_of(design), design.target
    pieces = [part_of(ink, rows) for rows in components_of(ink)]
    assert all(piece.volume_mm3 > 0 for piece in pieces)
    kinds = [euler_characteristic(piece) for piece in pieces]
    letters = len(design.printed_pattern.faces[0].dark_text)
    assert kinds.count(0) >= int((~target.is_dot).sum())
    borders = [piece for piece in pieces if np.ptp(piece.vertices_mm[piece.triangles], axis=(0, 1)).max() > 15]
    has_border = design.printed_pattern.faces[0].window is not None
    assert len(pieces) == target.ring_count + letters + has_border
    if isinstance(design.job.target, IcoSpec):
        assert [euler_characteristic(border) for border in borders] == [2 - 2 * 19 - 2 * letters_in_border(design)]
    assert kinds.count(2) == int(target.is_dot.sum()) + letters


def letters_in_border(design: Design) -> int:
    """Holes through the border beside its windows."""
    return sum(len(face.light_text) for face in design.printed_pattern.faces)


@pytest.mark.parametrize("name", ["lettered cube", "triangular board"])
def test_an_independent_kernel_agrees(name: str) -> None:
    """Manifold takes both meshes as valid; they have no common volume, and their union is the bare solid."""
    body, ink = (
        manifold3d.Manifold(manifold3d.Mesh64(mesh.vertices_mm, mesh.triangles.astype(np.uint64)))
        for mesh in (DESIGNS[name].part.body, ink_of(DESIGNS[name]))
    )
    assert body.status() == ink.status() == manifold3d.Error.NoError
    assert (body ^ ink).volume() == pytest.approx(0, abs=1e-6)
    assert (body + ink).volume() == pytest.approx(solid_volume(DESIGNS[name]), rel=1e-6)


OF_MESHES = (
    "nozzle", "border", "margin", "labels", "lattice", "dots", "two_sided", "inlay_depth", "ink_offset",
    "shrink_compensation", "skew_compensation",
)  # fmt: skip


@given(wishes(("ico", "cube", "board"), *OF_MESHES), st.sampled_from(["20um", "0.1mm", "0.4mm"]))
@settings(max_examples=12)
def test_any_design_fills_its_solid(asked: tuple[str, dict[str, RawValue]], chord_error: str) -> None:
    """Whatever is asked for, the meshes are sound, or there is a reason why not."""
    kind, values = asked
    try:
        design = design_of(kind=kind, **values, chord_error=chord_error)
        design.part  # noqa: B018  # computed here, so that a refusal is seen here
    except InputError:
        assume(False)
    assert_fills_the_solid(design)
    assert min(areas_of(design.part.body).min(), areas_of(ink_of(design)).min()) > 1e-12


def test_inlay_must_leave_a_border_and_a_back() -> None:
    """An inlay that undercuts the border, or goes through the board, is refused with what would do, and does."""
    ico, solid = DESIGNS["20 mm ico"], Solid(icosahedron(), 20.0)
    with pytest.raises(InputError, match=r"border .* too narrow .* use an inlay of at most") as raised:
        solid_hull(ico.printed_pattern, solid, 5.0)
    offered = float(str(raised.value).split("at most ")[1].split("mm")[0])
    part = inlaid(ico.printed_pattern, solid_hull(ico.printed_pattern, solid, offered), offered)
    assert part.ink is not None
    assert_closed(part.ink)
    assert part.body.volume_mm3 + part.ink.volume_mm3 == pytest.approx(UNIT_VOLUME * 20**3, rel=1e-9)
    board = DESIGNS["triangular board"]
    with pytest.raises(InputError, match=r"goes through .* use at most 2\.5mm"):
        plate_hull(board.printed_pattern, 5.0, 5.0)
    unbordered = make_pattern(DESIGNS["paper's board"].target, ico.job.printing)
    with pytest.raises(InputError, match="needs a border"):
        solid_hull(unbordered, solid, 1.0)


def test_raised_ink_stands_on_its_plate() -> None:
    """Body and ink fill the whole, which is closed; its change of filament is at a layer, the face at mid-height."""
    values = {**SMALL["board"], "size": "68x68mm", "border": "2mm", "shrink_compensation": "0.7%"}
    design = design_of("board", **values, build="relief", chord_error="50um")
    part, height, layer = design.part, design.job.printing.inlay_mm, design.job.printing.printer.layer_height_mm
    assert part.ink is not None
    assert part.fused is not None
    assert part.fused.volume_mm3 == pytest.approx(part.body.volume_mm3 + part.ink.volume_mm3, rel=1e-9)
    assert solid_of(part.fused).volume() == pytest.approx(part.fused.volume_mm3, rel=1e-9)
    assert np.unique(part.ink.vertices_mm[:, 2]) == pytest.approx([-height / 2, height / 2])
    assert part.body.vertices_mm[:, 2].max() == pytest.approx(-height / 2)
    assert np.ptp(part.body.vertices_mm[:, 2]) / layer == pytest.approx(round(3.6 * 1.007 / layer))
    assert design.plates[0].pieces[0].as_it_lies.body.vertices_mm[:, 2].min() == pytest.approx(0)


@pytest.mark.parametrize("tilt_deg", [0, 20, 45, 65])
def test_a_raised_ring_is_seen_at_its_centre_from_any_side(tilt_deg: float) -> None:
    """The middle of its silhouette, walls and all, is where the target file's centre is seen."""
    design = design_of("board", **SMALL["board"], build="relief", chord_error="10um")
    ink, target, tilt = design.part.ink, design.target, math.radians(tilt_deg)
    assert ink is not None
    at = target.center_mm[np.flatnonzero(~target.is_dot)[0]]
    axes = np.array([[math.cos(tilt), 0.0, -math.sin(tilt)], [0.0, 1.0, 0.0]])
    corners = ink.vertices_mm[ink.triangles]
    mine = corners[np.linalg.norm(corners[..., :2] - at[:2], axis=-1).max(axis=1) < 4]
    seen = shapely.union_all(shapely.make_valid(shapely.polygons(mine @ axes.T)), grid_size=1e-7)
    assert [seen.centroid.x, seen.centroid.y] == pytest.approx(axes @ at, abs=1e-5)


def test_plain_solids() -> None:
    """The bare icosahedron and the bare plate are closed and have their formulas' volumes."""
    ico = plain_solid(Solid(icosahedron(), 30.0), below_mm=0.0, scale=1.0)
    assert_closed(ico)
    assert ico.volume_mm3 == pytest.approx(UNIT_VOLUME * 30**3)
    assert np.linalg.norm(corners_of(ico)[:, 0] - corners_of(ico)[:, 1], axis=1) == pytest.approx(np.full(20, 30.0))
    board = plain_plate(np.array([[-10.0, -5], [10, -5], [10, 5], [-10, 5]]), 3.0)
    assert_closed(board)
    assert board.volume_mm3 == pytest.approx(20 * 10 * 3)
    assert (board.vertices_mm[:, 2].min(), board.vertices_mm[:, 2].max()) == (-3.0, 0.0)
