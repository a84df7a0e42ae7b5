"""Targets that others made, from a table of points: made, measured and solved with."""

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from calib.cameras import project
from calib.cameras.camera import load_camera
from calib.core.se3 import exp_rotation, look_at, transform
from calib.measure_target.solve import measure
from calib.measure_target.unknowns import AsBuiltOptions
from calib.observe.correspondences import read_observations
from calib.observe.point_target import Plane, PointTable, target_from_points
from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.target import load_target, target_to_json
from designer.tolerance.made import how_made
from tests.support.as_built_scenes import solid
from tests.support.command_line import LENIENT, Answer, calib, summary_of
from tests.support.solver_scenes import CAMERAS

BOARD = Path(__file__).parents[4] / "shared" / "real" / "wide-figueroa" / "corners.csv"
NOISE_PX = 0.1
CAMERA = CAMERAS["opencv"]
FACES = ("right", "back", "top")


def cube() -> PointTable:
    """Three sides of a cube of 160 mm, 36 points each."""
    x, y = (axis.ravel() for axis in np.meshgrid(np.linspace(-70, 70, 6), np.linspace(-70, 70, 6)))
    z = np.full_like(x, 80.0)
    sides = np.concatenate([np.stack(order, axis=1) for order in ((z, x, y), (y, z, x), (x, y, z))])
    return PointTable(sides, tuple(np.repeat(FACES, len(x))), 100 + np.arange(len(sides)))


@cache
def glued() -> Array:
    """Where its points are: each side was put on a little off its place."""
    rng, points = np.random.default_rng(1), cube()
    position = points.position_mm.copy()
    for name in FACES:
        rows = np.array([plane == name for plane in points.plane])
        middle = position[rows].mean(axis=0)
        turned = (position[rows] - middle) @ exp_rotation(rng.normal(0, 0.01, 3)).T
        position[rows] = turned + middle + rng.normal(0, 1.0, 3)
    return position


def write_points(name: str = "points.csv") -> None:
    """The table of the points as they should be."""
    points = cube()
    rows = zip(points.ids.tolist(), points.position_mm.tolist(), points.plane, strict=True)
    lines = ["id,X,Y,Z,plane", *(f"{one},{x:.6f},{y:.6f},{z:.6f},{plane}" for one, (x, y, z), plane in rows)]
    Path(name).write_text("\n".join(lines) + "\n")


