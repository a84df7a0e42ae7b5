"""What a shell is offered as the value of an option or argument; where nothing fits, it offers files."""

from collections.abc import Callable, Sequence
from typing import get_args

Complete = Callable[[str], list[str]]


def target_templates(incomplete: str) -> list[str]:
    """Templates of targets."""
    return _presets("targets", incomplete)


def printer_templates(incomplete: str) -> list[str]:
    """Templates of printers."""
    return _presets("printers", incomplete)


def error_templates(incomplete: str) -> list[str]:
    """Templates of manufacturing errors."""
    return _presets("errors", incomplete)


def camera_templates(incomplete: str) -> list[str]:
    """Templates of cameras."""
    return _presets("cameras", incomplete)


def one_of(words: Sequence[str]) -> Complete:
    """These words, and no others."""

    def complete(incomplete: str) -> list[str]:
        return [word for word in words if word.startswith(incomplete)]

    return complete


def for_option(name: str) -> Complete | None:
    """What completes the option of a spec's field."""
    from designer.spec.spec import Build, Lattice

    completed: dict[str, Complete] = {
        "printer": printer_templates, "build": one_of(get_args(Build)), "lattice": one_of(get_args(Lattice)),
    }  # fmt: skip
    return completed.get(name)


def _presets(kind: str, incomplete: str) -> list[str]:
    from designer.kinds.presets import preset_folder

    return sorted(path.stem for path in (preset_folder() / kind).glob("*.toml") if path.stem.startswith(incomplete))
