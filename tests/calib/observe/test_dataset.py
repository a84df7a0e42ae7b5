"""Detections on disk: what is written is read back, and what breaks a rule is refused by its line."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from calib.core.types import TOO_FLAT, Detections, FaceRecord
from calib.observe.dataset import (
    COLUMNS,
    FIRST_LINE,
    RECORDS,
    ImageRecord,
    check_output,
    detections_to_csv,
    read_detections,
    records_path,
    write_detections,
)
from designer.base.answer import program
from designer.base.errors import InputError
from designer.kinds.layout import lay_out
from designer.kinds.sizing import size_job
from designer.target import TargetGeometry
from tests.support.designs import asked_for

ICO = lay_out(size_job(asked_for("ico", {"edge": "50mm"})).job.target)
BOARD = lay_out(size_job(asked_for("board", {"columns": 5, "rows": 4, "pitch": "10mm"})).job.target)
RECORD = FaceRecord(3, ("dot", "ring", "unreadable", "dot", "ring", "dot"), 4, 7, 9, (("outside the image", 2),), "")
TARGET_PATH = Path("ico.target.json")


def seen(
    image: str, count: int, rng: np.random.Generator, target: TargetGeometry = ICO, size: tuple[int, int] = (640, 480)
) -> Detections:
    """Detections of random features."""
    root = rng.normal(0, 0.05, (count, 2, 2))
    ring = np.sort(rng.choice(target.ring_count, count, replace=False))
    return Detections(
        image=image,
        image_size=size,
        layout_id=target.layout_id,
        geometry_id=target.geometry_id,
        ring=ring,
        position_mm=target.center_mm[ring],
        center_px=rng.uniform(-0.5, 640, (count, 2)),
        cov_px2=root @ root.transpose(0, 2, 1) + 1e-6 * np.eye(2),
        ellipse_px=np.ones((count, 5)),
        faces=(RECORD,),
        remarks=("page 1 of 2 read",),
        rejected_px=np.zeros((2, 2)),
    )


def written(path: Path, *images: Detections) -> tuple[Detections, ...]:
    """Write and read back."""
    write_detections(path, images, ICO)
    return read_detections(path, ICO, target_path=TARGET_PATH)


@given(
    names=st.lists(st.text(st.characters(exclude_characters="\0/"), min_size=1), unique=True, max_size=4),
    seed=st.integers(0, 10),
)
@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_what_is_written_is_read_back(names: list[str], seed: int, tmp_path: Path) -> None:
    """Any file names, counts and sizes come back: rings and views exactly, numbers to the digits promised."""
    rng = np.random.default_rng(seed)
    images = [seen(name, int(rng.integers(0, 30)), rng, size=(int(rng.integers(1, 9000)), 7)) for name in names]
    data = written(tmp_path / "d.csv", *images)
    assert [one.image for one in data] == names
    for read, one in zip(data, images, strict=True):
        assert read.image_size == one.image_size
        assert (read.layout_id, read.geometry_id) == (ICO.layout_id, ICO.geometry_id)
        assert np.array_equal(read.ring, one.ring)
        assert np.abs(read.center_px - one.center_px).max(initial=0) <= 0.5e-6 * (1 + 1e-6)
        assert np.allclose(read.cov_px2, one.cov_px2, rtol=0.5e-5, atol=0)


def test_edges_are_kept_where_all_are_known(tmp_path: Path) -> None:
    """Contours, ratios and blurs come back from files that have them, and are not known from files that have not."""
    rng = np.random.default_rng(6)
    plain = seen("a.png", 9, rng)
    ellipse = np.column_stack(
        [plain.center_px, rng.uniform(20, 30, 9), rng.uniform(6, 20, 9), rng.uniform(-1.5, 1.5, 9)]
    )
    known = replace(plain, ellipse_px=ellipse, ratio=rng.uniform(0, 0.9, 9), blur_px=rng.uniform(0.3, 2, 9))
    (back,) = written(tmp_path / "d.csv", known)
    assert np.abs(back.edges - known.edges).max() <= 0.5e-5 * (1 + 1e-6)
    both = written(tmp_path / "e.csv", known, replace(plain, image="b.png"))
    assert np.isnan(both[0].edges).all()


@pytest.mark.parametrize(("column", "value"), [("minor", "31"), ("ratio", "1"), ("blur", "-1"), ("angle", "9")])
def test_edges_that_no_ring_has_are_refused(column: str, value: str, tmp_path: Path) -> None:
    """The line is named."""
    one = seen("a.png", 1, np.random.default_rng(6))
    one = replace(one, ellipse_px=np.array([[1.0, 1, 30, 20, 0]]), ratio=np.array([0.4]), blur_px=np.array([1.0]))
    written(tmp_path / "d.csv", one)
    *above, names, row = (tmp_path / "d.csv").read_text().splitlines()
    cells = row.split(",")
    cells[names.split(",").index(column)] = value
    (tmp_path / "d.csv").write_text("\n".join([*above, names, ",".join(cells)]) + "\n")
    with pytest.raises(InputError, match=f"line {len(above) + 2}: .*{column}"):
        read_detections(tmp_path / "d.csv", ICO, target_path=TARGET_PATH)


def test_names_that_are_not_unicode_come_back(tmp_path: Path) -> None:
    """A file name of any bytes is kept, in the table and in the records."""
    name = b'caf\xe9,\n#".png'.decode("utf-8", "surrogateescape")
    data = written(tmp_path / "d.csv", seen(name, 3, np.random.default_rng(1)))
    assert [one.image for one in data] == [name]
    assert RECORDS.read(tmp_path / "d.records.json").images[0].image == name


def test_the_table_is_the_published_one(tmp_path: Path) -> None:
    """Columns, and the target's face, indices and X Y Z of each ring, as another program would read them."""
    one = seen("a.png", 5, np.random.default_rng(2))
    write_detections(tmp_path / "d.csv", [one], ICO)
    lines = (tmp_path / "d.csv").read_text().splitlines()
    assert lines[0] == FIRST_LINE
    assert '# image 640 x 480 px "a.png"' in lines
    body = [line for line in lines if not line.startswith("#")]
    assert body[0] == "image,face,ring,i,j,u,v,suu,suv,svv,X,Y,Z"
    table = np.array([line.split(",")[1:] for line in body[1:]], dtype=float)
    assert np.array_equal(table[:, 0], ICO.ring_face[one.ring])
    assert np.array_equal(table[:, 1], one.ring)
    assert np.array_equal(table[:, 2:4], ICO.ring_index[one.ring])
    assert np.allclose(table[:, 6:9], one.cov_px2.reshape(-1, 4)[:, [0, 1, 3]], rtol=1e-5)
    assert np.allclose(table[:, 9:], ICO.center_mm[one.ring], atol=1e-6)


