"""Every option that a command takes is used or refused: what names nothing never passes unseen."""

import importlib
import inspect
import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import get_args

import click
import pytest

import calib as product
from calib.cli import LINES, app, place_of
from designer.base.errors import InputError
from designer.base.marks import Length
from designer.base.options import Parameter, parameters_of
from designer.cli import app as design_app
from tests.laws.test_exit_codes import BOOTSTRAP, CALIB, DESIGN, commands_of
from tests.support.command_line import Answer, calib, design, instead

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
WRITTEN = {"-o", "--out", "--overlay", "--history", "--picture"}
"""Places that a command makes."""
NAMING = {"Path", "str", "list[str]", "list[Path]"}


ALONE = {"study bootstrap": {"--rig"}, "live": {"--camera"}}
"""Options that stand in the place of what the line has: it is refused for that."""
NO_OPTIONS = {"study plot", "warm-up"}


NEEDED = {"field_rad": 1.0, "volume_mm": (100.0, 100.0, 50.0)}
"""What takes no text."""
STUDIED = {"design choose": "choose", "design tolerance": "tolerance", "design ways": "ways"}
"""Commands of `design` that are capabilities of `calib`."""


def _commands() -> Iterator[tuple[str, click.Command]]:
    """All commands of `calib`, and those of `design` by its name before."""
    yield from commands_of(app())
    designs = dict(commands_of(design_app()))
    yield from ((name, designs[word]) for name, word in STUDIED.items())


def run(name: str, *more: str) -> Answer:
    """A line of a command that has what it takes, with more words; an option of both is as those say."""
    words = tuple(name.removeprefix("design ").split())
    program, cases = (design, DESIGN) if name in STUDIED else (calib, CALIB)
    usual = (case.words for case in cases if case.words[: len(words)] == words and case.code == 0)
    line = OF_COMMAND[name] if name in OF_COMMAND else next(usual, None)
    assert line, f"add a case of exit code 0 of {name} to the table of test_exit_codes"
    return program(*instead(line, more))


def _cases() -> list[tuple[str, str]]:
    """Each option that takes a file, a name or a quantity, of all commands."""
    return [
        (name, one.opts[0])
        for name, command in _commands()
        for one in command.params
        if one.param_type_name == "option" and one.bare_type() in NAMING  # type: ignore[attr-defined]
        and not (WRITTEN | ALONE.get(name, set())) & set(one.opts)
    ]  # fmt: skip


def test_all_commands_are_held() -> None:
    """But for those that have no such option."""
    assert {name for name, _ in _commands()} - {name for name, _ in _cases()} == NO_OPTIONS


def _unused(*_: object, **__: object) -> None:
    raise AssertionError("the option was not looked at")


