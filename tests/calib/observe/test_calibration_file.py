"""Calibrations on disk: read back bit for bit, and refused with one line that names the place."""

import json
import math
import re
import warnings
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from calib.cameras.camera import Camera, LearnedMap, load_camera
from calib.core.types import KnownPoints
from calib.observe.calibration_file import Provenance, read_calibration, write_calibration
from calib.solver.calibration import Calibration, ImageField, MadeWith, TargetError
from calib.solver.problem import SolveOptions
from designer.base.errors import InputError
from tests.support.calibrations import board, example
from tests.support.file_examples import same

BOARD = board(5, 4)
PROVENANCE = Provenance(
    "ringsolid 0.1.0", "layout", "geometry", 7,
    SolveOptions(weighted=True, loss="huber", reject_sigma=4.0, fixed=(("k3", None), ("p1", 0.25)),
                 shared=(("fx_px", "fy_px"),), focal_px=1234.5),
    (("detections", "a b.csv"), ("model", "opencv")),
)  # fmt: skip


def calibration(*, names: tuple[str, ...] = (), covariance: bool = True, seed: int = 1) -> Calibration:
    """A calibration with everything in it: outliers, a residual that is nan, a point that no view shows."""
    rng = np.random.default_rng(seed)
    one = example(BOARD, rng, views=max(len(names), 2), noise_px=0.3)
    seen = one.observations
    root = rng.normal(0, 0.05, (len(seen.view), 2, 2))
    cov = root @ root.transpose(0, 2, 1) + 1e-6 * np.eye(2)
    cov[:, 1, 0] = cov[:, 0, 1]
    points = KnownPoints(
        np.concatenate([seen.points.position_mm, [[1 / 3, -2e-17, 1e3]]]), np.append(seen.points.face, -1),
        seen.points.plane, "abc",
    )  # fmt: skip
    residual, flag = one.residual_px.copy(), rng.random(len(seen.view)) < 0.1
    residual[3] = np.nan
    return replace(
        one,
        observations=replace(
            seen, view_names=names or seen.view_names, cov_px2=cov if covariance else None, points=points
        ),
        residual_px=residual, is_outlier=flag, scale=0.1 + 0.2, remarks=("one", "zwei \u00fc"), fixed=("k3",),
        weighted=covariance, status="stopped", seconds=0.1,
    )  # fmt: skip


def written(folder: Path, one: Calibration | None = None) -> Path:
    """A calibration on disk."""
    return write_calibration(folder, one or calibration(), PROVENANCE)[0][0]


def made(kind: str) -> Calibration:
    """A calibration, with or without covariances, of a target that may be off, with a learned map."""
    one = calibration(covariance=kind != "plain")
    if kind == "of a print":
        errors = MadeWith((("warp", "uniform", 0.1 / 3), ("thermal", "fixed", -5.0)), 7e-5, 0.2)
        target_error = TargetError("mine", "its file says so", 0.1 * np.eye(9), errors)
        return replace(one, target_error=target_error, image_field=ImageField(0.02, 0.3 * np.eye(9)))
    if kind == "learned":
        rng = np.random.default_rng(4)
        learned = LearnedMap(
            rng.uniform(0, 1000, (7, 2)), rng.normal(size=(7, 2)), rng.uniform(1e-4, 1e-3, 7), np.eye(3), 321.5, 0.25
        )
        lens = Camera("virtual", np.array([1300.5, 1301, 600, 450]), one.camera.image_size, learned)
        return replace(one, camera=lens, param_covariance=np.eye(4), fixed=())
    return one


@pytest.mark.parametrize("kind", ["plain", "weighted", "of a print", "learned"])
def test_what_is_written_is_read_back_bit_for_bit(kind: str, tmp_path: Path) -> None:
    """Every field of the calibration and of its provenance comes back."""
    one = made(kind)
    places, _ = write_calibration(tmp_path / "new", one, PROVENANCE)
    assert [path.name for path in places] == ["calibration.json", "observations.csv", "camera.json"]
    again, provenance = read_calibration(places[0])
    assert same(again, one)
    assert replace(provenance, observations_sha256="") == PROVENANCE
    assert len(provenance.observations_sha256) == 64
    assert same(load_camera(places[2]), one.camera)


@given(
    names=st.lists(st.text(st.characters(exclude_characters="\0/"), min_size=1), unique=True, min_size=2, max_size=4)
)
@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_views_may_have_any_file_names(names: list[str], tmp_path: Path) -> None:
    """Commas, quotes, line breaks, characters that are no text: names come back, and rows stay with their views."""
    one = calibration(names=tuple(names))
    assert same(read_calibration(written(tmp_path, one))[0], one)