def test_the_same_features_fit_a_measured_target(tmp_path: Path) -> None:
    """A target with the same layout and other numbers takes the detections; one of another layout names both files."""
    path = tmp_path / "d.csv"
    written(path, seen("a.png", 5, np.random.default_rng(3)))
    measured = replace(ICO, source="measured", center_mm=ICO.center_mm + 0.01)
    assert read_detections(path, measured, target_path=TARGET_PATH)[0].geometry_id == ICO.geometry_id
    with pytest.raises(InputError, match=rf"{path}.*board\.target\.json"):
        read_detections(path, BOARD, target_path=Path("board.target.json"))


def cell(column: str, value: str) -> Callable[[list[str]], list[str]]:
    """A change of one value in the last line."""

    def change(lines: list[str]) -> list[str]:
        cells = lines[-1].split(",")
        cells[COLUMNS.index(column)] = value
        return [*lines[:-1], ",".join(cells)]

    return change


def line(number: int, text: str) -> Callable[[list[str]], list[str]]:
    """Another text in a line, counted from 1."""
    return lambda lines: [*lines[: number - 1], text, *lines[number:]]


CHANGES = {
    "no comment": (lambda lines: lines[1:], "must begin with"),
    "version": (line(1, FIRST_LINE.replace("1", "2")), "version 2"),
    "no layout": (line(2, "#"), "layout_id"),
    "order": (line(7, ",".join(reversed(COLUMNS))), "the columns must be"),
    "size": (line(6, '# image 0 x 480 px "a.png"'), "line 6: size 0 x 480"),
    "huge": (line(6, '# image 9999999 x 480 px "a.png"'), "a side has"),
    "image line": (line(6, "# image 640 x 480 px a.png"), "line 6: expected"),
    "image again": (line(5, '# image 640 x 480 px "a.png"'), "line 6: the image 'a.png' a second time"),
    "unknown image": (cell("image", "b.png"), "line 11: its image has no"),
    "ring": (cell("ring", "700000"), "line 11: ring is out of range"),
    "negative ring": (cell("ring", "-1"), "line 11: ring is out of range"),
    "fraction": (cell("ring", "1.5"), "line 11: ring must be a whole number"),
    "face": (cell("face", "99"), "line 11: face is not that"),
    "index": (cell("i", "99"), "line 11: i is not that"),
    "far": (cell("u", "1e7"), "line 11: u or v is beyond"),
    "variance": (cell("suu", "-1e-4"), "line 11: suu, suv, svv must be a covariance"),
    "correlation": (cell("suv", "9"), "line 11: suu, suv, svv must be a covariance"),
    "twice": (lambda lines: [*lines, lines[8]], "line 12: the same ring"),
}


