"""What `--json` answers: the numbers that are in the files, in one document, whatever is printed."""

import json
import math
import shlex
import shutil
import subprocess
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calib.observe.calibration_file import read_calibration
from designer.base.answer import StoppedError, Summary, Value, command_line, document
from designer.base.codec import encode_by_value
from tests.support import programs
from tests.support.command_line import LENIENT, calib, design, rows_of_csv, summary_of
from tests.support.command_scene import BOARD, CAMERA, FOUND, PHOTOS, SEEN, SHIFT_PX
from tests.support.programs import PYTHON

TOY = """
import os, subprocess, sys
from pathlib import Path
import typer
from rich.console import Console
from designer.base.answer import StoppedError, Summary, command_line
from designer.base.command import command, run
from designer.base.errors import InputError

app = typer.Typer(name="toy")

@command(app)
def noisy(words: list[str]) -> Summary:
    print("from print")
    typer.echo("from typer")
    Console().print("from rich")
    os.write(1, b"from a library\\n")
    subprocess.run([sys.executable, "-c", "print('from a child')"], check=True)
    answer = {"line": command_line(), "not_a_number": float("nan")}
    return Summary(answer, (Path(words[0]),), ("next one",), ("odd",), 1)

@command(app)
def stops() -> Summary:
    raise StoppedError("stopped; half is there", Summary({"done": 1}, (Path("half"),)))

@command(app)
def refuses() -> Summary:
    raise InputError("two\\nlines")

run(app)
"""


@pytest.fixture(autouse=True)
def folder(scene_copy: Path) -> Path:
    """Where the commands work."""
    return scene_copy


def toy(*words: str) -> subprocess.CompletedProcess[str]:
    """Run a small program of three commands."""
    return programs.run(PYTHON, "-c", TOY, *words, check=False)


def test_whatever_is_printed_goes_to_people() -> None:
    """What print, rich, compiled libraries and child processes write stands on standard error, the document alone."""
    answer = toy("noisy", "a b", "--json")
    summary = json.loads(answer.stdout)
    assert answer.stdout.count("\n") == 1
    for origin in ("print", "typer", "rich", "a library", "a child"):
        assert f"from {origin}\n" in answer.stderr
    assert (answer.returncode, summary["exit_code"]) == (1, 1)
    assert (summary["wrote"], summary["next"], summary["remarks"]) == (["a b"], ["next one"], ["odd"])
    assert summary["answer"]["not_a_number"] is None
    assert (summary["command"], summary["error"]) == ("toy noisy", None)


def test_without_the_option_nothing_changes() -> None:
    """The same command prints to standard output, and no document."""
    answer = toy("noisy", "a b")
    assert (answer.returncode, answer.stderr) == (1, "")
    assert answer.stdout.count("from ") == 5
    assert "{" not in answer.stdout


def test_the_line_is_the_command_as_typed() -> None:
    """Quoted so that a shell reads the same words again; a command knows it, outside of one it is empty."""
    words = ("noisy", "a b", "it's", "--json", "$HOME")
    summary = json.loads(toy(*words).stdout)
    assert shlex.split(summary["line"]) == ["toy", *words]
    assert summary["answer"]["line"] == summary["line"]
    assert command_line() == ""


def test_stopped_and_refused_are_documents_too() -> None:
    """With the one line that people get, and with what is finished."""
    stopped = toy("stops", "--json")
    summary = json.loads(stopped.stdout)
    assert (stopped.returncode, stopped.stderr) == (130, "stopped; half is there\n")
    assert (summary["exit_code"], summary["error"]) == (130, "stopped; half is there")
    assert (summary["answer"], summary["wrote"]) == ({"done": 1}, ["half"])
    refused = toy("refuses", "--json")
    assert (refused.returncode, refused.stderr) == (2, "error: two lines\n")
    assert json.loads(refused.stdout)["error"] == "two lines"


@pytest.mark.parametrize(
    "words", [("--json",), ("nothing", "--json"), ("noisy", "--json", "--no-option"), ("stops", "x", "--json")]
)
def test_a_line_that_is_not_understood_is_answered_in_json(words: tuple[str, ...]) -> None:
    """Unknown commands, options and arguments: code 2 and a document."""
    answer = toy(*words)
    assert answer.returncode == json.loads(answer.stdout)["exit_code"] == 2


