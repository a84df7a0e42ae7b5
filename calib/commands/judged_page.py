"""Options of commands that judge a camera."""

from typing import Annotated

import typer

DEFAULT_CRITERIA = "standard"


def criteria_templates(incomplete: str) -> list[str]:
    """Templates of limits, for a shell."""
    from designer.kinds.presets import preset_names

    return [name for name in preset_names("criteria") if name.startswith(incomplete)]


CriteriaOption = Annotated[
    str,
    typer.Option(
        help="limits of the verdict: a template (standard, metrology, robotics), or a TOML file of one's own",
        metavar="NAME|FILE",
        autocompletion=criteria_templates,
    ),
]

PageOption = Annotated[
    bool, typer.Option("--page/--no-page", help="write the folder's index.html, or save the seconds that takes")
]

VerboseOption = Annotated[
    bool, typer.Option("--verbose", "-v", help="say all tables: photos, parameters, models, checks")
]