@pytest.mark.parametrize("name", CHANGES)
def test_a_line_that_breaks_a_rule_is_named(name: str, tmp_path: Path) -> None:
    """Each broken rule refuses the file, with the line where there is one."""
    change, rule = CHANGES[name]
    text = detections_to_csv([seen("a.png", 4, np.random.default_rng(4))], ICO)
    path = tmp_path / "d.csv"
    path.write_text("\n".join(change(text.splitlines())) + "\n")
    with pytest.raises(InputError) as refused:
        read_detections(path, ICO, target_path=TARGET_PATH)
    message = str(refused.value)
    assert message.startswith(str(path))
    assert rule in message
    assert "\n" not in message
    assert len(message) < 400


def test_lines_are_counted_across_names_with_line_breaks(tmp_path: Path) -> None:
    """The line named is the one an editor shows, also after a file name of two lines."""
    text = detections_to_csv([seen("a\nb.png", 4, np.random.default_rng(4))], ICO)
    path = tmp_path / "d.csv"
    path.write_text(text + text.splitlines()[-1].join(['"a\n', "\n"]))
    with pytest.raises(InputError, match="line 17: "):
        read_detections(path, ICO, target_path=TARGET_PATH)
    assert len(path.read_text().splitlines()) == 17


@pytest.mark.parametrize(
    "bad",
    [
        {"center_px": np.array([[1, 1], [np.nan, 2], [3, 3]])},
        {"cov_px2": np.array([np.eye(2), np.zeros((2, 2)), np.eye(2)])},
        {"cov_px2": np.array([np.eye(2), [[1, 0.9999999], [0.9999999, 1]], np.eye(2)])},
        {"ring": [1, 2, 2]},
    ],
    ids=["not finite", "zero", "singular once rounded", "named twice"],
)
def test_a_feature_that_could_not_be_read_back_is_left_out(bad: dict[str, object], tmp_path: Path) -> None:
    """It is left out with a remark; the others, and the other photos, are written and read."""
    rng = np.random.default_rng(5)
    path = tmp_path / "d.csv"
    found = written(path, replace(seen("a.png", 3, rng), **bad), seen("b.png", 4, rng))  # type: ignore[arg-type]
    kept = 1 if "ring" in bad else 2
    assert [len(one.ring) for one in found] == [kept, 4]
    record = RECORDS.read(records_path(path)).images[0]
    assert record.features == kept
    assert f"{3 - kept} left out" in record.remarks[-1]


