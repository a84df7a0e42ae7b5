"""Binary STL by its bytes and by admesh; `tests/laws` read it with trimesh."""

import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from designer.formats.stl import stl_bytes
from designer.make.mesh import Mesh
from designer.spec.kind import KINDS
from tests.support.designs import ink_of, small
from tests.support.programs import run


@pytest.fixture(params=KINDS, scope="module")
def mesh(request: pytest.FixtureRequest) -> Mesh:
    return ink_of(small(request.param))


def test_stored_normals_point_outward(mesh: Mesh) -> None:
    """The normals in the file have length 1 and, weighted with the corners, give the enclosed volume."""
    facets = np.frombuffer(stl_bytes(mesh)[84:], dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("_", "<u2")])
    normal, corners = facets["normal"].astype(float), facets["corners"].astype(float)
    assert np.linalg.norm(normal, axis=1) == pytest.approx(1.0, abs=1e-6)
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
    outward = (normal * corners.mean(axis=1)).sum(axis=1)
    assert (area * outward).sum() / 3 == pytest.approx(mesh.volume_mm3, rel=1e-5)


def test_header_is_not_that_of_a_text_file(mesh: Mesh) -> None:
    """The header has 80 bytes, does not begin with "solid", and the count and length fit the triangles."""
    content = stl_bytes(mesh)
    assert not content.startswith(b"solid")
    assert int.from_bytes(content[80:84], "little") == len(mesh.triangles)
    assert len(content) == 84 + 50 * len(mesh.triangles)


@pytest.mark.skipif(shutil.which("admesh") is None, reason="admesh is not installed (Debian package admesh)")
def test_admesh_finds_nothing_to_repair(mesh: Mesh, tmp_path: Path) -> None:
    """The exact check of admesh leaves edges and normals as they are, and its volume agrees."""
    path = tmp_path / "mesh.stl"
    path.write_bytes(stl_bytes(mesh))
    report = run("admesh", path).stdout
    repairs = ("Edges fixed", "Facets removed", "Facets added", "Facets reversed", "Backwards edges", "Normals fixed")
    found = {name: int(re.search(rf"{name}\s*:\s*(\d+)", report)[1]) for name in repairs}
    assert found == dict.fromkeys(repairs, 0)
    assert re.search(r"Total disconnected facets\s*:\s*0\s+0$", report, re.MULTILINE)
    volume = float(re.search(r"Volume\s*:\s*(-?[\d.]+)", report)[1])
    assert volume == pytest.approx(mesh.volume_mm3, rel=1e-4)
