"""The templates that travel with the program: targets, printers, cameras and error models as data."""

import difflib
import os
from pathlib import Path
from typing import Literal

from designer.base.errors import InputError
from designer.base.words import shown, suggestion
from designer.kinds.spec_file import PrinterFile, read_printer_file
from designer.spec.spec import PrinterProfile

PresetKind = Literal["targets", "printers", "cameras", "errors", "criteria"]
DEFAULT_PRINTER = "bambu-p1s"


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
    if name in preset_names(kind):
        return preset_folder() / kind / f"{name}.toml"
    own = Path(name)
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
    hint = suggestion(name, preset_names(kind)) or f"; there are {', '.join(preset_names(kind))}"
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


def printer_profile(
    name: str,
    *,
    nozzle_mm: float | None,
    line_width_mm: float | None,
    layer_height_mm: float | None,
    bed_mm: tuple[float, float, float] | None,
) -> PrinterProfile:
    """A printer with one of its nozzles; single values may be replaced.

    Raises:
        InputError: an unknown printer, or a nozzle it has no line for while none is given.
    """
    if nozzle_mm and line_width_mm and layer_height_mm and bed_mm:
        # A full profile, as a resolved spec has it, stands without the file it once came from.
        diameter, line, layer, bed = nozzle_mm, line_width_mm, layer_height_mm, bed_mm
    else:
        path = preset_or_file("printers", name)
        file = read_printer_file(path)
        diameter, bed = nozzle_mm or file.nozzle, bed_mm or file.bed
        line, layer = _line_of_nozzle(file, diameter, line_width_mm, layer_height_mm, name)
        if name not in preset_names("printers"):
            name = file.title
    if not 0.6 * diameter <= line <= 2.5 * diameter:
        raise InputError(
            f"line width {line:g}mm does not fit a {diameter:g}mm nozzle; "
            f"use {0.6 * diameter:.3g}mm to {2.5 * diameter:.3g}mm"
        )
    if layer > 0.8 * diameter:
        raise InputError(
            f"layer height {layer:g}mm is too high for a {diameter:g}mm nozzle; use at most {0.8 * diameter:.3g}mm"
        )
    return PrinterProfile(
        name=name,
        bed_mm=bed,
        nozzle_mm=diameter,
        line_width_mm=line,
        layer_height_mm=layer,
    )


def _line_of_nozzle(
    file: PrinterFile, diameter: float, line_width_mm: float | None, layer_height_mm: float | None, name: str
) -> tuple[float, float]:
    """Line width and layer height, from what is given and from the profile's nozzle."""
    if line_width_mm is not None and layer_height_mm is not None:
        return line_width_mm, layer_height_mm
    for nozzle in file.nozzles:
        if nozzle.diameter == diameter:
            return line_width_mm or nozzle.line_width, layer_height_mm or nozzle.layer_height
    known = ", ".join(f"{nozzle.diameter:g}mm" for nozzle in file.nozzles)
    raise InputError(
        f"nozzle {diameter:g}mm: printer {name!r} has {known}; use one of them, or give --line-width and --layer-height"
    )
