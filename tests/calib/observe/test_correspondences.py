"""Correspondences from elsewhere: the same data in any of the three kinds of file are the same observations."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib.core.types import KnownPoints, Observations
from calib.observe.corners_vnl import PointGrid
from calib.observe.correspondences import read_correspondences, read_observations, require_inside
from calib.observe.dataset import write_detections
from calib.observe.observations import known_points
from calib.observe.point_target import PointTable, points_with_planes, target_from_points
from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.target import target_to_json
from tests.support.calibrations import board, icosahedron, sightings
from tests.support.command_line import detections_of

BOARD, ICO = board(), icosahedron()
SIZE = (1200, 900)
GRID = PointGrid(9, 7, 12.0)


def as_rows(seen: Observations) -> dict[str, list[str]]:
    """The cells of a CSV, column by column."""
    covariance = np.zeros((len(seen.view), 2, 2)) if seen.cov_px2 is None else seen.cov_px2
    numbers = {
        **dict(zip("uv", seen.center_px.T, strict=True)),
        **dict(zip("XYZ", seen.points.position_mm[seen.point].T, strict=True)),
        **dict(zip(("suu", "suv", "svv"), covariance.reshape(-1, 4)[:, [0, 1, 3]].T, strict=True)),
    }
    cells = {name: [repr(float(value)) for value in column] for name, column in numbers.items()}
    cells["image"] = [seen.view_names[view] for view in seen.view]
    cells["face"] = [str(face) for face in seen.points.face[seen.point]]
    return cells


def write_csv(
    path: Path, cells: dict[str, list[str]], columns: str, order: list[int] | None = None, head: str = ""
) -> Path:
    """A CSV with some of the columns and lines, in some order."""
    names = columns.split(",")
    rows = list(zip(*(cells[name] for name in names), strict=True))
    lines = [",".join(rows[k]) for k in (order or range(len(rows)))]
    path.write_text(head + "\n".join([columns, *lines]) + "\n")
    return path


USUAL = "image,u,v,X,Y,Z"
SIZE_LINE = "# image_size 1200 x 900\n"


@pytest.mark.parametrize("columns", [USUAL, "Z,face,v,X,image,Y,u", "suu,X,Y,Z,image,svv,u,v,suv"])
@pytest.mark.parametrize("points", [known_points(BOARD), known_points(ICO)], ids=["board", "icosahedron"])
def test_what_is_written_is_read_in_any_order(columns: str, points: KnownPoints, tmp_path: Path) -> None:
    """Columns and lines in any order: every sighting comes back with its numbers, bit for bit."""
    seen = sightings(points)
    order = np.random.default_rng(1).permutation(len(seen.view)).tolist()
    path = write_csv(tmp_path / "c.csv", as_rows(seen), columns, order, f"# by hand\n\n{SIZE_LINE}# more\n")
    read = read_correspondences(path)
    assert sorted(read.view_names) == sorted(seen.view_names)
    assert (np.diff(read.view) >= 0).all()

    def sorted_rows(one: Observations) -> list[tuple[object, ...]]:
        covariance = np.zeros((len(one.view), 2, 2)) if one.cov_px2 is None or "suu" not in columns else one.cov_px2
        return sorted(
            (one.view_names[view], *center, *place, *cov.ravel())
            for view, center, place, cov in zip(
                one.view, one.center_px.tolist(), (one.points.position_mm[one.point] + 0.0).tolist(), covariance,
                strict=True,
            )
        )  # fmt: skip

    assert sorted_rows(read) == sorted_rows(seen)
    assert (read.cov_px2 is None) == ("suu" not in columns)
    assert len(read.points.position_mm) == len(np.unique(seen.point))


def test_the_front_of_a_board_of_ours_tells_a_mirror(tmp_path: Path) -> None:
    """Rows counted from below are refused of a designed board; of others nobody knows the side that is seen."""
    seen = sightings(known_points(BOARD))
    below = replace(seen, center_px=np.array([0.0, SIZE[1] - 1]) + seen.center_px * np.array([1.0, -1.0]))
    by_others = target_from_points(PointTable(BOARD.center_mm, ("",) * BOARD.ring_count, np.arange(BOARD.ring_count)))
    for number, one in enumerate((seen, below)):
        write_csv(tmp_path / f"{number}.csv", as_rows(one), USUAL)
        alone = read_observations(tmp_path / f"{number}.csv", image_size=SIZE)
        assert "v is taken as counted downwards" in alone.remarks[-1]
        assert read_observations(tmp_path / f"{number}.csv", by_others, image_size=SIZE).view_names == seen.view_names
    assert read_observations(tmp_path / "0.csv", BOARD, image_size=SIZE).view_names == seen.view_names
    with pytest.raises(InputError, match="v is counted from below"):
        read_observations(tmp_path / "1.csv", BOARD, image_size=SIZE)


def test_three_kinds_of_file_are_told_apart_and_agree(tmp_path: Path) -> None:
    """detections.csv, a CSV with points and corners.vnl of the same photos give the same sightings."""
    target = known_points(BOARD)
    x, y, _ = BOARD.center_mm.T
    ring = np.lexsort((x, -np.round(y, 6)))  # row by row from the top left
    seen = sightings(target)
    write_detections(tmp_path / "d.csv", detections_of(seen, BOARD), BOARD)
    (tmp_path / "t.json").write_text(target_to_json(BOARD))
    write_csv(tmp_path / "c.csv", as_rows(seen), USUAL)
    lines = ["# filename x y level"]
    for view, name in enumerate(seen.view_names):
        center = np.full((BOARD.ring_count, 2), np.nan)
        center[seen.point[seen.view == view]] = seen.center_px[seen.view == view]
        lines += [f"{name} {u:.6f} {v:.6f} 0" if np.isfinite(u) else f"{name} - - -" for u, v in center[ring]]
    (tmp_path / "c.vnl").write_text("\n".join(lines) + "\n")
    ours = read_observations(tmp_path / "d.csv", tmp_path / "t.json")
    table = read_observations(tmp_path / "c.csv", image_size=SIZE)
    corners = read_observations(tmp_path / "c.vnl", image_size=SIZE, grid=GRID)
    for other in (table, corners):
        assert other.view_names == ours.view_names
        assert other.image_size == ours.image_size
        assert np.bincount(other.view).tolist() == np.bincount(ours.view).tolist()
        assert sorted(map(tuple, other.center_px.tolist())) == sorted(map(tuple, ours.center_px.tolist()))
        assert (other.points.face == 0).all()
    # The grid of corners.vnl has its origin at the top left corner and y downwards.
    moved = corners.points.position_mm * np.array([1, -1, 1]) + BOARD.center_mm[ring[0]]
    assert np.abs(moved - BOARD.center_mm[ring]).max() < 1e-6


def test_what_does_not_belong_together_is_refused(tmp_path: Path) -> None:
    """A target is needed for detections and for nothing else; sizes and grids for what does not hold them."""
    (tmp_path / "t.json").write_text(target_to_json(BOARD))
    write_detections(tmp_path / "d.csv", [], BOARD)
    write_csv(tmp_path / "c.csv", as_rows(sightings(known_points(BOARD))), USUAL)
    (tmp_path / "c.vnl").write_text("# filename x y\na 1 2\n")
    target = tmp_path / "t.json"
    for name, options, rule in (
        ("d.csv", {}, "--target"),
        ("d.csv", {"target": target, "image_size": SIZE}, "leave --image-size"),
        ("c.csv", {}, "the image size is not known.*--image-size"),
        ("c.vnl", {"image_size": SIZE, "target": target}, "leave --target out"),
        ("c.csv", {"image_size": SIZE, "grid": GRID}, "leave --grid out"),
        ("c.csv", {"image_size": (500, 500)}, "far outside an image of 500 x 500 px; check the image size"),
        ("c.vnl", {"image_size": SIZE}, r"--grid 10x7 --pitch"),
        ("c.vnl", {"grid": GRID}, "--image-size"),
        ("c.vnl", {"grid": GRID, "image_size": SIZE}, "line 2: a has 1 corners, but a grid of 9 x 7 has 63"),
        ("nothing.csv", {}, "cannot be read"),
        ("", {}, "not a regular file"),
    ):
        with pytest.raises(InputError, match=rule) as refused:
            read_observations(tmp_path / name, **options)  # type: ignore[arg-type]
        assert str(refused.value).startswith(str(tmp_path / name))
        assert "\n" not in str(refused.value)


def test_planes_are_found_or_taken_from_faces(tmp_path: Path) -> None:
    """All in one plane: that plane. Else each face's, by its own number. Else none."""
    ico = known_points(ICO)
    with_faces, _ = points_with_planes(ico.position_mm, ico.face)
    assert np.array_equal(with_faces.face, ico.face)
    sign = np.sign((with_faces.plane[:, :3] * ico.plane[:, :3]).sum(axis=1))
    assert np.abs(with_faces.plane * sign[:, None] - ico.plane).max() < 1e-9
    without, _ = points_with_planes(ico.position_mm, None)
    assert (without.face == -1).all()
    tilted = known_points(BOARD).position_mm @ np.linalg.qr(np.arange(9.0).reshape(3, 3) + np.eye(3))[0] + 40
    flat, (extent,) = points_with_planes(tilted, None)
    assert (flat.face == 0).all()
    assert np.abs(tilted @ flat.plane[0, :3] - flat.plane[0, 3]).max() < 1e-9
    assert extent.startswith("X, Y, Z are taken as mm")
    bent = tilted + np.array([0, 0, 1e-3])[None] * (np.arange(len(tilted)) % 3)[:, None]
    assert (points_with_planes(bent, None)[0].face == -1).all()
    some = np.where(ico.face == 3, 7000, -1)
    some[np.flatnonzero(ico.face == 4)[:2]] = 12  # two points span no plane
    part, _ = points_with_planes(ico.position_mm, some)
    assert np.array_equal(part.face, np.where(ico.face == 3, 7000, -1))
    rough = ico.position_mm.copy()
    rough[np.flatnonzero(ico.face == 5)[0]] *= 1.05
    assert "faces whose points are off their mean plane: 5 by" in points_with_planes(rough, ico.face)[1][1]


