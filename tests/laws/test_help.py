"""What the two programs say of themselves."""

import importlib
import inspect
import re
import sys
from importlib.metadata import version
from pathlib import Path

import pytest

from calib.cli import LINES, place_of
from designer.page.capability import prose
from tests.support.command_line import calib, design

PROGRAMS = {"calib": calib, "design": design}


@pytest.mark.parametrize("name", PROGRAMS)
def test_name_and_version(name: str) -> None:
    """`--version` says which program and which version, and nothing else."""
    answer = PROGRAMS[name]("--version")
    assert (answer.code, answer.out, answer.err) == (0, f"ringsolid {version('ringsolid')}\n", "")


@pytest.mark.parametrize("name", PROGRAMS)
def test_help_has_a_short_form_everywhere(name: str) -> None:
    """`-h` is `--help`, of the program and of each command."""
    commands = re.findall(r"^  ([a-z-]+)  ", PROGRAMS[name]("-h").out, re.MULTILINE)
    assert len(commands) >= 6
    for words in ([], *([one] for one in commands)):
        assert PROGRAMS[name](*words, "-h") == PROGRAMS[name](*words, "--help")


def test_commands_stand_under_what_they_are_for() -> None:
    """Each command once, under a task: nobody reads thirteen in a row."""
    said = calib("--help").out
    parts = re.split(r"^([A-Z][a-z]+(?: [a-z]+)*):$", said[said.index("Calibrate:") :], flags=re.MULTILINE)[1:]
    rows = zip(parts[::2], parts[1::2], strict=True)
    listed = {title: re.findall(r"^  ([a-z-]+)  ", text, re.MULTILINE) for title, text in rows}
    assert listed["Calibrate"] == ["run", "live", "plan", "rig", "hand-eye", "turntable", "detect", "solve", "measure"]
    names = [name for each in listed.values() for name in each]
    assert len(set(names)) == len(names)
    modules = {path.stem for path in (Path(__file__).parents[2] / "calib").glob("*/*.py")}
    assert {name.replace("-", "_") for name in names} - {"study"} <= modules


@pytest.mark.parametrize("name", LINES)
def test_the_list_says_of_a_command_what_its_docstring_does(name: str) -> None:
    """The list is made without loading the command, from a line that stands in it too."""
    module, _, word = place_of(name).partition(":")
    function = getattr(importlib.import_module(module), word)
    assert prose(function).splitlines()[0] == LINES[name]


@pytest.mark.parametrize("name", LINES)
def test_python_is_told_each_argument(name: str) -> None:
    """Of what a docstring leaves out it is told what a shell is: an option is described once."""
    module, _, word = place_of(name).partition(":")
    function = getattr(importlib.import_module(module), word)
    told = inspect.getdoc(function) or ""
    assert {one for one in inspect.signature(function).parameters if f"    {one}: " not in told} == set()


def test_step_without_the_cad_kernel_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Everything else works without it."""
    monkeypatch.setitem(sys.modules, "build123d", None)
    monkeypatch.delitem(sys.modules, "designer.make.cad", raising=False)
    answer = design("ico", "--edge", "20mm", "--formats", "stl,step", "-o", tmp_path / "x")
    assert (answer.code, answer.err.count("\n")) == (2, 1)
    assert "pip install 'ringsolid[cad]'" in answer.err
    assert not (tmp_path / "x").exists()
    assert design("ico", "--edge", "20mm", "--formats", "stl", "-o", tmp_path / "x").code == 0
