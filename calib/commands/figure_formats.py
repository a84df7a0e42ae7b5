"""The option that asks for figures as more than PNG."""

from typing import Annotated

import typer

from designer.base.errors import InputError
from designer.base.words import shown

FORMATS = ("pdf", "svg")

FiguresOption = Annotated[
    str | None, typer.Option("--figures", help="draw figures as PDF or SVG besides PNG: pdf,svg", metavar="FORMATS")
]


def figure_formats(text: str | None) -> tuple[str, ...]:
    """The formats of an option, each once.

    Raises:
        InputError: another format.
    """
    names = [] if text is None else [name.strip().lower() for name in text.split(",")]
    for name in names:
        if name not in FORMATS:
            raise InputError(f"--figures {shown(name)}: there are {' and '.join(FORMATS)}, besides PNG")
    return tuple(dict.fromkeys(names))
