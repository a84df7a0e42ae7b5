"""What a block of sliders holds: measures that follow the sizes of errors, and its text for the page's script."""

import json
from dataclasses import dataclass
from typing import Literal

from designer.base.codec import encode
from designer.base.square_law import MISSED, SquareLaw
from designer.page.scene import MARKUP


@dataclass(frozen=True)
class Measure:
    """A number that a person cares for."""

    name: str  # as an option takes it
    title: str
    unit: str
    limit: float  # that is wanted at first
    is_required: bool  # the limit was asked for


@dataclass(frozen=True)
class SetSize:
    """A slider's place."""

    distribution: Literal["normal", "uniform", "fixed"]
    size: float  # in the slider's unit
    gain: float  # of the law's size over this one; 0: cannot be set here


@dataclass(frozen=True)
class Slider:
    """An error whose size is set, on a scale of logarithms."""

    name: str  # as an option takes it
    title: str
    unit: str
    lowest: float  # in that unit; below it is none at all
    highest: float


@dataclass(frozen=True)
class Choice:
    """Settings of all sliders at once."""

    name: str  # as an option takes it
    title: str
    settings: tuple[SetSize, ...]


@dataclass(frozen=True)
class WhatIfSide:
    """One of the things that are compared."""

    title: str
    law: SquareLaw
    sliders: tuple[Slider, ...]
    choices: tuple[Choice, ...]
    start: Choice  # one of them by its name, with settings of its own
    choice_option: str  # "--errors"
    size_option: str  # "--set"


@dataclass(frozen=True)
class WhatIfModel:
    """All that the sliders show. The command line is `command`, then what is set."""

    measures: tuple[Measure, ...]  # in the order of the laws' rows
    shown: tuple[int, ...]  # rows of the measures in the table
    by: int  # row of the measure that is ranked by at first
    sides: tuple[WhatIfSide, ...]  # one or two
    command: tuple[str, ...]
    missed: float = MISSED  # see `designer.base.square_law`


def what_if_json(model: WhatIfModel) -> str:
    """The model as ASCII JSON without `<`, `>` and `&`; null is a number that is not known."""
    text = json.dumps(encode(WhatIfModel, model), separators=(",", ":"), ensure_ascii=True, allow_nan=False)
    return "".join(MARKUP.get(character, character) for character in text)
