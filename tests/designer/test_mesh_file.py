"""Bodies out of meshes, told from hulls that scipy and trimesh work out, and meshes that are none."""

import itertools
from pathlib import Path

import numpy as np
import pytest
import trimesh

import designer
from designer.base.codes import CODES
from designer.base.errors import InputError
from designer.kinds.mesh_file import SUFFIXES, faces_of
from designer.target import load_target
from tests.support.command_line import design
from tests.support.designs import design_of

CUBOCTAHEDRON = [np.array(p) * 50.0 for p in itertools.product((-1, 0, 1), repeat=3) if sum(map(abs, p)) == 2]
BOX = [np.array(p) * 20.0 for p in itertools.product((-1, 1), repeat=3)]


def hull(points: list[np.ndarray]) -> trimesh.Trimesh:
    """As trimesh makes it."""
    return trimesh.convex.convex_hull(np.array(points, dtype=float))


def saved(folder: Path, mesh: trimesh.Trimesh, name: str = "part.stl") -> Path:
    """A mesh in a file."""
    mesh.export(folder / name)
    return folder / name


@pytest.mark.parametrize("name", ["part.stl", "part.obj", "part.ply", "part.off", "part.glb"])
def test_flat_faces_of_a_mesh_are_found_in_every_format(tmp_path: Path, name: str) -> None:
    """Eight triangles and six squares about the centroid, from above to below, however its triangles are cut."""
    mesh = hull(CUBOCTAHEDRON).subdivide().apply_translation([300, 0, 7])
    read = faces_of(saved(tmp_path, mesh, name), 2.0)
    assert sorted(map(len, read.body.faces)) == [3] * 8 + [4] * 6
    assert not read.body.bare
    assert np.abs(np.linalg.norm(read.body.vertices_mm, axis=1) - 100 * np.sqrt(2)).max() < 1e-3
    heights = [read.body.planes[row, 2] for row in range(14)]
    assert heights == sorted(heights, reverse=True)


def test_what_a_mesh_leaves_open_stays_bare(tmp_path: Path) -> None:
    """A box without its floor is closed by its hull; doubled triangles and triangles turned over do no harm."""
    box = hull(BOX)
    walls = box.triangles[box.face_normals[:, 2] > -0.9]
    mixed = np.concatenate([walls, walls[:4], walls[5:6, ::-1]])
    read = faces_of(saved(tmp_path, trimesh.Trimesh(**trimesh.triangles.to_kwargs(mixed))), 1.0)
    assert len(read.body.faces) == 5
    assert read.body.planes[-1, 2] == pytest.approx(-1)
    assert any("open" in remark for remark in read.remarks)
    design = design_of("solid", mesh=str(tmp_path / "part.stl"), unit="mm", chord_error="50um")
    body, ink = design.part.body, design.part.ink
    assert ink is not None
    assert body.volume_mm3 + ink.volume_mm3 == pytest.approx(40.0**3, rel=1e-9)


def test_the_command_takes_the_mesh_and_asks_for_its_unit(tmp_path: Path) -> None:
    """`design solid MESH.stl --unit mm`; its spec holds the body, so that the mesh is not needed again."""
    part, out = saved(tmp_path, hull(BOX)), tmp_path / "out"
    assert "--unit mm" in design("solid", part).err
    assert design("solid", part, "--unit", "mm", "--chord-error", "50um", "-o", out).code == 0
    part.unlink()
    assert design("make", out / "solid-part.toml", "--unit", "inch").err.startswith("error: unit inch: is a mesh's")
    target = load_target(out / "solid-part.target.json")
    assert (
        designer.load(out / "solid-part.toml").geometry
        == target
        == designer.load_target(out / "solid-part.target.json")
    )
    assert target.face_count == 6


def test_python_takes_the_mesh_as_the_command_does(tmp_path: Path) -> None:
    """Without a name; what else is given without one is refused with how to name it."""
    part = saved(tmp_path, hull(BOX))
    assert designer.solid(part, unit="mm").geometry == designer.solid(mesh=str(part), unit="mm").geometry
    with pytest.raises(InputError, match=r"ico: 60 is given without a name; name it, as in ico\(edge=\.\.\.\)"):
        designer.ico(60)