def test_mirrored_points_are_refused(tmp_path: Path) -> None:
    """A left-handed frame of a solid is one clear line; a left-handed numbering of a plane does no harm."""
    solid, flat = as_rows(sightings(known_points(ICO))), as_rows(sightings(known_points(BOARD)))
    for cells in (solid, flat):
        cells["Y"] = [str(-float(cell)) for cell in cells["Y"]]
    with pytest.raises(InputError, match=r"s\.csv: the points are mirrored.*right-handed"):
        read_correspondences(write_csv(tmp_path / "s.csv", solid, USUAL, head=SIZE_LINE))
    read = read_correspondences(write_csv(tmp_path / "f.csv", flat, USUAL, head=SIZE_LINE))
    assert read.view_count == 4


def cell(column: str, value: str, columns: str = USUAL) -> Callable[[list[str]], list[str]]:
    """A change of one value in the last line."""

    def change(lines: list[str]) -> list[str]:
        cells = lines[-1].split(",")
        cells[columns.split(",").index(column)] = value
        return [*lines[:-1], ",".join(cells)]

    return change


def header(text: str) -> Callable[[list[str]], list[str]]:
    """Other column names."""
    return lambda lines: [lines[0], text, *lines[2:]]


CHANGES: dict[str, tuple[Callable[[list[str]], list[str]], str]] = {
    "misspelt": (header("images,u,v,X,Y,Z"), "line 2: column 'image' is missing; did you mean 'images'?"),
    "capitals": (header("image,u,v,x,y,z"), "line 2: column 'X' is missing"),
    "half covariance": (header("image,u,v,X,Y,Z,suu"), "line 2: the accuracy is sigma, weight, or suu,suv,svv"),
    "two accuracies": (header("image,u,v,X,Y,Z,sigma,weight"), "line 2: the accuracy is sigma, weight, or suu,suv,svv"),
    "far": (cell("X", "1e8"), "line 11: X, Y or Z is beyond"),
    "far away": (cell("u", "-2e6"), "line 11: u or v is beyond"),
    "no name": (cell("image", ""), "line 11: image must not be empty"),
    "again": (lambda lines: [*lines, lines[4]], "line 12: the same point of the same image a second time"),
    "size": (lambda lines: ["# image_size 0 x 900", *lines[1:]], "line 1: image_size 0 x 900"),
    "two sizes": (lambda lines: ["# image_size 1 x 1", *lines], "line 2: image_size 1200 x 900"),
}


