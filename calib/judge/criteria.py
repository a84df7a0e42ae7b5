"""The limits that a calibration is judged by: templates, or a person's own TOML file.

A file of one's own needs to hold only what differs from the template `standard`.
"""

import re
from collections.abc import Mapping

from calib.judge.checks import CHECKS
from calib.judge.rig_checks import RIG_CHECKS
from calib.judge.verdict import CheckKind, Criteria, Evidence, Limits
from designer.base.errors import InputError
from designer.base.files import read_spec_file
from designer.base.words import shown, suggestion
from designer.kinds.presets import preset_or_file

STANDARD = "standard"
LONGEST_TITLE = 200
_NUMBER = re.compile(r"\s*(\d{1,9}\.?\d{0,9}|\.\d{1,9})\s*([A-Za-z%]{0,8})\s*")
_KEYS = ("good", "usable", "source")


def read_criteria(name_or_path: str = STANDARD) -> Criteria:
    """The criteria of a template, or of a person's TOML file, that a camera is judged by.

    Raises:
        InputError: neither, or a key or value that breaks a rule; the message says which.
    """
    return _read(name_or_path, CHECKS)


def read_rig_criteria(name_or_path: str = STANDARD) -> Criteria:
    """Likewise those that a rig is judged by; errors as `read_criteria`."""
    return _read(name_or_path, RIG_CHECKS)


def _read(name_or_path: str, checks: Mapping[str, CheckKind[Evidence]]) -> Criteria:
    """The limits of some checks, of a file that may hold those of all."""
    path = preset_or_file("criteria", name_or_path)
    values = {**read_spec_file(preset_or_file("criteria", STANDARD)), **read_spec_file(path)}
    try:
        _require_known(values, ("title", *dict.fromkeys((*CHECKS, *RIG_CHECKS))))
        title = values["title"]
        if not isinstance(title, str) or not 0 < len(title) <= LONGEST_TITLE:
            raise ValueError(f"title {shown(title)}: must be a text of 1 to {LONGEST_TITLE} characters")
        limits = {
            name: _limits(kind, values[name]) if name in values else kind.limits
            for name, kind in checks.items()
            if kind.has_limits
        }
    except ValueError as error:
        raise InputError(f"{path}: {error}") from None
    return Criteria(path.stem, title, limits)


def _limits(kind: CheckKind[Evidence], table: object) -> Limits:
    """The limits of one check."""
    if not isinstance(table, dict):
        raise ValueError(f"{kind.name} {shown(table)}: must be a table with good and usable")
    _require_known(table, _KEYS, f"{kind.name}.")
    for key in ("good", "usable"):
        if key not in table:
            raise ValueError(f"{kind.name}.{key} is missing; give both limits, good and usable")
    good, usable = (_quantity(f"{kind.name}.{key}", table[key], kind) for key in ("good", "usable"))
    if (good < usable) if kind.is_at_least else (good > usable):
        rule, what = ("less", "least") if kind.is_at_least else ("more", "most")
        raise ValueError(f"{kind.name}: good {good:g} must not be {rule} than usable {usable:g}: it is at {what} so")
    source = table.get("source", "")
    if not isinstance(source, str):
        raise ValueError(f"{kind.name}.source {shown(source)}: must be a text")
    return Limits(good, usable, source)


def _quantity(key: str, value: object, kind: CheckKind[Evidence]) -> float:
    """A number of a unit, with or without it."""
    number = value
    if isinstance(value, str):
        match = _NUMBER.fullmatch(value)
        if match is None or match[2] not in ("", kind.unit):
            raise ValueError(f"{key} {shown(value)}: must be a number of {kind.unit}, such as '1{kind.unit}'")
        number = float(match[1])
    if isinstance(number, bool) or not isinstance(number, int | float) or not 0 <= number <= kind.most:
        raise ValueError(f"{key} {shown(value)}: must be from 0 to {kind.most:g}{kind.unit}")
    return float(number)


def _require_known(values: Mapping[str, object], known: tuple[str, ...], within: str = "") -> None:
    for key in values:
        if key not in known:
            hint = suggestion(key, list(known)) or "; there are " + ", ".join(known)
            raise ValueError(f"unknown key {shown(within + key)}{hint}")
