"""Full-colour models: colours and places, as the readers of others have them. Laws count their rings."""

import io

import lib3mf
import numpy as np
import pytest
import trimesh

from designer.builds.design import EXPORTERS, Design
from tests.support.designs import COARSE, design_of, small

GOLD, BLUE = "#d0a010", "#102030"


def files_of(design: Design) -> dict[str, bytes]:
    return {suffix: content for suffix, content, _ in EXPORTERS["colour"](design)}


@pytest.mark.parametrize(
    "design", [small("ico"), small("cube"), small("solid"), design_of("board", size="60x60mm", build="sheet")]
)
def test_rings_have_their_centres(design: Design) -> None:
    """In the target's frame, each ring's ink has its centre of gravity within a micrometre of the target's centre."""
    mesh = trimesh.load_mesh(io.BytesIO(files_of(design)["colour.ply"]), file_type="ply", process=False)
    is_ink = mesh.visual.face_colors[:, 0] == 0
    parts = trimesh.graph.connected_components(mesh.face_adjacency, nodes=np.flatnonzero(is_ink))
    parts = [part for part in parts if np.ptp(mesh.triangles[part], axis=(0, 1)).max() < 8]
    centres = [mesh.triangles_center[part].T @ mesh.area_faces[part] / mesh.area_faces[part].sum() for part in parts]
    away = np.linalg.norm(design.target.center_mm[:, None] - centres, axis=2).min(axis=1)
    assert away.max() < 1e-3


def test_colours_are_those_of_the_design_in_every_file() -> None:
    """Of body and ink, as sRGB: in a PLY's faces and corners, as a 3MF's materials, in MTL and VRML as shares."""
    files = files_of(design_of("cube", edge="28mm", body_colour=GOLD, ink_colour=BLUE, chord_error=COARSE))
    mesh = trimesh.load_mesh(io.BytesIO(files["colour.ply"]), file_type="ply", process=False)
    assert {bytes(one[:3]).hex() for one in mesh.visual.face_colors} == {GOLD[1:], BLUE[1:]}
    reader = (model := lib3mf.get_wrapper().CreateModel()).QueryReader("3mf")
    reader.ReadFromBuffer(files["colour.3mf"])
    (groups := model.GetBaseMaterialGroups()).MoveNext()
    group = groups.GetCurrentBaseMaterialGroup()
    found = [group.GetDisplayColor(number) for number in group.GetAllPropertyIDs()]
    assert [f"#{one.Red:02x}{one.Green:02x}{one.Blue:02x}" for one in found] == [GOLD, BLUE]
    assert b"0.815686 0.627451 0.0627451, 0.0627451 0.12549 0.188235" in files["colour.wrl"]


def test_a_3mf_stands_on_its_bed_and_has_a_picture() -> None:
    """Where the printed part would: nothing is below zero, which the specification asks for."""
    reader = (model := lib3mf.get_wrapper().CreateModel()).QueryReader("3mf")
    reader.ReadFromBuffer(files_of(small("cube"))["colour.3mf"])
    low, high = (
        np.array(list(corner)) for corner in (model.GetOutbox().MinCoordinate, model.GetOutbox().MaxCoordinate)
    )
    assert low.min() >= -1e-6
    np.testing.assert_allclose(high - low, 28, atol=1e-4)
    assert model.GetPackageThumbnailAttachment().GetPath() == "/Metadata/thumbnail.png"