@pytest.mark.parametrize("name", CHANGES)
def test_a_line_that_breaks_a_rule_is_named(name: str, tmp_path: Path) -> None:
    """Each broken rule refuses the file in one line, with its number where there is one."""
    change, rule = CHANGES[name]
    path = write_csv(tmp_path / "c.csv", as_rows(sightings(known_points(BOARD))), USUAL, list(range(9)), SIZE_LINE)
    path.write_text("\n".join(change(path.read_text().splitlines())) + "\n")
    with pytest.raises(InputError) as refused:
        read_observations(path)
    message = str(refused.value)
    assert message.startswith(str(path))
    assert rule in message
    assert "\n" not in message
    assert len(message) < 400


@pytest.mark.parametrize(
    ("column", "value", "rule"),
    [
        ("sigma", "0", "sigma must be from"),
        ("sigma", "1e9", "sigma must be from"),
        ("weight", "0", "weight must be from 0.0001 to 10000; leave out lines that are not to count"),
        ("weight", "-1", "weight must be from"),
        ("face", "1.5", "face must be a whole number"),
        ("face", "100000", "face must be from 0 to 9999"),
        ("face", "3", "the point has another face on an earlier line"),
        ("suv", "9", "suu, suv, svv must be a covariance"),
    ],
)
def test_optional_columns_have_rules_too(column: str, value: str, rule: str, tmp_path: Path) -> None:
    """Accuracies must be possible, and a point lies on one face."""
    cells = as_rows(sightings(known_points(BOARD)))
    cells["sigma"] = cells["weight"] = ["0.1"] * len(cells["u"])
    names = f"{USUAL},{column}" if column != "suv" else f"{USUAL},suu,suv,svv"
    path = write_csv(tmp_path / "c.csv", cells, names, head=SIZE_LINE)
    assert read_correspondences(path).view_count == 4
    lines = cell(column, value, names)(path.read_text().splitlines())
    path.write_text("\n".join(lines) + "\n")
    with pytest.raises(InputError, match=rf"line {len(lines)}: .*{rule}|line {len(lines)}: {rule}"):
        read_correspondences(path)


