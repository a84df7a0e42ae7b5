"""What to do with files for lasers, cutters and board houses: what each format says of itself."""

from collections.abc import Callable, Iterator, Sequence
from importlib import import_module
from typing import cast

from designer.base.words import capital
from designer.formats.folder import OutputFile
from designer.page.blocks import Fold, Section, Steps
from designer.produce import Design
from designer.spec.format import FORMATS
from designer.target import TargetGeometry

Guide = Callable[[str, TargetGeometry, str], tuple[str, ...]]


def other_makers(design: Design, files: Sequence[OutputFile]) -> Section | None:
    """A fold for each such format; None where there is none.

    Args:
        design: what is made.
        files: of the folder.
    """
    folds = tuple(_folds(design, [file.name for file in files]))
    lead = "The same pattern, made in another way; each file is all that a maker needs."
    return Section("Lasers, cutters, board houses", folds, lead) if folds else None


def _folds(design: Design, names: Sequence[str]) -> Iterator[Fold]:
    for format_name in design.job.formats:
        entry = FORMATS[format_name]
        if not entry.guide:
            continue
        steps = cast(Guide, import_module(f"designer.formats.{entry.guide}").steps)
        mine = [name for name in names if name.endswith(entry.suffix)]
        listed = " and ".join(mine) if len(mine) < 3 else f"{mine[0]} to {mine[-1]}"
        yield Fold(capital(entry.title), (Steps(steps(listed, design.target, format_name)),), is_open=True)
