"""Files that carry the program's former name."""

import hashlib
import json
import re
from pathlib import Path

import numpy as np
import pytest

from calib.cameras.camera_file import load_camera
from calib.observe.dataset import FIRST_LINE, KIND, check_output, read_detections
from calib.observe.records import RECORDS
from calib.records.calibration_file import read_calibration
from calib.show.parts.origin import ORIGIN, ORIGIN_FILE, Origin, read_origin
from designer.base.errors import InputError
from designer.base.names import NAME, as_written_today
from designer.base.own_files import require_ours
from designer.target import load_target
from tests.support.command_line import calib

FORMER = "ringforge"
SOLVE = ("solve", "detections.csv", "--target", "board.target.json", "--model", "opencv", "-o", "run")


def renamed(folder: Path) -> list[Path]:
    """Every text file of a folder as the former name wrote it."""
    changed = []
    for path in folder.rglob("*"):
        if path.is_file() and NAME.encode() in (content := path.read_bytes()):
            path.write_bytes(content.replace(NAME.encode(), FORMER.encode()))
            changed.append(path)
    table, document = folder / "run/observations.csv", folder / "run/calibration.json"
    digest = hashlib.sha256(table.read_bytes()).hexdigest()
    document.write_text(re.sub(r'("observations_sha256": )"\w+"', rf'\1"{digest}"', document.read_text()))
    return changed


def test_a_folder_of_the_former_name_is_read_and_replaced(scene_copy: Path) -> None:
    """Targets, detections, cameras, calibrations and runs mean what they did, and may be replaced."""
    assert calib(*SOLVE).code in (0, 1)
    target, camera = load_target(Path("board.target.json")), load_camera(Path("run/camera.json"))
    suffixes = {path.suffix for path in renamed(scene_copy)}
    assert {".json", ".csv", ".html"} <= suffixes
    assert load_target(Path("board.target.json")) == target
    np.testing.assert_array_equal(load_camera(Path("run/camera.json")).params, camera.params)
    assert len(read_detections(Path("detections.csv"), target, target_path=Path("board.target.json"))[0].ring)
    assert read_calibration(Path("run/calibration.json"))[0].camera.model == camera.model
    check_output(Path("detections.csv"))
    assert calib("report", "run").code in (0, 1)
    assert calib("evaluate", "run/calibration.json").code == 0
    assert calib(*SOLVE).code in (0, 1)


def test_only_marks_change() -> None:
    """What a person wrote stays: names of files, notes, and a table's later lines."""
    text = '{"format": "ringforge.camera", "note": "ringforge.camera"}'
    assert json.loads(as_written_today(text)) == {"format": "ringsolid.camera", "note": "ringforge.camera"}
    assert as_written_today('format = "ringforge.camera"\n').startswith(f'format = "{NAME}.')
    assert as_written_today("# a\n# ringforge detections") == "# a\n# ringforge detections"


@pytest.mark.parametrize(
    ("kind", "start"), [(KIND, FIRST_LINE), (RECORDS.format, f'{{\n "format": "{RECORDS.format}"')]
)
def test_former_files_may_be_replaced(tmp_path: Path, kind: str, start: str) -> None:
    """An older file of the same kind is ours."""
    path = tmp_path / "file"
    path.write_text(start.replace(NAME, FORMER) + "\n")
    require_ours(path, kind=kind)
    with pytest.raises(InputError, match="a file of ringsolid's of another kind"):
        require_ours(path, kind=f"{NAME}.camera")


def test_a_former_origin_is_read(tmp_path: Path) -> None:
    """The page of an older folder can be built again."""
    made = Origin("calibration", "calib run", f"{FORMER} 0.1.0")
    (tmp_path / ORIGIN_FILE).write_bytes(ORIGIN.text(made).replace(b"ringsolid.report", b"ringforge.report"))
    assert read_origin(tmp_path) == made


def test_marks_are_turned_where_files_are_read() -> None:
    """In one reader, and in two that look at the beginning of a large file: nobody after them does it again."""
    root = Path(__file__).parents[2]
    files = [path for package in ("calib", "designer") for path in (root / package).rglob("*.py")]
    users = {path.relative_to(root).as_posix() for path in files if "import as_written_today" in path.read_text()}
    assert users == {
        "designer/base/small_file.py", "calib/observe/correspondences.py", "calib/records/observation_table.py"
    }  # fmt: skip
