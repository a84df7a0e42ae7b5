"""The command `calib report`."""

from pathlib import Path
from typing import Annotated

import typer

from designer.base.answer import Summary
from designer.kinds.presets import criteria_templates
from designer.page.progress import waiting
from designer.page.terminal import quoted, say_headline, shown

NEGATIVE = 1


def report(
    folder: Annotated[
        Path,
        typer.Argument(help="folder of calib run, rig, solve, measure or study, or of design tolerance", metavar="DIR"),
    ],
    *,
    criteria: Annotated[
        str | None,
        typer.Option(
            help="judge a calibration or a rig by other limits: a template (standard, metrology, robotics) or a TOML "
            "file of one's own",
            metavar="NAME|FILE",
            autocompletion=criteria_templates,
        ),
    ] = None,
) -> Summary:
    """Write a folder's page, index.html, again from the results it stores.

    A calibration or a rig keeps its verdict, unless other limits are given. The exit code is 1 if the page's answer is
    negative, such as: do not use.
    """
    from calib.api.reporting import report as draw_again

    with waiting("drawing"):
        done = draw_again(folder, criteria=criteria)
    page, headline = done.page, done.page.headline
    if headline is not None:
        say_headline(headline)
    wrote = (*(() if done.verdict is None else (done.verdict,)), done.place)
    for path in wrote:
        print(f"wrote {shown(path)}")
    size_mb = done.place.stat().st_size / 1e6
    print(f"next  open {shown(done.place)} in a browser ({size_mb:.1f} MB, needs nothing beside it)")
    steps = (f"calib report {quoted(folder)} --criteria standard",) if done.can_be_judged else ()
    for step in steps:
        print(f"      {step}   # says whether it is good")
    answer = {
        "kind": done.kind,
        "title": page.title,
        "level": None if headline is None else headline.level,
        "word": None if headline is None else headline.word,
        "sentence": None if headline is None else headline.sentence,
        "sections": [section.title for section in page.sections],
    }
    is_negative = page.is_negative or (headline is not None and headline.level == "bad")
    return Summary(answer, wrote, steps, exit_code=NEGATIVE if is_negative else 0)
