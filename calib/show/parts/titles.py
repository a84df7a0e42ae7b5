"""What the page of a folder is called."""

from pathlib import Path

from designer.base.words import printable

DEFAULT_NAME = "calibration"
"""How `calib run` calls its folder: it says nothing, so the folder around it is named too."""


def title_of(folder: Path) -> str:
    """The folder's name."""
    place = folder.resolve()
    name = f"{place.parent.name}/{place.name}" if place.name == DEFAULT_NAME else place.name
    return printable(name) or DEFAULT_NAME
