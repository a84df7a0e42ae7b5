"""The order of arguments is one in all commands: whose it is, what is shown, the photos of it."""

import inspect
from importlib import import_module

import pytest

from calib.cli import LINES, place_of
from designer.base.options import parameters_of
from tests.support.command_line import calib

LAST = ("photos", "observed", "detections", "sightings")
"""What was seen: nothing stands behind it but what tells it."""
TELLS = {"solve": ("observed", "target"), "rig": ("observed", "photos")}
"""In Python: observations tell their points, and only a file needs a target; a rig's may stand in its place."""


def arguments_of(name: str) -> list[str]:
    """The positional parameters of a command's function."""
    module, _, word = place_of(name).partition(":")
    given = parameters_of(inspect.unwrap(getattr(import_module(module), word)))
    return [one.name for one in given.values() if one.option.is_argument]


@pytest.mark.parametrize("name", sorted(LINES))
def test_what_was_seen_comes_last(name: str) -> None:
    """Targets, cameras and rigs before photos, detections and sightings."""
    names = arguments_of(name)
    if tuple(names) == TELLS.get(name, ()):
        return
    seen = [number for number, one in enumerate(names) if one in LAST]
    assert seen in ([], [len(names) - 1])


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (
            ("check", "board.target.json", "camera.json", "photos"),
            "the order is calib check CAMERA|RIG TARGET PHOTO...",
        ),
        (("check", "camera.json", "photos/view_0000.png", "board.target.json"), "is photos; the order is"),
        (("pose", "camera.json", "board.target.json", "photos"), "the order is calib pose TARGET CAMERA PHOTO..."),
        (("run", "photos/view_0000.png", "board.target.json"), "the order is calib run TARGET PHOTO..."),
        (("detect", "photos/view_0000.png", "board.target.json", "-o", "d.csv"), "the order is calib detect TARGET"),
        (
            ("undistort", "photos/view_0000.png", "camera.json", "-o", "o"),
            "the order is calib undistort CAMERA PHOTO...",
        ),
    ],
)
@pytest.mark.usefixtures("scene_copy")
def test_another_order_is_answered_with_the_right_one(words: tuple[str, ...], said: str) -> None:
    """In one line; nothing is swapped in silence."""
    answer = calib(*words)
    assert (answer.code, answer.out, answer.err.count("\n")) == (2, "", 1)
    assert said in answer.err


@pytest.mark.parametrize("name", sorted(LINES))
def test_defaults_lie_within_what_may_be_given(name: str) -> None:
    """Limits and default are of one unit: a value that a page shows can be typed."""
    module, _, word = place_of(name).partition(":")
    for one in parameters_of(inspect.unwrap(getattr(import_module(module), word))).values():
        if isinstance(one.default, int | float):
            assert one.option.least <= one.default <= one.option.most, one.name
