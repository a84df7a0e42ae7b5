"""The laws of all tables that are read: any order of columns and lines, and one line on what is no table.

What the numbers must be beyond that is held where each table is read.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import calib
from calib.cameras.rig import Rig
from calib.core.types import Detections
from calib.observe.correspondences import read_observations
from calib.observe.dataset import detections_to_csv, read_detections
from calib.observe.observations import known_points
from calib.observe.point_target import read_planes, read_points
from calib.observe.rig_observations import read_rig_sightings, rig_sightings_to_csv
from calib.observe.rig_photos import RigPhoto, read_photo_table, read_stamps
from calib.observe.robot_poses import read_robot_poses
from calib.renderer.poses import load_poses
from designer.base.errors import InputError
from tests.support.calibrations import board, camera
from tests.support.rig_views import stereo_pair

BOARD, SIZE = board(5, 4), (640, 480)
RIG = Rig(("a", "b"), (camera(),) * 2, np.stack([np.eye(4), np.eye(4) + 9 * np.eye(4, k=3)]), None, np.full(2, 0.1))
PHOTOS = (RigPhoto("left", Path("1.png"), "1"),)


def _detections() -> str:
    ring, rng = np.arange(8), np.random.default_rng(0)
    covariance = np.tile([[0.02, 0.01], [0.01, 0.02]], (8, 1, 1))
    seen = Detections(
        "a b.png", SIZE, BOARD.layout_id, BOARD.geometry_id, ring, BOARD.center_mm[ring], rng.uniform(0, 400, (8, 2)),
        covariance, np.ones((8, 5)), (),
    )  # fmt: skip
    return detections_to_csv([seen], BOARD)


def _corners() -> str:
    """Nine corners of two photos."""
    places = [(photo, x, y) for photo in "ab" for x in (0.5, 20, 50) for y in (0.25, 30, 60)]
    rows = [f"{one},{100 + 5 * x + y},{300 - 3 * y + x},{x},{y},{x * y / 9},0,1,0.5,1" for one, x, y in places]
    return "\n".join([f"# image_size {SIZE[0]} x {SIZE[1]}", "image,u,v,X,Y,Z,face,suu,suv,svv", *rows]) + "\n"


@dataclass(frozen=True)
class Table:
    """A kind of table: an example, how it is read, and which columns hold texts."""

    text: Callable[[], str]
    read: Callable[[Path], object]
    texts: tuple[str, ...] = ()
    free: tuple[str, ...] = ()  # columns that may be left out
    may_be_empty: bool = False


TABLES: Mapping[str, Table] = {
    "detections": Table(
        _detections, lambda path: read_detections(path, BOARD, target_path=Path("t")), ("image",), may_be_empty=True
    ),
    "correspondences": Table(_corners, read_observations, ("image",), ("face",)),
    "sightings of a rig": Table(
        lambda: rig_sightings_to_csv(stereo_pair(known_points(BOARD), frames=2).observations).decode(),
        read_rig_sightings, ("camera", "frame"), ("face", "diameter_mm", "suu"),
    ),
    "photos of a rig": Table(
        lambda: "camera,frame,file,time_s\nleft,1,1.png,0.5\nright,1,2.png,0.5\n",
        read_photo_table, ("camera", "frame", "file"), ("frame", "time_s"),
    ),
    "time stamps": Table(
        lambda: "camera,file,time_s\nleft,1.png,0.5\n", lambda path: read_stamps(path, PHOTOS), ("camera", "file")
    ),
    "points": Table(
        lambda: "id,X,Y,Z,plane\n1,0,0,0,a\n2,5,0,0,a\n3,0,5,0,a\n", read_points, ("plane",), ("id", "plane")
    ),
    "planes": Table(lambda: "plane,nx,ny,nz,d\na,0,0,1,5\nb,1,0,0,5\n", read_planes, ("plane",)),
    "robot poses": Table(
        lambda: "image,x_mm,y_mm,z_mm,qx,qy,qz,qw\na,1,2,3,0,0,0,1\nb,4,5,6,0,0,1,0\n", read_robot_poses, ("image",)
    ),
    "poses": Table(lambda: "rx_rad,ry_rad,rz_rad,tx_mm,ty_mm,tz_mm\n0,0,0,1,2,3\n0.5,0,0,4,5,6\n", load_poses),
    "points seen by a rig": Table(
        lambda: "camera,frame,point,u,v,sigma_px\na,f,p,600,400,1\nb,f,p,500,400,1\n",
        lambda path: calib.triangulate(RIG, path), ("camera", "frame", "point"), ("sigma_px",),
    ),
}  # fmt: skip
each_table = pytest.mark.parametrize("name", TABLES)


@cache
def example(name: str) -> tuple[tuple[str, ...], tuple[str, ...], tuple[tuple[str, ...], ...]]:
    """The lines above, the names of columns, and the cells of each row."""
    lines = TABLES[name].text().splitlines()
    head = next(row for row, line in enumerate(lines) if not line.startswith("#"))
    rows = tuple(tuple(line.split(",")) for line in lines[head + 1 :])
    return tuple(lines[:head]), tuple(lines[head].split(",")), rows


def refused(name: str, path: Path, text: str) -> str:
    """The one line on a table, which names its file."""
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        TABLES[name].read(path)
    said = str(caught.value)
    assert said.startswith(str(path))
    assert "\n" not in said
    assert len(said) < len(str(path)) + 400
    return said


@each_table
def test_a_table_is_read_as_it_stands_and_as_a_person_types_it(name: str, tmp_path: Path) -> None:
    """Spaces after commas, empty lines and comments above the columns do not count."""
    head, columns, rows = example(name)
    path = tmp_path / "t.csv"
    path.write_text(TABLES[name].text())
    TABLES[name].read(path)
    path.write_text("\n".join([*head, "# by hand", "", ", ".join(columns), *map(", ".join, rows)]))
    TABLES[name].read(path)


@each_table
def test_what_is_no_number_is_named_with_its_line(name: str, tmp_path: Path) -> None:
    """In every column of numbers: what is not finite, no digits, digits of another script, or far too many of them."""
    head, columns, rows = example(name)
    line = len(head) + 1 + len(rows)
    for place, column in enumerate(columns):
        if column in TABLES[name].texts:
            continue
        for odd in ("nan", "1e999", "-inf", "x", "", "1_0", "0mm", "\u0663", "9" * 5000):
            last = [*rows[-1][:place], odd, *rows[-1][place + 1 :]]
            said = refused(name, tmp_path / "t.csv", "\n".join([*head, *map(",".join, (columns, *rows[:-1], last))]))
            assert f"line {line}: " in said, (column, odd, said)
            assert column in said, (column, odd, said)


@each_table
def test_columns_that_are_missing_or_there_twice_are_named(name: str, tmp_path: Path) -> None:
    """With their line; so is a table whose values stand apart by something else than commas."""
    head, columns, rows = example(name)
    for place, column in enumerate(columns):
        again = refused(
            name, tmp_path / "t.csv", "\n".join([*head, *(",".join([*row, row[place]]) for row in (columns, *rows))])
        )
        assert column in again
        if column not in TABLES[name].free:
            less = (row[:place] + row[place + 1 :] for row in (columns, *rows))
            assert column in refused(name, tmp_path / "t.csv", "\n".join([*head, *map(",".join, less)]))
    refused(name, tmp_path / "t.csv", "\n".join([*head, *map(";".join, (columns, *rows))]))


@each_table
def test_what_is_no_table_is_refused_in_one_line(name: str, tmp_path: Path) -> None:
    """No file, a name that no file has, other bytes, nothing, no row, a row too short or too long, an open quote."""
    head, columns, rows = example(name)
    path, whole, row = tmp_path / "t.csv", TABLES[name].text(), ",".join(rows[-1])
    above = "\n".join([*head, ",".join(columns)]) + "\n"
    no_rows = () if TABLES[name].may_be_empty else (above,)
    for text in ("", "\n\n", "#", "\0" * 100, "[]", *no_rows, whole + '"a', whole + "a,1\n", whole + row + ",1\n"):
        said = refused(name, path, text)
        if text.startswith(whole):
            assert f"line {len(whole.splitlines()) + 1}: " in said
    path.write_bytes(b"\xff\xfe\x00")
    for place in (path, tmp_path, tmp_path / "none.csv", Path("a\0b.csv")):
        with pytest.raises(InputError, match=r"^[^\n]+$"):
            TABLES[name].read(place)


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_a_damaged_table_gives_whole_values_or_is_refused(data: st.DataObject, tmp_path: Path) -> None:
    """Bytes that are changed anywhere, and cuts: what can be used, or one line."""
    name = data.draw(st.sampled_from(sorted(TABLES)))
    content = bytearray(TABLES[name].text().encode())
    for at, value in data.draw(st.lists(st.tuples(st.integers(0, len(content) - 1), st.integers(0, 255)), max_size=5)):
        content[at] = value
    path = tmp_path / "t.csv"
    path.write_bytes(content[: data.draw(st.integers(0, len(content)))] if data.draw(st.booleans()) else content)
    try:
        found = TABLES[name].read(path)
    except InputError:
        return
    for one in found if isinstance(found, tuple) else (found,):
        assert np.isfinite(getattr(one, "center_px", 0.0)).all()
        if (covariance := getattr(one, "cov_px2", None)) is not None:
            assert (np.linalg.eigvalsh(covariance) > 0).all()
