"""Every option that a command takes is used or refused: what names nothing never passes unseen."""

from collections.abc import Iterator
from pathlib import Path

import click
import pytest
import typer
from typer.core import TyperGroup

from calib.cli import app
from tests.laws.test_exit_codes import BOOTSTRAP, CALIB
from tests.support.command_line import calib

NONSENSE = "no/such"
ROBOT = "image,x_mm,y_mm,z_mm,qx,qy,qz,qw\n" + "".join(f"view_{n:04d}.png,{n},{n},0,0,0,0,1\n" for n in range(8))
SEEN = ("board.target.json", "--table", "detections.csv", "-o", "out")
HAND_EYE, TURNTABLE = ("hand-eye", *SEEN, "--robot", "robot.csv"), ("turntable", *SEEN)
LIVE = ("live", "board.target.json", "--no-open", "-o", "out")
COUPON = ("coupon", "photos/view_0000.png", "-o", "out")
QUICK = ("--quick", "-o", "out")
OF_COMMAND = {
    "hand-eye": HAND_EYE,
    "turntable": TURNTABLE,
    "live": (*LIVE, "--watch", "photos"),
    "coupon": COUPON,
    "study paper": ("study", "paper", *QUICK),
    "study compare": ("study", "compare", *QUICK),
    "study cost": ("study", "cost", *QUICK),
}
WRITTEN = {"-o", "--out", "--overlay", "--picture"}
"""Places that a command makes."""
NAMING = {"Path", "str", "list[str]", "list[Path]"}


ALONE = {"study bootstrap": {"--rig"}, "live": {"--camera"}}
"""Options that stand in the place of what the line has: it is refused for that."""
NO_OPTIONS = {"study plot", "warm-up"}


WORK = (
    "calib.capture.serving.Serving.until_done",
    "calib.detector.pipeline.detect",
    "calib.solver.solve.solve",
    "calib.studies.bootstrap.make_pool",
    "calib.studies.compare.cases.comparison",
    "calib.studies.cost.cases.groups_of",
    "calib.judge.solutions.calibrate",
)
"""What no line is worth that names nothing: a page served, a photo searched, a camera solved, a study sampled."""


def _commands() -> Iterator[tuple[str, click.Command]]:
    """All commands, those of groups by both words."""
    group = typer.main.get_command(app())
    assert isinstance(group, TyperGroup)
    for name, one in group.commands.items():
        if isinstance(one, TyperGroup):
            yield from ((f"{name} {inner}", command) for inner, command in one.commands.items())
        else:
            yield name, one


def _line(name: str) -> tuple[str, ...]:
    """A line of a command that has what it takes."""
    if name in OF_COMMAND:
        return OF_COMMAND[name]
    words = name.split()
    return next(case.words for case in CALIB if case.words[: len(words)] == tuple(words) and case.code == 0)


def _cases() -> list[tuple[str, str]]:
    """Each option that takes a file, a name or a quantity, of all commands."""
    return [
        (name, one.opts[0])
        for name, command in _commands()
        for one in command.params
        if one.param_type_name == "option"
        and one.bare_type() in NAMING  # type: ignore[attr-defined]
        and not (WRITTEN | ALONE.get(name, set())) & set(one.opts)
    ]


def test_all_commands_are_held() -> None:
    """But for those that have no such option."""
    assert {name for name, _ in _commands()} - {name for name, _ in _cases()} == NO_OPTIONS


def _unused(*_: object, **__: object) -> None:
    raise AssertionError("the option was not looked at")


@pytest.mark.parametrize(("command", "option"), _cases())
def test_an_option_that_names_nothing_is_refused(
    command: str, option: str, scene_copy: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In a line that has the option or what was given, before any work is done."""
    for work in WORK:
        monkeypatch.setattr(work, _unused)
    (scene_copy / "robot.csv").write_text(ROBOT)
    answer = calib(*_line(command), option, NONSENSE)
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
        ((*HAND_EYE, "--jobs", "2"), "--jobs"),
        ((*TURNTABLE, "--jobs", "2"), "--jobs"),
        (("rig", "--table", "rig.csv", "-o", "out", "--jobs", "2"), "--jobs"),
        (("rig", "--table", "blind.csv", "-o", "out", "--points", "corner"), "--points"),
        (("hand-eye", "board.target.json", "photos", *HAND_EYE[4:], "--points", "corner"), "--points"),
        ((*HAND_EYE, "--points", "corner"), "--points"),
        (("triangulate", "pair.rig.json", "sightings.csv", "-o", "out", "--jobs", "2"), "--jobs"),
        ((*BOOTSTRAP, "--dask", "tcp://127.0.0.1:1"), "--jobs"),
        (("study", "cost", *QUICK, "--model", "opencv"), "--model"),
        (("study", "cost", *QUICK, "--sets", "2"), "--sets"),
        (("study", "compare", *QUICK, "--virtual-sets", "3"), "--virtual-sets"),
        (("study", "cost", *QUICK, "--image-size", "640x480"), "--image-size"),
        ((*COUPON, "--printer", "prusa-xl"), "--printer"),
        ((*COUPON, "--save", "printer.json"), "--save"),
        ((*COUPON, "--save", "my.toml", "--printer", "none"), "none"),
        ((*LIVE, "--size", "640x480"), "--size"),
        ((*LIVE, "--watch", "photos", "--size", "640x480"), "--size"),
        ((*LIVE, "--watch", "photos", "--watch", "blank", "--size", "640x480"), "--size"),
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