@cache
def sightings() -> tuple[str, str]:
    """What a camera sees of the cube as it is: a table with ids, and one with coordinates as they should be."""
    rng, points = np.random.default_rng(2), cube()
    eye = 400.0 + rng.normal(0, 130, (16, 3))
    poses = look_at(eye, rng.normal(20, 20, (16, 3)), rng.uniform(-3, 3, 16))
    width, height = CAMERA.image_size
    head = f"# image_size {width} x {height}\nimage,u,v,"
    by_id, by_place = [head + "id"], [head + "X,Y,Z"]
    for view, pose in enumerate(poses):
        pixel = project(CAMERA, transform(pose, glued())) + rng.normal(0, NOISE_PX, (len(points.ids), 2))
        for row in np.flatnonzero(((pixel > 0) & (pixel < [width - 1, height - 1])).all(axis=1)):
            place = f"{view}.png,{pixel[row, 0]:.5f},{pixel[row, 1]:.5f},"
            by_id.append(place + str(points.ids[row]))
            by_place.append(place + ",".join(f"{value:.6f}" for value in points.position_mm[row]))
    return "\n".join(by_id) + "\n", "\n".join(by_place) + "\n"


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with the tables, and the target file made of them."""
    monkeypatch.chdir(tmp_path)
    write_points()
    for name, text in zip(("ids.csv", "places.csv"), sightings(), strict=True):
        Path(name).write_text(text)
    Path("cube.target.json").write_text(target_to_json(target_from_points(cube())))
    return tmp_path


def test_a_table_of_points_becomes_a_target() -> None:
    """Each point is where the table has it, on its plane, by its id; normals point away from the middle."""
    answer = calib("target", "--from", "points.csv", "-o", "made.target.json")
    assert answer.code == 0, answer
    assert Path("made.target.json").read_text() == Path("cube.target.json").read_text()
    target, points = load_target(Path("made.target.json")), cube()
    assert np.array_equal(target.center_mm, points.position_mm)
    assert target.ring_index[:, 0].tolist() == points.ids.tolist()
    assert np.abs(target.center_in_face_mm[:, 2]).max() < 1e-9
    assert target.target_from_face[:, :3, 2] == pytest.approx(np.eye(3))
    inside = target_from_points(points, inside=True)
    assert inside.target_from_face[:, :3, 2] == pytest.approx(-np.eye(3))
    planes = {name: Plane(-normal, -80.0) for name, normal in zip(FACES, np.eye(3), strict=True)}
    given = target_from_points(points, planes)
    assert given.target_from_face[:, :3, 2] == pytest.approx(-np.eye(3))
    assert "points without marks on 3 planes" in calib("target", "made.target.json").out


def test_a_cube_whose_sides_are_off_is_measured() -> None:
    """From sightings by ids the sides come out, and the camera solved with them is the true one."""
    answer = calib("measure", "cube.target.json", "ids.csv", "-o", "measured.target.json", "--held-out", "2")
    assert answer.code == 0, answer
    held = json.loads(Path("measured.as_built.json").read_text())["held_out"]
    reprojection = held["gains"][0]
    assert reprojection["nominal"] > 2
    assert reprojection["measured"] < 0.2 * reprojection["nominal"]
    solve = ("solve", "ids.csv", "--target", "measured.target.json", "--model", "opencv", "--no-page", "-o", "out")
    assert calib(*solve, *LENIENT).code == 0
    assert load_camera(Path("out/camera.json")).params[0] == pytest.approx(CAMERA.params[0], rel=5e-4)


@pytest.mark.skipif(not BOARD.is_file(), reason="the folder ../shared/real with real corners is absent")
def test_a_real_board_is_bent_as_others_found() -> None:
    """From corners of a chessboard its bend along both sides is what mrcal 2.2 finds with its own solver and lens."""
    size, names, *lines = BOARD.read_text().splitlines()
    cells = [line.split(",") for line in lines]
    # No model here follows this lens into its corners; a third of the photos, and of these the middle, is enough.
    some = [row for row in cells if int(row[0][5:]) % 3 == 0]
    used = [row for row in some if np.hypot(float(row[1]) - 3008, float(row[2]) - 2008) < 1700]
    Path("seen.csv").write_text("\n".join([size, names, *map(",".join, used)]) + "\n")
    position = np.unique([[float(cell) for cell in row[3:6]] for row in cells], axis=0)
    target = target_from_points(PointTable(position, ("",) * len(position), np.arange(len(position))))
    Path("board.target.json").write_text(target_to_json(target))
    seen = read_observations(Path("seen.csv"), Path("board.target.json"))
    found = measure([seen], target, "opencv", AsBuiltOptions(ring_sigma_mm=None, made=how_made(target, "fdm-board")))
    rim_mm = float(np.linalg.norm(target.outline_mm[0], axis=1).max())
    dome, saddle, _ = found.bow_mm[0] * (0.5 * np.ptp(position[:, 0]) / rim_mm) ** 2
    assert sorted(np.abs([dome + saddle, dome - saddle])) == pytest.approx([0.52, 1.04], abs=0.1)
    assert (dome + saddle) * (dome - saddle) < 0


def test_points_are_found_by_ids_or_places() -> None:
    """Both tables mean the same points of a target, also of one that was measured or that we designed."""
    made = target_from_points(PointTable(glued(), cube().plane, cube().ids))
    Path("moved.target.json").write_text(target_to_json(made))
    for target in ("cube.target.json", "moved.target.json"):
        one, two = (read_observations(Path(name), Path(target)) for name in ("ids.csv", "places.csv"))
        assert np.array_equal(one.point, two.point)
        assert np.array_equal(one.center_px, two.center_px)
    Path("ico.target.json").write_text(target_to_json(solid()))
    rows = [f"a.png,{100 + 7 * k},{100 + k * k},{k}" for k in range(12)]
    Path("ico.csv").write_text("\n".join(["# image_size 900 x 800", "image,u,v,id", *rows]) + "\n")
    assert read_observations(Path("ico.csv"), Path("ico.target.json")).point.tolist() == list(range(12))


def test_nothing_is_drawn_or_detected_of_points() -> None:
    """Without a diameter there is nothing to render; dots are rendered, but not detected; each is said in one line."""
    for command in (("render", "cube.target.json", "-o", "photos"), ("detect", "cube.target.json", ".", "-o", "x.csv")):
        refused(calib(*command), "points without marks")
    made = calib("target", "--from", "points.csv", "--diameter", "6mm", "-o", "dots.target.json")
    assert made.code == 0
    assert load_target(Path("dots.target.json")).radius_outer_mm == pytest.approx(3.0)
    refused(calib("detect", "dots.target.json", ".", "-o", "x.csv"), "dots without rings")


def test_advice_names_files_that_exist() -> None:
    """After a table the commands to type have its name, with the target's, or say how to make one."""
    pinhole = ("--model", "pinhole", "--no-page", "-o", "out")
    assert calib("solve", "ids.csv", "--target", "cube.target.json", *pinhole).code == 1
    advice = Path("out/verdict.json").read_text()
    assert "`calib measure cube.target.json ids.csv -o measured/cube.target.json`" in advice
    calib("solve", "places.csv", *pinhole)
    advice = Path("out/verdict.json").read_text()
    assert "detections.csv" not in advice
    assert "calib solve places.csv -o again" in advice