def test_a_sigma_is_a_round_covariance_and_other_columns_are_said(tmp_path: Path) -> None:
    """`sigma` gives sigma^2 I; a column that is not known is not used, and named."""
    cells = as_rows(sightings(known_points(BOARD)))
    cells["sigma"] = [str(0.1 + 0.01 * (k % 5)) for k in range(len(cells["u"]))]
    cells["Sigma "] = cells["sigma"]
    done = read_correspondences(write_csv(tmp_path / "c.csv", cells, f"{USUAL},sigma,Sigma ", head=SIZE_LINE))
    expected = np.array(cells["sigma"], dtype=float)[:, None, None] ** 2 * np.eye(2)
    order = np.lexsort((done.center_px[:, 0], done.view))
    given = np.lexsort((np.array(cells["u"], dtype=float), sightings(known_points(BOARD)).view))
    assert done.cov_px2[order] == pytest.approx(expected[given])
    assert "columns that are not used: 'Sigma '" in done.remarks


def test_a_weight_is_one_over_sigma(tmp_path: Path) -> None:
    """A column `weight` says of each sighting what `sigma` does with 1 / weight."""
    cells = as_rows(sightings(known_points(BOARD)))
    cells["weight"] = [("1", ".5", "0.25")[k % 3] for k in range(len(cells["u"]))]
    cells["sigma"] = [{"1": "1", ".5": "2", "0.25": "4"}[weight] for weight in cells["weight"]]
    weighted, stated = (
        read_correspondences(write_csv(tmp_path / "c.csv", cells, f"{USUAL},{name}", head=SIZE_LINE)).cov_px2
        for name in ("weight", "sigma")
    )
    assert weighted is not None
    assert weighted == pytest.approx(stated)


