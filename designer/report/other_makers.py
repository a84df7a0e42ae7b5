"""What to do with files for lasers, cutters and board houses: what each format says of itself."""

from collections.abc import Callable, Iterator
from importlib import import_module
from typing import cast

from designer.base.words import capital
from designer.page.blocks import Fold, Section, Steps
from designer.produce import Design
from designer.spec.format import FORMATS
from designer.target import TargetGeometry

Guide = Callable[[str, TargetGeometry, str], tuple[str, ...]]


def other_makers(design: Design) -> Section | None:
    """A fold for each such file; None where there is none."""
    folds = tuple(_folds(design))
    lead = "The same pattern, made in another way; each file is all that a maker needs."
    return Section("Lasers, cutters, board houses", folds, lead) if folds else None


def _folds(design: Design) -> Iterator[Fold]:
    for name in design.job.formats:
        if guide := FORMATS[name].guide:
            steps = cast(Guide, import_module(f"designer.formats.{guide}").steps)
            yield Fold(
                capital(FORMATS[name].title), (Steps(steps(design.job.name, design.target, name)),), is_open=True
            )