def test_another_layout_is_not_written(tmp_path: Path) -> None:
    """Detections of another target are the program's error, and leave no file."""
    with pytest.raises(ValueError, match="layout"):
        write_detections(tmp_path / "d.csv", [replace(seen("a.png", 3, np.random.default_rng(5)), layout_id="x")], ICO)
    assert list(tmp_path.iterdir()) == []


def test_advice_on_motion_is_that_of_the_photos(tmp_path: Path) -> None:
    """What is said of photos that a motion blurred is the same of what was found and of the file that keeps it."""
    rng = np.random.default_rng(0)
    found = [replace(seen(f"{k}.png", 60, rng), motion_px=3.0 * (k == 2)) for k in range(4)]
    write_detections(tmp_path / "d.csv", found, ICO)
    back = read_detections(tmp_path / "d.csv", ICO, target_path=TARGET_PATH)
    assert [one.motion_px for one in back] == [0.0, 0.0, 3.0, 0.0]


def test_records_come_back(tmp_path: Path) -> None:
    """Faces, remarks, counts and failures of each photo are read back as written."""
    lost = ImageRecord("b.png", None, 0, 0, (), (), "is empty")
    path = tmp_path / "run" / "d.csv"
    write_detections(path, [seen("a.png", 6, np.random.default_rng(6))], ICO, failed=[lost])
    records = RECORDS.read(records_path(path))
    assert records.images == (ImageRecord("a.png", (640, 480), 6, 2, (RECORD,), ("page 1 of 2 read",)), lost)
    assert (records.detector, records.layout_id, records.geometry_id) == (program(), ICO.layout_id, ICO.geometry_id)


def test_what_is_seen_too_flat_is_not_expected() -> None:
    """Features that nobody could measure from there do not count as missing."""
    face = replace(RECORD, rings_found=30, rings_expected=36, missing=((TOO_FLAT, 4), ("off the grid", 2)))
    assert face.measurable == 32
    assert replace(face, missing=()).measurable == 36


def test_a_table_has_a_name_of_its_own(tmp_path: Path) -> None:
    """An earlier run's files may be replaced; a name that is no .csv, and a folder's, are refused."""
    written(tmp_path / "d.csv", seen("a.png", 3, np.random.default_rng(7)))
    check_output(tmp_path / "d.csv")
    (tmp_path / "e.csv").mkdir()
    for name, rule in (("photo.png", "photo.csv"), ("", "csv"), ("e.csv", "a folder has the name")):
        with pytest.raises(InputError, match=rule):
            check_output(tmp_path / name)


def test_a_place_that_takes_no_file_is_refused_before_the_work(tmp_path: Path) -> None:
    """A file where a folder should be is found out at once; a folder yet to be made is fine and not made."""
    (tmp_path / "file").write_text("x")
    with pytest.raises(InputError, match=r"cannot be written.* -o"):
        check_output(tmp_path / "file" / "deep" / "d.csv")
    check_output(tmp_path / "new" / "deep" / "d.csv")
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_ids_may_be_in_capitals(tmp_path: Path) -> None:
    """Hexadecimal digits mean the same in capitals: of the table, of the records beside it, and of the target."""
    path = tmp_path / "d.csv"
    write_detections(path, [seen("a.png", 9, np.random.default_rng(3))], ICO)
    for file in (path, records_path(path)):
        text = file.read_text()
        for identity in (ICO.layout_id, ICO.geometry_id):
            assert identity in text
            text = text.replace(identity, identity.upper())
        file.write_text(text)
    (back,) = read_detections(path, ICO, target_path=TARGET_PATH)
    assert (back.layout_id, back.geometry_id) == (ICO.layout_id, ICO.geometry_id)
    assert back.faces == (RECORD,)  # of the records
