"""The corners of planar grids as mrcal writes them: read as mrcal reads them."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from calib.observe.corners_vnl import PointGrid
from calib.observe.correspondences import read_observations
from designer.base.errors import InputError
from tests.support.calibrations import sightings
from tests.support.programs import run

SIZE = (1200, 900)
GRID = PointGrid(9, 7, 12.0)
MRCAL_PYTHON = "/usr/bin/python3"


def corners_text(level: Callable[[int], str], missing: set[int] | None = None) -> str:
    """A corners.vnl of three photos, one without a grid."""
    seen = sightings(GRID.points())
    lines = ["## made by a test", "# filename x y level", "lost.png - - -"]
    for view, name in enumerate(seen.view_names[:3]):
        assert (seen.view == view).sum() == GRID.count
        for k, (u, v) in enumerate(seen.center_px[seen.view == view]):
            lines.append(f"{name} - - -" if k in (missing or set()) else f"{name} {u:.6f} {v:.6f} {level(k)}")
    return "\n".join(lines) + "\n"


@pytest.mark.skipif(shutil.which("mrcal-calibrate-cameras") is None, reason="mrcal is not installed")
def test_corners_are_read_as_mrcal_reads_them(tmp_path: Path) -> None:
    """The reader of mrcal gives the same pixels, the same weights, and leaves the same corners out."""
    path = tmp_path / "corners.vnl"
    path.write_text(corners_text(lambda k: "-" if k == 5 else str(k % 3) if k % 7 else "-1", {0, 11}))
    script = (
        "import sys, json, mrcal\n"
        f"o, _, names = mrcal.compute_chessboard_corners({GRID.columns}, {GRID.rows}, corners_cache_vnl=sys.argv[1])\n"
        "print(json.dumps([names, o.tolist()]))"
    )
    answer = run(MRCAL_PYTHON, "-c", script, path, cwd=tmp_path)
    names, theirs = json.loads(answer.stdout)
    ours = read_observations(path, image_size=SIZE, grid=GRID)
    assert ours.remarks == ("left out views that show none of the points: lost.png",)
    one = ours
    for view, name in enumerate(one.view_names):
        mine = np.full((GRID.count, 3), -1.0)
        rows = one.view == view
        mine[one.point[rows], :2] = one.center_px[rows]
        mine[one.point[rows], 2] = 1 / np.sqrt(one.cov_px2[rows, 0, 0])
        (index,) = [k for k, other in enumerate(names) if Path(other).name == name]
        expected = np.array(theirs[index]).reshape(-1, 3)
        expected[expected[:, 2] < 0] = -1
        assert mine == pytest.approx(expected, abs=1e-9)


def test_weights_of_corners(tmp_path: Path) -> None:
    """A level halves the weight, a weight is taken as it is, and equal weights are no weights."""
    path = tmp_path / "corners.vnl"
    path.write_text(corners_text(lambda k: "1" if k % 2 else "0"))
    levels = read_observations(path, image_size=SIZE, grid=GRID)
    assert levels.cov_px2[:, 0, 0] == pytest.approx(np.where(levels.point % 2, 4.0, 1.0))
    weights = corners_text(lambda k: "0.5" if k % 2 else "1").replace("level", "weight")
    path.write_text(weights)
    assert np.array_equal(read_observations(path, image_size=SIZE, grid=GRID).cov_px2, levels.cov_px2)
    path.write_text(corners_text(lambda _: "0"))
    assert read_observations(path, image_size=SIZE, grid=GRID).cov_px2 is None


def at_line(number: int, text: str) -> Callable[[list[str]], list[str]]:
    """Another text in a line, counted from 1."""
    return lambda lines: [*lines[: number - 1], text, *lines[number:]]


@pytest.mark.parametrize(
    ("change", "rule"),
    [
        (at_line(4, "view_0000.png 1 x 0"), "line 4: y must be a number"),
        (at_line(4, "view_0000.png nan 1 0"), "line 4: x must be a number"),
        (at_line(4, "view_0000.png 1 1 99"), "line 4: level 99 is too high"),
        (at_line(4, "view_0000.png 1 1 1 1"), "line 4: 5 values; a line has 4"),
        (at_line(4, "view_0000.png"), "line 4: 1 values; a line has 4"),
        (lambda lines: [*lines, lines[3]], "a second time"),
        (lambda lines: lines[:-1], "has 62 corners, but a grid of 9 x 7 has 63; check --grid"),
        (lambda lines: lines[:2], "holds no corners"),
    ],
)
def test_a_corner_that_breaks_a_rule_is_named(
    change: Callable[[list[str]], list[str]], rule: str, tmp_path: Path
) -> None:
    """Each broken rule refuses a corners.vnl in one line, with its number where there is one."""
    path = tmp_path / "corners.vnl"
    path.write_text("\n".join(change(corners_text(lambda _: "0").splitlines())) + "\n")
    with pytest.raises(InputError) as refused:
        read_observations(path, image_size=SIZE, grid=GRID)
    assert str(refused.value).startswith(str(path))
    assert rule in str(refused.value)
    assert "\n" not in str(refused.value)


@given(data=st.data())
@settings(max_examples=100, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_damaged_files_end_in_observations_or_one_line(data: st.DataObject, tmp_path: Path) -> None:
    """Changed bytes and cuts give whole observations or a refusal."""
    path = tmp_path / "c.vnl"
    content = bytearray(corners_text(lambda k: str(k % 2)).encode())
    for at, value in data.draw(st.lists(st.tuples(st.integers(0, len(content) - 1), st.integers(0, 255)), max_size=5)):
        content[at] = value
    path.write_bytes(content[: data.draw(st.integers(0, len(content)))] if data.draw(st.booleans()) else content)
    try:
        seen = read_observations(path, image_size=SIZE, grid=GRID)
    except InputError:
        return
    assert np.isfinite(seen.center_px).all()
    assert (np.bincount(seen.view) >= 4).all()
    assert seen.cov_px2 is None or (np.linalg.eigvalsh(seen.cov_px2) > 0).all()