@pytest.mark.parametrize(("command", "option"), _cases())
def test_an_option_that_names_nothing_is_refused(
    command: str, option: str, scene_copy: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In a line that has the option or what was given, before anything is sampled or a page is served."""
    for work in ("calib.capture.serving.Serving.until_done", "calib.studies.compare.cases.comparison"):
        monkeypatch.setattr(work, _unused)
    for work in ("calib.studies.cost.ratios.cases_of", "calib.studies.bootstrap.make_pool"):
        monkeypatch.setattr(work, _unused)
    (scene_copy / "robot.csv").write_text(ROBOT)
    answer = run(command, option, NONSENSE)
    assert answer.code == 2, answer
    assert option.strip("-") in answer.err or NONSENSE in answer.err


def _numbers(name: str) -> list[Parameter]:
    """Options of a capability that take numbers."""
    place = f"calib.app.{STUDIED[name]}:{STUDIED[name]}" if name in STUDIED else place_of(name)
    module, _, word = place.partition(":")
    of_function = parameters_of(inspect.unwrap(getattr(importlib.import_module(module), word)))
    is_number = {int, float, *(one.kind for one in of_function.values() if get_args(one.kind)[:1] == (float,))}
    return [one for one in of_function.values() if one.kind in is_number and one.option.parse is None]


def _beyond(one: Parameter) -> Iterator[str]:
    """Texts of numbers just outside of an option's limits, of none, and of one with a unit that nothing has."""
    yield from ("1kg", "nan")
    for limit, sign in ((one.option.least, -1), (one.option.most, 1)):
        if math.isfinite(limit) and abs(limit) < 1e15:
            value = limit + sign * (abs(limit) or 1.0)
            yield str(int(value)) if one.kind is int else one.text_of(value)


@pytest.mark.parametrize("command", [name for name in (*LINES, *STUDIED) if _numbers(name)])
def test_a_number_beyond_its_limits_or_in_another_unit_is_refused(command: str, scene_copy: Path) -> None:
    """Option, value and rule in one line before any work, of every option that takes a number."""
    (scene_copy / "robot.csv").write_text(ROBOT)
    for one in _numbers(command):
        for text in _beyond(one):
            answer = run(command, one.flag, text)
            assert (answer.code, answer.out, answer.err.count("\n")) == (2, "", 1), answer
            assert answer.err.startswith((f"error: {one.flag} {text}: must be", f"error: {one.flag} '{text}': "))
    assert not Path("out").exists()


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
        (("study", "compare", "-o", "out", "--sets", "3", "--virtual-sets", "5"), "--virtual-sets 5: there are 3 sets"),
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


@pytest.mark.parametrize(
    ("name", "option"), [("solve", "--model"), ("budget", "--distance"), ("design tolerance", "--draws")]
)
def test_an_option_that_takes_one_is_given_once(name: str, option: str) -> None:
    """The last of several would be taken, and the others be unseen."""
    words = (*name.removeprefix("design ").split(), "x", option, "1", option, "2")
    answer = (design if name in STUDIED else calib)(*words)
    assert answer.code == 2
    assert f"{option}: given 2 times" in answer.err


def _functions() -> dict[str, Callable[..., object]]:
    """All capabilities, as Python calls them."""
    places = [place_of(name).split(":") for name in LINES]
    of_commands = {name: getattr(importlib.import_module(module), name) for module, name in places}
    public = {name: getattr(product, name) for name in product.__all__}
    return of_commands | {name: one for name, one in public.items() if hasattr(one, "as_command")}


@pytest.mark.parametrize(("name", "function"), _functions().items())
@pytest.mark.parametrize("value", [5j, object(), b"x", [5j]], ids=["complex", "object", "bytes", "list"])
def test_a_value_of_a_type_that_a_parameter_does_not_take_is_refused(
    name: str, function: Callable[..., object], value: object
) -> None:
    """In Python, whatever the parameter, in one line that names it, before any work."""
    takes, options = inspect.signature(function).parameters, parameters_of(function)
    needed = {one.name: NEEDED.get(one.name, "none") for one in takes.values() if one.default is one.empty}
    for parameter in takes:
        with pytest.raises(InputError) as refused:
            function(**{**needed, parameter: value})
        said = str(refused.value)
        flag = options[parameter].flag if parameter in options else parameter
        assert said.startswith((f"{parameter} ", f"{flag} ")), (name, said)
        assert "\n" not in said


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("solve", {"model": "opencv", "reference": "all"}),
        ("bootstrap", {"target": "board.target.json"}),
        ("bootstrap", {"image_size": (640, 480)}),
        ("convert", {"to": "opencv", "source": "kalibr"}),
        ("convert", {"to": "opencv", "source_unit": "m"}),
    ],
)
def test_what_has_nothing_to_act_on_beside_an_object_is_refused(
    name: str, words: dict[str, object], scene_copy: Path
) -> None:
    """In Python as in a shell, where the same stands for what a file lacks."""
    seen = product.load_observations("detections.csv", "board.target.json")
    given = product.load_camera("camera.json") if name == "convert" else seen
    with pytest.raises(InputError, match=f"^{[*words][-1]}"):
        getattr(product, name)(given, **words)


def test_a_place_and_a_text_are_told_as_they_were_given(scene_copy: Path) -> None:
    """A path without the folder that a person is in; a text by its characters."""
    assert "error: camera.json: is a file" in calib("solve", "detections.csv", "-o", "camera.json/out").err
    assert Length(1, 500).fault("x" * 501) == "has 501 characters; it must be 1 to 500"
