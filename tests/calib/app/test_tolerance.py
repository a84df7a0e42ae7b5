"""`design tolerance`, run as a user runs it."""

import csv
import json
import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest

from calib.app.tolerance import tolerance as tolerance_from_python
from calib.studies.tolerance.quantities import MAIN
from designer.target import target_to_json
from tests.support.command_line import Answer, files_in, instead
from tests.support.command_line import design as program
from tests.support.perturbed_targets import board, ico
from tests.support.study_commands import nothing_drawn

PAGE = {"index.html", "page.json"}
TABLES = {"table.csv", "tolerance.json", "table.md"}
TAKEN = ("--errors", "fdm-dual", "--views", "10", "--distance", "260mm")
DRAWN = (*TAKEN, "--draws", "3", "--jobs", "1")
NONE = tuple(f"{name}=0" for name in ("scale", "axis_scale", "skew", "face_offset", "face_shift", "face_rotation",
                                      "stair_steps", "thermal", "face_bow"))  # fmt: skip
"""Errors that are left out, so that there are fewer to simulate."""


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder to work in, with two targets; pictures are named, not drawn, and the page's law is a coarse one."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("calib.studies.tolerance.sizes.DRAWS", 1)
    monkeypatch.setattr("calib.draw.style.sheet_files", nothing_drawn)
    Path("ico.target.json").write_text(target_to_json(ico()))
    Path("board.target.json").write_text(target_to_json(board()))
    return tmp_path


def design(*arguments: str) -> Answer:
    """Run the command."""
    return program("tolerance", *arguments)


def done(*arguments: str, code: int = 0) -> str:
    """Run it; it must go well, with a limit missed (1) or not (0)."""
    answer = design(*arguments)
    assert (answer.code, answer.err) == (code, ""), answer
    return answer.out


def costs(path: str = "out/table.csv") -> dict[tuple[str, str], float]:
    """Costs of a table by error and quantity."""
    with Path(path).open() as stream:
        return {(line["error"], line["quantity"]): float(line["cost"]) for line in csv.DictReader(stream)}


def test_a_prediction_answers_all_three_questions(folder: Path) -> None:
    """`--linear` writes tables and figures and no study: costs, budgets and the crossover, and says what it is."""
    said = done(
        "ico.target.json", *TAKEN, "--set", "warp=0.3mm", "--linear", "--require", "intersection=0.05mm", "--against",
        "board.target.json", "--against-errors", "fdm-board", "--vary", "face_tilt", "-o", "out", code=1,
    )  # fmt: skip
    assert files_in(folder / "out") == TABLES | PAGE | {
        f"figures/{name}.png" for name in ("ranking", "budget", "crossover")
    }
    assert "ink_bleed, warp: No measured point moves against the others" in said
    assert said.startswith("limit missed: Intersection error against the drawing of ico is ")
    for title in (
        "For intersection error against the drawing up to 0.05 mm",
        "Both as they are assumed to be made",
        "Worse than board from",
    ):
        assert title in Path("out/table.md").read_text()
    document = json.loads(Path("out/tolerance.json").read_text())
    assert (document["kind"], document["draws"]) == ("linear", 0)
    assert document["crossovers"]["target"] == "board"
    assert str(folder) not in Path("out/table.md").read_text()
    done("ico.target.json", *TAKEN, "--set", "face_tilt=0.2deg", "--linear", "-o", "twice")
    twice, once = costs("twice/table.csv"), costs()
    for quantity in MAIN:
        assert twice["face_tilt", quantity] == pytest.approx(2 * once["face_tilt", quantity], rel=1e-6)
        assert twice["skew", quantity] == pytest.approx(once["skew", quantity], rel=1e-6)


def test_python_keeps_no_draws_unless_told_where(folder: Path) -> None:
    """`calib.tolerance` takes a value, and writes nothing until it is saved."""
    before = files_in(folder)
    drawn = tolerance_from_python(
        ico(), "fdm-dual", views=10, distance_mm=260.0, draws=2, jobs=1, require=["pose=10mm"], changes=NONE
    )
    assert (drawn.drawn.new, drawn.drawn.before, drawn.is_kept) == (2, 0, True)
    assert files_in(folder) == before