def refused(answer: Answer, message: str) -> None:
    """One line, and nothing written."""
    assert answer.code == 2, answer
    assert message in answer.err
    assert answer.err.count("\n") == 1


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        (["X,Y,Z,plane", "0,0,0,a", "1,1e9,0,a"], "line 3: X, Y or Z is beyond 1e+06 mm"),
        (["X,Y,Z,plane", "0,0,0,a", "5,5,0,a", "0,0,0,a"], "line 4: the same point as on line 2"),
        (["id,X,Y,Z", "7,0,0,0", "7,5,5,0"], "line 3: the id is that of an earlier line"),
        (["id,X,Y,Z", "-1,0,0,0"], "line 2: id must be from 0"),
        (["X,Y,Z,plane", "0,0,0,"], "line 2: plane must not be empty"),
        (["X,Y,Z,plane", "0,0,0,a", "5,0,0,a"], "plane 'a': 2 points"),
        (["X,Y,Z,plane", "0,0,0,a", "5,0,0,a", "9,0,0,a"], "lie on a line"),
        (["X,Y,Z", "0,0,0", "50,0,0", "0,50,0", "50,50,20"], "name each point's in a column plane"),
        (["X,Y,Z,plane", *(f"{n},0,0,{n}" for n in range(201))], "201 planes; at most 200 can be used"),
        (["X,Y,Z,plane", *(f"{n},0,0,{n % 200}" for n in range(2001))], "on so many planes at most 2000 points"),
    ],
)
def test_bad_tables_are_one_line(lines: list[str], message: str) -> None:
    """The line, the rule and the remedy; nothing is written."""
    Path("bad.csv").write_text("\n".join(lines) + "\n")
    refused(calib("target", "--from", "bad.csv", "-o", "new.target.json"), message)
    assert not Path("new.target.json").exists()


@pytest.mark.parametrize(
    ("planes", "message"),
    [
        ("plane,nx,ny,nz,d\nright,1,0,0,80\nback,0,1,0,80\n", "plane 'top': not in the table of planes"),
        ("plane,nx,ny,nz,d\nright,0,0,0,80\n", "line 2: nx, ny, nz must be a direction"),
        ("plane,nx,ny,nz,d\nright,1,0,0,80\nright,1,0,0,80\n", "line 3: the plane a second time"),
        ("plane,nx,ny,nz,d\nright,1,0,0,90\nback,0,1,0,80\ntop,0,0,1,80\n", "is 10 mm off it"),
    ],
)
def test_planes_that_are_none(planes: str, message: str) -> None:
    """A plane that is missing, none, named twice, or elsewhere."""
    Path("planes.csv").write_text(planes)
    refused(calib("target", "--from", "points.csv", "--planes", "planes.csv", "-o", "new.target.json"), message)


def test_options_of_a_table_are_never_ignored() -> None:
    """What says nothing without a table, or beside given planes, is refused."""
    for option in (("--diameter", "6mm"), ("--inside",), ("--planes", "planes.csv"), ("-o", "new.target.json")):
        refused(calib("target", "cube.target.json", *option), f"{option[0]}: belongs to --from POINTS.csv")
    given = ("--from", "points.csv", "--planes", "planes.csv", "--inside", "-o", "new.target.json")
    refused(calib("target", *given), "--inside: of fitted planes")


def test_a_table_that_determines_no_camera_is_a_negative_answer() -> None:
    """Too few points for a camera end as photos do that do not determine one: 1, with the reason."""
    lines = Path("places.csv").read_text().splitlines()
    head = next(row for row, line in enumerate(lines) if line.startswith("image,")) + 1
    first = [line for line in lines[head:] if line.startswith(lines[head].split(",")[0] + ",")]
    few = first[:: len(first) // 6][:6]  # from all over the target
    Path("few.csv").write_text("\n".join([*lines[:head], *few]) + "\n")
    answer = calib("solve", "few.csv", "-o", "out")
    assert (answer.code, answer.err) == (1, "")
    assert "no camera is determined: " in answer.out
    assert "6 observations in 1 view: too few for" in answer.out
    summary = summary_of(calib("solve", "few.csv", "-o", "out", "--json"))
    assert (summary["exit_code"], summary["error"], summary["answer"]["verdict"]) == (1, None, None)


def test_other_targets_stay() -> None:
    """A file of another kind, and a designed target, are not written over; one made of points is."""
    Path("ico.target.json").write_text(target_to_json(solid()))
    Path("notes.target.json").write_text("notes")
    for name in ("ico", "notes"):
        before = Path(f"{name}.target.json").read_bytes()
        refused(calib("target", "--from", "points.csv", "-o", f"{name}.target.json"), "choose another")
        assert Path(f"{name}.target.json").read_bytes() == before
    assert calib("target", "--from", "points.csv", "-o", "cube.target.json").code == 0


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ("image,u,v,id\na.png,1,1,7\n", "no point with this id"),
        ("image,u,v,X,Y,Z\na.png,1,1,0,0,0\n", "no point of the"),
    ],
)
def test_points_of_another_target_are_refused(table: str, message: str) -> None:
    """The line is named."""
    Path("other.csv").write_text("# image_size 2448 x 2048\n" + table)
    with pytest.raises(InputError, match=f"line 3: .*{message}"):
        read_observations(Path("other.csv"), Path("cube.target.json"))