def test_what_is_not_determined_is_not_known_afterwards(tmp_path: Path) -> None:
    """A degenerate solution has no covariances: they come back as nan, and the files stay valid JSON."""
    one = calibration()
    lost = replace(
        one, status="degenerate", scale=math.nan, param_covariance=np.full_like(one.param_covariance, np.nan),
        pose_covariance=np.full_like(one.pose_covariance, np.inf),
    )  # fmt: skip
    path = written(tmp_path, lost)
    json.loads(path.read_text(), parse_constant=lambda name: pytest.fail(f"{name} is no JSON"))
    again, _ = read_calibration(path)
    assert math.isnan(again.scale)
    assert np.isnan(again.param_covariance).all()
    assert np.isnan(again.pose_covariance).all()
    assert again.status == "degenerate"


def test_a_point_left_out_costs_no_calibration(tmp_path: Path) -> None:
    """A residual beyond all images is no pixel of a point that is left out; of one that counts it is refused."""
    one = calibration()
    residual, is_outlier = one.residual_px.copy(), one.is_outlier.copy()
    residual[5], is_outlier[5] = (3e6, 1.0), True
    again, _ = read_calibration(written(tmp_path / "out", replace(one, residual_px=residual, is_outlier=is_outlier)))
    assert np.isnan(again.residual_px[5]).all()
    assert np.array_equal(np.delete(again.residual_px, 5, 0), np.delete(residual, 5, 0), equal_nan=True)
    is_outlier[5] = False
    with pytest.raises(InputError, match="a residual is beyond 1e\\+06 px"):
        written(tmp_path / "counts", replace(one, residual_px=residual, is_outlier=is_outlier))
    assert not (tmp_path / "counts").exists()


def refused(path: Path) -> str:
    """The one line that refuses a file."""
    with pytest.raises(InputError) as caught:
        read_calibration(path)
    message = str(caught.value)
    assert "\n" not in message
    assert str(path.parent) in message
    return message


ROW = 7


def table_with(path: Path, column: str, value: str) -> Path:
    """The table beside a calibration with one cell changed, in line ROW."""
    table = path.parent / "observations.csv"
    lines = table.read_text().split("\n")
    cells = lines[ROW - 1].split(",")
    cells[lines[2].split(",").index(column)] = value
    lines[ROW - 1] = ",".join(cells)
    table.write_text("\n".join(lines))
    return table


@pytest.mark.parametrize(
    ("column", "value", "rule"),
    [
        ("image", "other.png", "no view of the calibration"),
        ("point", "21", "0 to 20"),
        ("face", "3", "face or X, Y, Z are not those"),
        ("Z", "nan", "face or X, Y, Z are not those"),
        ("u", "1e30", "u and v must be within"),
        ("v", "-inf", "u and v must be within"),
        ("v", "12,3", "values; a line has"),
        ("v", "1_2", "'1_2' must be a number"),
        ("v", "\u0663", "must be a number"),
        ("du", "inf", "du and dv must be finite"),
        ("outlier", "2", "outlier must be 0 or 1"),
        ("suu", "-1", "positive definite"),
        ("suv", "1e6", "positive definite"),
        ("svv", "9" * 5000, "positive definite"),
    ],
)
def test_a_bad_cell_is_refused_by_its_line(column: str, value: str, rule: str, tmp_path: Path) -> None:
    """A table that breaks a rule is refused with the file, the number of the line, and the rule."""
    path = written(tmp_path)
    table = table_with(path, column, value)
    message = refused(path)
    assert f"{table}: line {ROW}: " in message
    assert rule in message


def test_lines_are_counted_past_names_with_line_breaks(tmp_path: Path) -> None:
    """The line named is that of an editor, also after names that hold line breaks."""
    path = written(tmp_path, calibration(names=("a\nb\n.png", "c.png")))
    table = path.parent / "observations.csv"
    lines = table.read_text().split("\n")
    lines[3 + 3 * 10 + 2] += ",1"  # the third line of the eleventh row
    table.write_text("\n".join(lines))
    assert f"line {3 + 3 * 10 + 3}: 15 values; a line has 14" in refused(path)


def test_views_must_come_in_order(tmp_path: Path) -> None:
    """Rows are sorted by view, so that the solver can read them view by view; the first that is not is named."""
    path = written(tmp_path)
    table = path.parent / "observations.csv"
    lines = table.read_text().split("\n")
    lines[3], lines[-2] = lines[-2], lines[3]
    table.write_text("\n".join(lines))
    assert "line 5: its image comes before" in refused(path)


