"""Options of commands that judge a camera, and what a program is told of the verdict."""

from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from calib.verdict.verdict import Check, Verdict
    from designer.base.answer import Value

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


def verdict_answer(verdict: "Verdict") -> "dict[str, Value]":
    """The verdict and its checks for a program."""
    return {
        "grade": verdict.grade,
        "model": verdict.model,
        "sentence": verdict.sentence,
        "checks": [_check(check) for check in verdict.checks],
        "advice": verdict.advice,
    }


def _check(check: "Check") -> "dict[str, Value]":
    return {
        "name": check.name,
        "grade": check.grade,
        "value": check.value,
        "unit": check.unit,
        "good": check.good,
        "usable": check.usable,
        "is_at_least": check.is_at_least,
        "sentence": check.sentence,
    }
