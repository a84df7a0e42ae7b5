"""Options and arguments that several commands take, each declared once."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from calib.cameras import learned_models, models_of_all, models_of_all_wide, solved_models
from designer.kinds.presets import criteria_templates, error_templates, one_of

if TYPE_CHECKING:
    pass

TargetArgument = Annotated[Path, typer.Argument(help="the target file (NAME.target.json) of what the photos show")]
_SOLVED, _ALL, _ALL_WIDE, _LEARNED = (
    ", ".join(names) for names in (solved_models(), models_of_all(), models_of_all_wide(), learned_models())
)
ModelOption = Annotated[
    str,
    typer.Option(
        help=f"{_SOLVED}, or all: {_ALL}; of a wide lens {_ALL_WIDE}", autocompletion=one_of((*solved_models(), "all"))
    ),
]
MadeOption = Annotated[
    str | None,
    typer.Option(
        help="how the target was made: an error template (fdm-board, sheet-print, ...), a TOML file of errors, or "
        "exact (default: assumed from how it was built; exact if the photos were rendered)",
        metavar="NAME|FILE",
        autocompletion=error_templates,
    ),
]
DEFAULT_CRITERIA = "standard"


CriteriaOption = Annotated[
    str,
    typer.Option(
        help="limits of the verdict: a template (standard, metrology, robotics), or a TOML file of one's own",
        metavar="NAME|FILE",
        autocompletion=criteria_templates,
    ),
]


def image_size_of(text: str | None, option: str = "--image-size") -> tuple[int, int] | None:
    """Width and height of photos."""
    from calib.observe.correspondences import parse_pair
    from calib.observe.dataset import MAX_SIDE_PX

    return None if text is None else parse_pair(option, text, MAX_SIDE_PX)
