"""Every option that a command takes is used or refused: what names nothing never passes unseen."""

from pathlib import Path

import pytest
import typer
from typer.core import TyperGroup

from calib.cli import app
from tests.laws.test_exit_codes import CALIB
from tests.support.command_line import calib

NONSENSE = "no/such"
ROBOT = "image,x_mm,y_mm,z_mm,qx,qy,qz,qw\n" + "".join(f"view_{n:04d}.png,{n},{n},0,0,0,0,1\n" for n in range(8))
SEEN = ("board.target.json", "--table", "detections.csv", "-o", "out")
OF_COMMAND = {case.words[0]: case.words for case in reversed(CALIB) if case.code == 0 and not case.before} | {
    "hand-eye": ("hand-eye", *SEEN, "--robot", "robot.csv"),
    "turntable": ("turntable", *SEEN),
}
WRITTEN = {"-o", "--out", "--overlay", "--picture"}
"""Places that a command makes."""
NAMING = {"Path", "str", "list[str]", "list[Path]"}


def _cases() -> list[tuple[str, str]]:
    """Each option that takes a file, a name or a quantity, of all commands that this folder has the input for."""
    group = typer.main.get_command(app())
    assert isinstance(group, TyperGroup)
    return [
        (name, one.opts[0])
        for name, command in group.commands.items()
        if name in OF_COMMAND
        for one in command.params
        if one.param_type_name == "option" and one.bare_type() in NAMING and not WRITTEN & set(one.opts)
    ]


@pytest.mark.parametrize(("command", "option"), _cases())
def test_an_option_that_names_nothing_is_refused(command: str, option: str, scene_copy: Path) -> None:
    """In a line that has the option or what was given."""
    (scene_copy / "robot.csv").write_text(ROBOT)
    answer = calib(*OF_COMMAND[command], option, NONSENSE)
    assert answer.code == 2, answer
    assert option.strip("-") in answer.err or NONSENSE in answer.err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("hand-eye", *SEEN, "--robot", "robot.csv", "--refine"), "--refine"),
        (("hand-eye", *SEEN, "--robot", "robot.csv", "--camera", "camera.json", "--model", "fisheye"), "--model"),
        (("hand-eye", *SEEN, "--robot", "robot.csv", "--camera", "camera.json", "--fix", "k3"), "--fix"),
        (("hand-eye", *SEEN, "--robot", "robot.csv", "--model", "virtual"), "--model virtual"),
        (("hand-eye", "board.target.json", "photos", *SEEN[1:], "--robot", "robot.csv"), "--table"),
        (("hand-eye", *SEEN, "--robot", "robot.csv", "--unit", "deg"), "--unit deg"),
        (("hand-eye", *SEEN, "--robot", "robot.csv", "--euler", "kuka"), "--euler"),
        (("turntable", *SEEN, "--camera", "camera.json", "--fix", "k3"), "--fix"),
        (("turntable", "board.target.json", "photos", *SEEN[1:]), "--table"),
        (("rig", "--table", "rig.csv", "-o", "out", "--tolerance", "5ms"), "--tolerance"),
        (("rig", "--table", "rig.csv", "-o", "out", "--times", "rig.csv"), "--times"),
    ],
)
def test_an_option_that_has_nothing_to_act_on_is_refused(words: tuple[str, ...], said: str, scene_copy: Path) -> None:
    """It would be used in another company, not in this."""
    (scene_copy / "robot.csv").write_text(ROBOT)
    answer = calib(*words)
    assert (answer.code, answer.out) == (2, ""), answer
    assert said in answer.err
    assert not Path("out").exists()