def test_json_after_two_dashes_is_an_argument() -> None:
    """As everywhere in a shell, what follows `--` is no option."""
    assert toy("noisy", "--", "--json").stdout.startswith("from print")


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
    lambda inner: st.lists(inner) | st.tuples(inner) | st.dictionaries(st.text(), inner),
    max_leaves=20,
)


@given(value=JSON)
def test_any_answer_is_strict_json(value: Value) -> None:
    """What comes back is what was given, with null for what is not finite; any text survives, in ASCII."""

    def expected(one: Value) -> Value:
        if isinstance(one, float):
            return one if math.isfinite(one) else None
        if isinstance(one, Mapping):
            return {name: expected(inner) for name, inner in one.items()}
        return [expected(inner) for inner in one] if isinstance(one, list | tuple) else one

    text = document(Summary({"value": value}), command="c", line="c", error=None)
    assert text.isascii()
    assert text.count("\n") == 1
    assert json.loads(text)["answer"]["value"] == expected(value) == encode_by_value(value)


def test_numpy_numbers_are_numbers() -> None:
    """A float64 is a float to JSON too, and one that is not finite is null."""
    assert encode_by_value([np.float64(0.5), np.float64("nan")]) == [0.5, None]


def _keys(value: object) -> Iterator[tuple[str, object]]:
    """All keys of a document with their values, however deep.

    But for parameters, which have names of their own, and checks of a verdict, which name their unit.
    """
    if isinstance(value, dict) and "unit" not in value:
        for name, inner in value.items():
            yield name, inner
            if name != "parameters":
                yield from _keys(inner)
    elif isinstance(value, list):
        for inner in value:
            yield from _keys(inner)


def test_solve_answers_with_what_it_wrote() -> None:
    """Parameters with their standard deviations and residuals are those of the files, near the truth."""
    words = (
        "solve",
        "detections.csv",
        "--target",
        "board.target.json",
        "--model",
        "opencv",
        "-o",
        "out",
        *LENIENT,
        "--json",
    )
    summary = summary_of(calib(*words))
    (found,) = summary["answer"]["models"]
    assert (summary["answer"]["best"], found["status"], found["failure"]) == ("opencv", "converged", None)
    stored, _ = read_calibration(Path("out/calibration.json"))
    assert (found["sigma_of_stated"], found["sigma_px"]) == (stored.scale, None)
    assert [one["value"] for one in found["parameters"].values()] == stored.camera.params.tolist()
    sigmas = np.sqrt(np.diag(stored.stated_covariance))
    np.testing.assert_allclose([one["sigma"] for one in found["parameters"].values()], sigmas)
    off = np.array([one["value"] for one in found["parameters"].values()]) - CAMERA.params
    assert (np.abs(off) < 5 * sigmas).all()
    assert Path(found["camera_file"]).samefile("out/camera.json")
    assert (found["views"], found["observations"]) == (len(PHOTOS), len(SEEN.view))
    assert found["rms_px"] == found["metrics"]["reprojection"]["rmse"] == pytest.approx(0.05 * math.sqrt(2), rel=0.1)


def test_detect_counts_what_is_in_the_table() -> None:
    """Photo by photo, with a word on those that show nothing and those that cannot be read."""
    Path("photos/broken.png").write_text("no image")
    shutil.copy("blank/none.png", "photos/none.png")
    answer = summary_of(calib("detect", "board.target.json", "photos", "-o", "out.csv", "--json"))["answer"]
    rows = rows_of_csv(Path("out.csv"))
    assert answer["found"] == len(rows) == sum(len(one.ring) for one in FOUND.values())
    photos = {one["image"]: one for one in answer["per_photo"]}
    assert {name for name in photos if photos[name].get("found")} == {row["image"] for row in rows} == set(PHOTOS)
    assert photos["none.png"]["remarks"][0] == "nothing here"
    assert "broken.png" in photos["broken.png"]["failure"]
    assert answer["failures"] == [photos["broken.png"]["failure"]]
    assert (answer["photos"], answer["searched"], answer["with_target"]) == (10, 9, 8)


def test_run_answers_with_detections_and_models() -> None:
    """What detect and solve answer, of one command; files of both are told."""
    summary = summary_of(
        calib("run", "board.target.json", "photos", "--model", "opencv", "-o", "out", *LENIENT, "--json")
    )
    assert summary["answer"]["detections"]["with_target"] == len(PHOTOS)
    assert [one["model"] for one in summary["answer"]["models"]] == ["opencv"]
    written = {str(path) for path in Path("out").rglob("*") if path.is_file()}
    assert set(summary["wrote"]) == written


