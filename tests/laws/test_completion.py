"""Shell completion of `design` and `calib`, asked as the shells ask: by environment variables."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest

from calib.cameras.formats import FORMATS, ONLY_WRITTEN, RIG_FORMATS
from designer.kinds.presets import preset_names
from tests.support import programs
from tests.support.programs import PYTHON

MODULE = {"design": "designer.cli", "calib": "calib.cli"}


def run(program: str, *arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run a program in a process of its own."""
    return programs.run(PYTHON, "-m", MODULE[program], *arguments, check=False, **environment)


def offered(line: str, shell: str = "bash") -> list[str]:
    """What a shell is offered at the end of a line, less the words of the shell's own."""
    program = line.split(maxsplit=1)[0]
    variables = {f"_{program.upper()}_COMPLETE": f"complete_{shell}"}
    if shell == "bash":
        variables |= {"COMP_WORDS": line, "COMP_CWORD": str(len(line.split(" ")) - 1)}
    else:
        variables |= {"_TYPER_COMPLETE_ARGS": line, "_TYPER_COMPLETE_FISH_ACTION": "get-args"}
    answer = run(program, **variables)
    assert (answer.returncode, answer.stderr) == (0, ""), answer
    return answer.stdout.split("\n")[:-1]


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("design make m", ["master-ico", "matt-ico"]),
        ("design ico --printer ", preset_names("printers")),
        ("design board --lattice ", ["square", "triangular"]),
        ("design tolerance t.json --errors fdm", [name for name in preset_names("errors") if name.startswith("fdm")]),
        ("calib convert c.json --to ", [*dict.fromkeys([*FORMATS, *RIG_FORMATS]), *ONLY_WRITTEN]),
        ("calib solve d.csv --model l", ["luhmann", "luhmann_skew"]),
        ("calib render t.json --camera ", preset_names("cameras")),
        ("calib render t.json --rig ", preset_names("rigs")),
        ("calib study pl", ["plot"]),
        ("calib run --js", ["--json"]),
    ],
)
def test_commands_options_and_values_are_offered(line: str, words: list[str]) -> None:
    """Templates, models, formats and words of a choice, as they are at hand; in the order of the program's lists."""
    assert offered(line) == words


def test_where_nothing_is_known_the_shell_offers_files() -> None:
    """An argument that is a file is left to the shell: nothing is offered, which bash takes for files."""
    assert offered("calib detect ") == [""]
    assert offered("calib detect ", "zsh") == ["_files"]
    asks = {"_TYPER_COMPLETE_ARGS": "calib detect ", "_CALIB_COMPLETE": "complete_fish"}
    assert run("calib", **asks, _TYPER_COMPLETE_FISH_ACTION="is-args").returncode == 1


def test_zsh_and_fish_are_offered_the_same() -> None:
    """Each shell in its own words."""
    assert offered("design make m", "fish") == ["master-ico", "matt-ico"]
    assert [line.strip("_arguments '*:()") for line in offered("design make m", "zsh")] == [
        '"master-ico"',
        '"matt-ico"',
    ]


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
@pytest.mark.parametrize("program", list(MODULE))
def test_the_scripts_name_program_and_variable(program: str, shell: str) -> None:
    """What --show-completion prints asks the program by the variable that the tests above set."""
    answer = run(program, "--show-completion", shell, _TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION="1")
    assert answer.returncode == 0, answer
    assert f"_{program.upper()}_COMPLETE=complete_{shell}" in answer.stdout
    assert program in answer.stdout


@pytest.mark.skipif(shutil.which("bash") is None, reason="no bash")
def test_bash_itself_completes(tmp_path: Path) -> None:
    """Bash loads the script, calls its function as for a pressed Tab, and gets the template's name."""
    program = tmp_path / "design"
    program.write_text(f'#!/bin/sh\nexec "{PYTHON}" -m designer.cli "$@"\n')
    program.chmod(0o755)
    script = run("design", "--show-completion", "bash", _TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION="1").stdout
    pressed = 'COMP_WORDS=(design make alu); COMP_CWORD=2; _design_completion design; echo "${COMPREPLY[@]}"'
    answer = programs.run("bash", "-c", f"{script}\n{pressed}", PATH=f"{tmp_path}:{os.environ['PATH']}")
    assert answer.stdout.split() == ["alu-board"]


def test_installing_writes_to_the_home_folder_only(tmp_path: Path) -> None:
    """--install-completion of bash leaves a script and a line that loads it."""
    answer = run(
        "calib", "--install-completion", "bash", HOME=str(tmp_path), _TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION="1"
    )
    assert answer.returncode == 0, answer
    (script,) = (path for path in tmp_path.rglob("*") if path.suffix == ".sh")
    assert "_CALIB_COMPLETE" in script.read_text()
    assert str(script) in (tmp_path / ".bashrc").read_text()
