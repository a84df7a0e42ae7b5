"""The command `design`, run as a user runs it."""

import json
from pathlib import Path

import pytest

from designer.kinds.presets import preset_names
from tests.support.command_line import design

DEFAULT_FILES = {
    "t.target.json", "t.toml", "t.prusa.3mf", "t.bambu.3mf", "t.body.stl", "t.pattern.stl", "t.png", "index.html",
}  # fmt: skip


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where the commands work, on a wide screen."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")
    return tmp_path


def test_one_size_makes_all_default_files_in_the_exports_folder() -> None:
    """`design ico --edge 20mm` writes exports/ico-20mm/ with the default set, and says so."""
    answer = design("ico", "--edge", "20mm")
    assert answer.code == 0, answer
    files = {path.name.replace("ico-20mm", "t") for path in Path("exports/ico-20mm").iterdir()}
    assert files == DEFAULT_FILES
    for said in (
        "300 with 60 dots, 15 a face",
        "on the bed",
        "design rules warn",
        "auto: 5 rings a side",
        "next",
        "open exports/ico-20mm/ico-20mm.bambu.3mf in",
        "or exports/ico-20mm/ico-20mm.prusa.3mf in",
        "calib run exports/ico-20mm/ico-20mm.target.json photos -o camera",
    ):
        assert said in answer.out
    assert "replaces" not in answer.out


def test_replacing_another_target_is_said() -> None:
    """A design of the same name with another target says what it replaces; with the same target nothing."""
    board = ("board", "--columns", "5", "--rows", "4", "--pitch", "8mm", "-o", "out", "--name", "t", "--json")
    first = json.loads(design(*board).out)["answer"]["target_id"]
    again = design(*board, "--inlay-depth", "0.2mm")
    assert "replaces" not in again.out + again.err
    changed = design(*board, "--border", "0.6mm")
    summary = json.loads(changed.out)
    line = f"replaces target {first} by {summary['answer']['target_id']} in out: prints and photos of the earlier one"
    assert summary["answer"]["target_id"] != first
    assert len([remark for remark in summary["remarks"] if line in remark]) == 1
    assert line in changed.err


def test_help_says_what_to_type_first() -> None:
    """The line that `design` alone shows first is one that works."""
    shown = design().out
    line = shown.split("Begin with: ")[1].splitlines()[0]
    assert shown.index(line) < shown.index("Options")
    assert design(*line.split()[1:], "--chord-error", "0.1mm", "-o", "out").code == 0


def test_a_target_file_is_checked_for_the_printer_that_is_named() -> None:
    """0 where all rules hold, 1 where one is violated, for target files as for specs; templates are listed."""
    design(
        "board",
        "--columns",
        "24",
        "--rows",
        "4",
        "--pitch",
        "8mm",
        "--chord-error",
        "0.1mm",
        "-o",
        "out",
        "--name",
        "t",
    )
    for file in ("out/t.target.json", "out/t.toml"):
        for printer, code in (("prusa-xl", 0), ("bambu-a1-mini", 1)):
            answer = design("check", file, "--printer", printer)
            assert (answer.code, "not printable" in answer.out) == (code, bool(code)), answer
    assert all(name in design("templates").out for name in preset_names("targets"))


def test_a_target_file_is_checked_for_the_build_that_it_was_designed_for() -> None:
    """As its spec is; another build is asked for by its name."""
    sizes = ("--columns", "6", "--rows", "4", "--pitch", "8mm", "--chord-error", "0.1mm")
    design("board", *sizes, "--build", "relief", "-o", "out", "--name", "t")
    for file in ("out/t.target.json", "out/t.toml"):
        assert " relief on " in design("check", file).out
    assert " one-piece on " in design("check", "out/t.target.json", "--build", "one-piece").out