def notched() -> trimesh.Trimesh:
    """A box with a smaller one on it."""
    return trimesh.util.concatenate([trimesh.creation.box((40, 40, 10)), trimesh.creation.box((10, 10, 30))])


BAD = {
    "not convex": (notched(), "not convex"),
    "a sphere": (trimesh.creation.icosphere(subdivisions=4, radius=40), "flat faces, more than"),
    "flat": (trimesh.Trimesh([[0, 0, 0], [9, 0, 0], [0, 9, 0], [9, 9, 0]], [[0, 1, 2], [1, 3, 2]]), "design board"),
    "small": (hull([p / 80 for p in BOX]), "check --unit"),
    "inward": (trimesh.Trimesh([[0, 0, 0], [60, 0, 0], [0, 60, 0], [0, 0, 60]], [[0, 1, 2], [0, 2, 3], [0, 3, 1]]),
               "look inward"),
    "not finite": (trimesh.Trimesh([[0, 0, 0], [np.nan, 0, 0], [0, 9, 0]], [[0, 1, 2]], process=False), "finite"),
    "slivers": (hull([*BOX, np.array((20.008, 19.995, -1.658)), np.array((19.994, 20.005, 0.712))]), "slivers"),
}  # fmt: skip


@pytest.mark.parametrize("what", BAD)
def test_a_mesh_that_carries_no_rings_is_refused(tmp_path: Path, what: str) -> None:
    """In one line that names the file and says why."""
    mesh, why = BAD[what]
    with pytest.raises(InputError, match=why) as raised:
        faces_of(saved(tmp_path, mesh), 1.0)
    assert "\n" not in str(raised.value)
    assert "part.stl" in str(raised.value)


BROKEN = (
    b"", b"solid x", b"\x00" * 90, b"ply\nformat ascii 1.0\nelement vertex 9999999999", b"PK\x03\x04" * 30,
    b"v 1 2\nf 1 2 99\n", b"glTF\x02\x00\x00\x00\xff\xff\xff\xff",
)  # fmt: skip


@pytest.mark.parametrize("name", [f"part{suffix}" for suffix in SUFFIXES])
@pytest.mark.parametrize("content", BROKEN)
def test_files_that_are_no_meshes_are_refused(tmp_path: Path, name: str, content: bytes) -> None:
    """Whatever is in them."""
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=name):
        faces_of(tmp_path / name, 1.0)


def test_codes_differ_as_told() -> None:
    """Dots of two like faces, turned about their middles in space, are apart in as many places as the facts say."""
    spec = design_of("dodecahedron", edge="14mm").job.target
    laid = spec.laid
    assert len(set(laid.code)) == len(laid.code)
    least = 20
    for (a, first), (b, second) in itertools.product(enumerate(laid.faces), repeat=2):
        dots = [{tuple(at) for at in CODES[laid.code[face]]} for face in (a, b)]
        for turn in range(6):
            cos, sin = np.cos(turn * np.pi / 3), np.sin(turn * np.pi / 3)
            turned = (first.place_mm - first.place_mm.mean(axis=0)) @ np.array([[cos, sin], [-sin, cos]])
            apart = np.linalg.norm(turned[:, None] - (second.place_mm - second.place_mm.mean(axis=0)), axis=2)
            if (a, turn) == (b, 0) or len(turned) != len(second.place_mm) or apart.min(axis=1).max() > 1e-3:
                continue
            own = {k for k, at in enumerate(first.index.tolist()) if tuple(at) in dots[0]}
            others = {k for k, at in enumerate(second.index.tolist()) if tuple(at) in dots[1]}
            least = min(least, len({int(apart[k].argmin()) for k in own} ^ others))
    assert least == laid.differing >= 2


def test_ink_of_opposite_faces_leaves_a_body(tmp_path: Path) -> None:
    """A body thinner than the ink of both its sides is refused with what to use; with stickers it may be as thin."""
    place = saved(tmp_path, trimesh.creation.box((80.0, 80.0, 0.5)))
    with pytest.raises(InputError, match=r"0\.5mm thick behind a face.*--build stickers"):
        design_of("solid", mesh=str(place), unit="mm")
    design_of("solid", mesh=str(place), unit="mm", build="stickers")