def test_a_table_says_what_its_points_are(tmp_path: Path) -> None:
    """A column, the command, or the target's dots tell the circles; else nobody did."""
    seen = sightings(known_points(BOARD))
    cells = as_rows(seen)
    cells["diameter_mm"] = ["6.5"] * len(seen.view)
    bare = write_csv(tmp_path / "bare.csv", cells, USUAL, head=SIZE_LINE)
    told = write_csv(tmp_path / "told.csv", cells, f"{USUAL},diameter_mm", head=SIZE_LINE)
    points = PointTable(BOARD.center_mm, ("",) * BOARD.ring_count, np.arange(BOARD.ring_count))
    dots, none = (target_from_points(points, diameter_mm=size) for size in (5.0, 0.0))

    def circle_mm(path: Path, **words: object) -> Array:
        found = read_observations(path, **words).points.circle_mm  # type: ignore[arg-type]
        assert found is not None
        return found

    assert np.isnan(circle_mm(bare)).all()
    assert np.isnan(circle_mm(bare, target=none)).all()
    assert (circle_mm(bare, points="corner") == 0).all()
    assert (circle_mm(bare, target=dots, points="ring") == 0).all()
    assert (circle_mm(bare, points="circle", diameter_mm=7.0) == 7.0).all()
    assert (circle_mm(bare, target=dots) == 5.0).all()
    assert (circle_mm(told) == 6.5).all()
    assert (circle_mm(told, points="circle") == 6.5).all()


@pytest.mark.parametrize(
    ("words", "rule"),
    [
        ({"points": "blob"}, "give corner, ring, or circle:13mm"),
        ({"points": "circle"}, "diameter is not known"),
        ({"points": "corner", "diameter_mm": 3.0}, "is of circles"),
        ({"diameter_mm": 3.0}, "is of circles"),
        ({"points": "circle", "diameter_mm": 13.0}, "circles of 13 mm overlap if 12 mm apart"),
    ],
)
def test_points_that_cannot_be_are_refused(words: dict[str, object], rule: str, tmp_path: Path) -> None:
    """With the rule and the remedy."""
    bare = write_csv(tmp_path / "b.csv", as_rows(sightings(known_points(BOARD))), USUAL, head=SIZE_LINE)
    with pytest.raises(InputError, match=re.escape(rule)):
        read_observations(bare, **words)  # type: ignore[arg-type]


def test_pictures_laid_on_their_side_are_asked_about() -> None:
    """Points outside the image that fit one of exchanged width and height: all of them, or a photo's."""
    seen = sightings(known_points(BOARD))
    corner = np.array([10.0, 1190.0])
    last = np.flatnonzero(seen.view == seen.view_count - 1)[0]
    center_px = np.minimum(seen.center_px, 880.0)
    center_px[last] = corner
    for u, question in (
        (880.0, "all fit 900 x 1200 px: are u and v exchanged"),
        (1190.0, "this photo fits 900 x 1200 px"),
    ):
        center_px[0] = u, 100.0
        with pytest.raises(InputError, match=question):
            require_inside(replace(seen, center_px=center_px), "t.csv")