def test_a_study_is_kept_and_gone_on_with(folder: Path) -> None:
    """Draws are kept; the same study again computes none of them and writes the same table; another is refused.

    Figures that were asked for in other formats are drawn again in these, too: the page would show the old ones.
    """
    few = [word for one in NONE for word in ("--set", one)]
    said = done("ico.target.json", *DRAWN, *few, "--figures", "svg", "-o", "out")
    assert "3 draws in " in said
    assert "scale, axis_scale, skew, " in said
    names = {"ranking", "sweep_intersection"}
    assert files_in(folder / "out") == TABLES | PAGE | {"study.sqlite"} | {
        f"figures/{name}.{suffix}" for name in names for suffix in ("png", "svg")
    } | {f"sweeps/{factor}x.sqlite" for factor in ("0.25", "0.5", "2", "4")}
    first = Path("out/table.csv").read_bytes()
    again = design("ico.target.json", *DRAWN, *few, "-o", "out")
    assert again.code == 2
    assert "there is a study already; go on with it with --resume" in again.err
    other = design("ico.target.json", *DRAWN, *few, "--set", "face_tilt=0.2deg", "--resume", "-o", "out")
    assert other.code == 2
    assert "is a study with errors" in other.err
    predicted = design("ico.target.json", *TAKEN, "--linear", "-o", "out")
    assert predicted.code == 2
    assert "the folder holds a study with draws" in predicted.err
    assert Path("out/table.csv").read_bytes() == first
    os.utime("out/figures/ranking.svg", (0, 0))
    said = done("ico.target.json", *DRAWN, *few, "--resume", "--require", "reprojection=0.1px", "-o", "out", code=1)
    assert "draws in" not in said
    assert Path("out/table.csv").read_bytes() == first
    assert Path("out/figures/sweep_reprojection.png").exists()
    assert Path("out/figures/ranking.svg").stat().st_mtime > 0


def test_a_target_that_does_not_fit_is_told(folder: Path) -> None:
    """Views that cut the target, and rings too small, are told with the distance that would do."""
    near = done("ico.target.json", *TAKEN[:4], "--distance", "140mm", "--linear", "-o", "near")
    assert "ico: at 140mm the target reaches beyond the image" in near
    assert "it fits from --distance " in near
    far = design("ico.target.json", *TAKEN[:4], "--distance", "5m", "--linear", "-o", "far")
    assert far.code == 2
    assert "its rings are large enough up to --distance" in far.err
    assert not Path("far").exists()


def test_a_measured_target_is_told(folder: Path) -> None:
    """A measured target is taken as the drawing, and that is said."""
    Path("measured.target.json").write_text(target_to_json(replace(ico(), source="measured")))
    said = done("measured.target.json", *TAKEN, "--linear", "-o", "out")
    assert "target file is a measured one; its shape is taken as the drawing" in said


@pytest.mark.parametrize(
    ("options", "parts"),
    [
        (["--require", "intersection=1px"], ["'intersection=1px'", "unknown unit of length"]),
        (["--distance", "30mm"], ["--distance 30mm", "the target reaches", "farther"]),
        (["--model", "virtual"], ["--model 'virtual'", "use luhmann, opencv, pinhole"]),
        (["-o", "board.target.json"], ["board.target.json: is a file", "choose another"]),
        (["--against", "board.target.json"], ["--against board.target.json", "--against-errors"]),
        (["--against-errors", "fdm-board"], ["--against-errors fdm-board", "--against"]),
        (["--vary", "face_tilt"], ["--vary face_tilt", "--against"]),
        (["--linear", "--resume"], ["--resume", "--linear"]),
        (
            ["--against", "board.target.json", "--against-errors", "fdm-board", "--vary", "warp"],
            ["--vary warp", "--set"],
        ),
    ],
)
def test_bad_input_ends_in_one_line(options: Sequence[str], parts: Sequence[str], folder: Path) -> None:
    """What breaks a rule ends in one line with value, rule and remedy, exit code 2, and nothing written."""
    before = files_in(folder)
    answer = design(*instead(("ico.target.json", *DRAWN, "-o", "out"), options))
    assert answer.code == 2, answer
    assert answer.err.startswith("error: ")
    assert answer.err.count("\n") == 1
    for part in parts:
        assert part in answer.err
    assert files_in(folder) == before