@pytest.mark.parametrize(
    ("change", "rule"),
    [
        (lambda text: "\x00" * 100, "must begin with"),
        (lambda text: text.replace("version 1", "version 9", 1), "version 9; this program reads version 1"),
        (lambda text: text.replace("image,point", "point,image", 1), "line 3: the columns must be"),
        (lambda text: "\n".join(text.split("\n")[:3]) + "\n", "holds no line of observations"),
        (lambda text: text + '"open', "line "),
        (lambda text: "\n".join(text.split("\n")[:-5]) + "\n", "does not belong to"),
        (lambda text: text.replace("# X Y Z", "# Y X Z"), "does not belong to"),
    ],
)
def test_a_broken_table_is_refused(change: Callable[[str], str], rule: str, tmp_path: Path) -> None:
    """Not a table, another version, cut off, or of another calibration: one line."""
    path = written(tmp_path)
    table = path.parent / "observations.csv"
    table.write_text(change(table.read_text()))
    message = refused(path)
    assert rule in message
    assert str(table) in message


def test_a_table_must_be_there_and_text(tmp_path: Path) -> None:
    """A calibration.json alone, with a folder beside it, or with bytes that are no text, is refused."""
    path = written(tmp_path)
    table = path.parent / "observations.csv"
    table.write_bytes(table.read_bytes() + b"\xff\xfe,1")
    assert "not UTF-8" in refused(path)
    table.unlink()
    assert "no such file" in refused(path)
    table.mkdir()
    assert "no such file" in refused(path)


@pytest.mark.parametrize(
    ("old", "new", "rule"),
    [
        ('"fixed": ["k3"]', '"fixed": ["k9"]', "'k9', which is no parameter"),
        ('"model": "opencv"', '"model": "opencw"', "camera: unknown camera model"),
        ('"points": [\n  [', '"points": [\n  [0.0, 0.0, 0.0, 5], [', "points.0 is on plane 5; there are 1"),
        ('"image": "view_0001.png"', '"image": "view_0000.png"', "each be of another image"),
        ('"observations_sha256": "', '"observations_sha256": "0', "does not belong to"),
    ],
)
def test_a_changed_calibration_is_refused(old: str, new: str, rule: str, tmp_path: Path) -> None:
    """A key or value that breaks a rule is refused by its name, in one line."""
    path = written(tmp_path)
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    assert rule in refused(path)


@pytest.mark.parametrize(
    ("change", "rule"),
    [
        ({"scale": -1.0}, "scale -1.0: must be 0 or more"),
        ({"param_covariance": [[-1.0] * 9] * 9}, "a variance of -1; it must be 0 or more"),
        ({"param_covariance": [[1e300] * 9] * 9}, "param_covariance holds a number beyond 1e+100"),
        ({"planes": [[1e300, 0.0, 0.0, 0.0]] * 20}, "planes.0 has a normal of length 1e+300"),
    ],
)
def test_absurd_numbers_are_refused_without_a_warning(change: dict[str, object], rule: str, tmp_path: Path) -> None:
    """What overflows or has no root is refused where it is read."""
    path = tmp_path / "calibration.json"
    written(tmp_path)
    path.write_text(json.dumps(json.loads(path.read_text()) | change))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(InputError, match=re.escape(rule)):
            read_calibration(path)


def test_a_pose_that_is_no_motion_is_refused(tmp_path: Path) -> None:
    """A mirrored, stretched or far-off pose is named by its view, before anything is written that none could read."""
    one = calibration()
    for matrix, rule in (
        (np.diag([1.0, 1.0, -1.0, 1.0]), "has no rotation in it"),
        (np.eye(4) + 1e9 * np.outer(np.eye(4)[0], np.eye(4)[3]), "mm away"),
        (np.eye(4) + np.outer(np.eye(4)[3], np.eye(4)[0]), "the row 0 0 0 1"),
    ):
        poses = one.cam_from_target.copy()
        poses[1] = matrix
        with pytest.raises(InputError, match=f"views.1.cam_from_target .*{rule}"):
            written(tmp_path, replace(one, cam_from_target=poses))
        assert not list(tmp_path.iterdir())


@given(place=st.floats(0, 1), byte=st.integers(0, 255), cut=st.booleans())
@settings(max_examples=80, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_damage_never_crashes_and_never_passes_in_the_table(place: float, byte: int, cut: bool, tmp_path: Path) -> None:
    """A byte changed in the table is always noticed; a damaged calibration.json is refused or still a calibration."""
    for name in ("calibration.json", "observations.csv"):
        for earlier in tmp_path.iterdir():
            earlier.unlink()
        path = written(tmp_path)
        file = tmp_path / name
        content = file.read_bytes()
        at = int(place * (len(content) - 1))
        damaged = content[:at] + (b"" if cut else bytes([byte]) + content[at + 1 :])
        file.write_bytes(damaged)
        if name == "observations.csv" and damaged != content:
            refused(path)
        else:
            with suppress(InputError):
                read_calibration(path)


def test_two_views_of_one_name_are_not_written(tmp_path: Path) -> None:
    """They could not be told apart afterwards."""
    with pytest.raises(ValueError, match="same name"):
        written(tmp_path, calibration(names=("a.png", "a.png")))