def test_pose_answers_with_poses_and_reasons() -> None:
    """Where the camera stood, as in the file of poses, and why a photo has no pose."""
    words = ("pose", "board.target.json", "camera.json", "photos", "blank", "-o", "poses.json", "--json")
    answer = summary_of(calib(*words))["answer"]
    stored = json.loads(Path("poses.json").read_text())
    assert [one["camera_mm"] for one in answer["poses"]] == [one["camera_mm"] for one in stored["views"]]
    assert [one["distance_sigma_mm"] for one in answer["poses"]] == [
        one["distance_sigma_mm"] for one in stored["views"]
    ]
    assert answer["without_pose"] == [{"image": "none.png", "reason": "nothing here"}]


def test_diff_answers_in_px() -> None:
    """Cameras whose principal points lie apart differ by as much everywhere, if no rotation is removed."""
    answer = summary_of(calib("diff", "camera.json", "other.json", "--radius", "0", "--json"))["answer"]
    for name in ("rms_px", "median_px", "percentile_95_px", "max_px"):
        assert answer[name] == pytest.approx(SHIFT_PX, abs=0.01)
    assert answer["rotation_removed_rad"] == 0
    assert set(answer["zones"]) == {"centre", "between", "corners"}


def test_convert_tells_the_residual() -> None:
    """Nothing is lost where the file holds the model; a pinhole leaves the distortion over, and diff is next."""
    exact = summary_of(calib("convert", "camera.json", "--to", "opencv", "-o", "a.yml", "--json"))["answer"]
    assert (exact["is_exact"], exact["max_px"], exact["lost"]) == (True, 0.0, [])
    words = ("convert", "camera.json", "--to", "json", "--model", "pinhole", "-o", "b.json", "--json")
    summary = summary_of(calib(*words))
    assert not summary["answer"]["is_exact"]
    assert summary["answer"]["max_px"] > summary["answer"]["rms_px"] > 0.05
    assert summary["next"] == ["calib diff camera.json b.json"]


def test_design_answers_with_ids_sizes_and_findings() -> None:
    """The id and size are those of the target file; findings have a rule and a level."""
    summary = summary_of(design("board", "--columns", "6", "--rows", "5", "--pitch", "9mm", "-o", "out", "--json"))
    answer = summary["answer"]
    stored = json.loads(Path("out", f"{answer['name']}.target.json").read_text())
    assert answer["target_id"] == stored["geometry_id"]
    assert answer["rings"] == 30
    assert answer["spec"]["pitch_mm"] == 9
    assert {one["name"] for one in answer["files"]} == {Path(path).name for path in summary["wrote"]}
    assert {"rule", "level", "text"} <= set(answer["findings"][0]) if answer["findings"] else answer["rules_that_hold"]
    target = f"out/{answer['name']}.target.json"
    assert any(target in step for step in summary["next"])
    check = summary_of(design("check", target, "--json"))["answer"]
    assert (check["target_id"], check["is_violated"]) == (answer["target_id"], False)


def test_measure_tells_the_size() -> None:
    """A ring distance of 72.1 mm where 72 mm is designed is a print that is 0.14 % too large."""
    words = ("measure", "board.target.json", "--measured-length", "ring 0 to ring 6:72.1mm", "-o", "m.target.json")
    answer = summary_of(calib(*words, "--json"))["answer"]
    assert answer["size"]["value"] == pytest.approx(0.1 / 72)
    assert answer["nominal_geometry_id"] == BOARD.geometry_id != answer["measured_geometry_id"]


def test_numbers_of_lengths_and_angles_carry_their_unit() -> None:
    """A number that is not counted has its unit in its key."""
    units = ("_px", "_mm", "_rad", "_deg", "_stated", "_percent")
    to_solve = ("detections.csv", "--target", "board.target.json", "--model", "opencv", "-o", "out", *LENIENT)
    for words in (("solve", *to_solve),
                  ("pose", "board.target.json", "camera.json", "photos"),
                  ("diff", "camera.json", "other.json"),
                  ("detect", "board.target.json", "photos", "-o", "o.csv")):  # fmt: skip
        answer = summary_of(calib(*words, "--json"))["answer"]
        for name, value in _keys(answer):
            if isinstance(value, float) and name not in ("seconds",):
                assert name.endswith(units), (words[0], name)


def test_a_stopped_error_without_summary_has_an_empty_one() -> None:
    """Whoever stops need not know what is finished."""
    assert StoppedError("stopped; nothing was written").summary == Summary()
