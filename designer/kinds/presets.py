"""The templates that travel with the program: targets, printers, cameras, rigs and error models as data.

And what a shell offers as the value of an option; where nothing fits, it offers files.
"""

import difflib
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Literal

from designer.base.errors import InputError
from designer.base.files import place_of
from designer.base.words import shown, suggestion_or_all

PresetKind = Literal["targets", "printers", "cameras", "errors", "criteria", "rigs"]
Complete = Callable[[str], list[str]]


def preset_folder() -> Path:
    """Where the templates lie: inside the installed package, or beside it in a checkout."""
    package = Path(__file__).parents[1]
    installed = package / "_templates"
    return installed if installed.is_dir() else package.parent / "templates"


def preset_names(kind: PresetKind) -> list[str]:
    """The templates of a kind, in alphabetical order."""
    return sorted(path.stem for path in (preset_folder() / kind).glob("*.toml"))


def preset_or_file(kind: PresetKind, name: str) -> Path:
    """The file of a template, or the person's own TOML file.

    Raises:
        InputError: neither a template nor an existing file; the message suggests the nearest template.
    """
    own = place_of(name, "a template's name, or a TOML file")
    if name in preset_names(kind):
        return preset_folder() / kind / f"{name}.toml"
    if os.path.islink(own) and not own.exists():
        raise InputError(f"{shown(name)}: a link that leads nowhere; check it, or use one of the templates")
    if kind == "targets" and own.suffix.lower() == ".json":
        raise InputError(f"{name}: a target file holds no spec to make; name the .toml beside it")
    if own.suffix.lower() == ".toml":
        if _is_file(own):
            return own
        raise InputError(
            f"{shown(name)}: no such file; check the path, or use a template: {', '.join(preset_names(kind))}"
        )
    if _is_file(own):
        raise InputError(
            f"{shown(name)}: is no TOML file (NAME.toml), and no template: {', '.join(preset_names(kind))}"
        )
    hint = suggestion_or_all(name, preset_names(kind))
    if kind == "printers":  # the nearest name may well be that of another machine
        near = difflib.get_close_matches(name, preset_names(kind), n=3) or preset_names(kind)
        rest = "another printer needs --bed, --nozzle, --line-width and --layer-height, or a TOML file"
        hint = f"; there are {', '.join(near)}{', ...' if len(near) < len(preset_names(kind)) else ''}; {rest}"
    raise InputError(f"unknown {kind.removesuffix('s')} template {shown(name)}{hint}")


def _is_file(path: Path) -> bool:
    """Whether the path names a file; a name that no file can have names none."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def _templates_of(kind: PresetKind) -> Complete:
    return lambda incomplete: [name for name in preset_names(kind) if name.startswith(incomplete)]


target_templates = _templates_of("targets")
printer_templates = _templates_of("printers")
error_templates = _templates_of("errors")
camera_templates = _templates_of("cameras")
criteria_templates = _templates_of("criteria")
rig_templates = _templates_of("rigs")


def one_of(words: Sequence[str]) -> Complete:
    """These words, and no others."""
    return lambda incomplete: [word for word in words if word.startswith(incomplete)]
