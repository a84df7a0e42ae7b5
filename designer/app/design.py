"""What a person calls from Python to design a target; `design` on the command line stands on it."""

import re
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextvars import copy_context
from dataclasses import dataclass
from functools import cached_property
from numbers import Real
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from designer.base.errors import InputError
from designer.base.files import place_of, read_spec_file
from designer.base.words import shown
from designer.builds.design import Design, make_files, maker_of
from designer.formats.folder import OutputFile, files_left, replaced_target, write_folder
from designer.kinds.presets import preset_or_file
from designer.kinds.sizing import size_job
from designer.kinds.spec_file import RawValue, parse_spec, replaced
from designer.make.estimate import PrintEstimate
from designer.make.printability import PrintCheck, check_printability
from designer.spec.kind import KINDS, kind_named, kinds
from designer.spec.options import Value, options_of
from designer.target import TargetGeometry

if TYPE_CHECKING:
    from designer.app.costs import Costs
    from designer.page.blocks import Page

Place: TypeAlias = str | PathLike[str]
Wish: TypeAlias = str | PathLike[str] | float | bool | tuple[float, ...] | tuple[str, ...] | None
"""The value of an option: as the command line has it, or as numbers; None: chosen as usual."""
LENGTHS: tuple[Value, ...] = ("length", "length above 0", "length from 0", "chord error", "size", "bed", "page")
"""What millimetres can be given for."""


def unheard(stage: str) -> None:
    """Nobody is told."""


@dataclass(frozen=True, eq=False)
class Written:
    """What a run wrote, and what an earlier run of the same name left beside it."""

    folder: Path
    files: tuple[OutputFile, ...]
    left: tuple[str, ...]
    replaced: tuple[str, ...]  # a line on another target that stood under this name
    page: "Page"


@dataclass(frozen=True)
class DesignedTarget:
    """A target with what the design rules say of it: `made.geometry`, `made.save("exports/ico")`.

    >>> target = designer.ico(edge_mm=100)
    >>> target.geometry.ring_count, target.save("exports/ico")
    """

    design: Design
    check: PrintCheck
    remarks: tuple[str, ...]  # what was chosen, one line each

    @property
    def name(self) -> str:
        """What its files are called."""
        return self.design.job.name

    @property
    def geometry(self) -> TargetGeometry:
        """Where its rings are: what detector, solver and studies read."""
        return self.design.target

    @property
    def estimate(self) -> PrintEstimate:
        """What printing it takes: `target.estimate.time_s`, `.changes`, `.total_g`, `.price`."""
        return self.design.estimate

    @cached_property
    def costs(self) -> "Costs":
        """The same against the other builds of the target."""
        from designer.app.costs import costs_of

        return costs_of(self.design)

    def files(self, on_stage: Callable[[str], None] = unheard) -> tuple[OutputFile, ...]:
        """All files of the folder, in memory, the page last.

        Raises:
            InputError: one cannot be made as asked.
        """
        return self._with_page(on_stage)[0]

    def _with_page(self, on_stage: Callable[[str], None]) -> tuple[tuple[OutputFile, ...], "Page"]:
        """The files, and the page before it was written down."""
        _ = self.design.plates  # of which both make use
        with ThreadPoolExecutor(1) as beside:  # while files are compressed
            costs = beside.submit(copy_context().run, lambda: self.costs)
            files = make_files(self.design, on_stage)
        from designer.app.design_page import design_page, page_file

        on_stage("page")
        page = design_page(self.design, self.check, files, costs.result())
        return (*files, page_file(page)), page

    def save(self, folder: Place | None = None, on_stage: Callable[[str], None] = unheard) -> Written:
        """Write the files that `design` writes: `target.save("exports/ico")`; what was written.

        Args:
            folder: None: `exports/NAME`.
            on_stage: is told what is made.

        Raises:
            InputError: the folder takes no files, or holds somebody else's.
        """
        place = Path("exports") / self.name if folder is None else place_of(folder, "a folder")
        replaced_lines = replaced_target(place, self.name, self.geometry)

        files, page = self._with_page(on_stage)
        write_folder(place, files)
        return Written(place, files, files_left(place, self.name, files), replaced_lines, page)


def design(kind: str, *, must_fit: bool = False, **wishes: Wish) -> DesignedTarget:
    """Design a target of a kind: `design("ico", edge_mm=100)`.

    The kinds are functions of their own, too.

    Args:
        kind: one of `designer.spec.kind.KINDS`.
        must_fit: refuse a part that is larger than the printer's bed.
        wishes: options of the command line with underscores: `ring_diameter="7mm"`, or with the unit in the name and
            a number: `ring_diameter_mm=7`, `size_mm=(220, 220)`.

    Raises:
        InputError: a value that breaks a rule, or a target that cannot be made; the nearest that can be is named.
    """
    if not isinstance(kind, str) or kind not in KINDS:
        raise InputError(f"kind {kind!r}: there is none; there are {', '.join(KINDS)}")
    return designed({"kind": kind, **_values(wishes)}, "", must_fit=must_fit)


def function_of(kind: str) -> Callable[..., DesignedTarget]:
    """What `designer.ico` and the others are: `design` of a kind, with the kind's options in its help."""
    entry = kind_named(kind)
    asked = options_of(entry.asked)
    first = [name for name, option in asked.items() if option.value == "mesh"]  # as on the command line

    def made(*unnamed: Wish, must_fit: bool = False, **wishes: Wish) -> DesignedTarget:
        if len(unnamed) > len(first):
            raise InputError(
                f"{kind}: {unnamed[len(first)]!r} is given without a name; name it, as in "
                f"{kind}({[*entry.spec.extent, *asked][0]}=...)"
            )
        return design(kind, must_fit=must_fit, **dict(zip(first, unnamed, strict=False)), **wishes)

    options = [f"    {name}: {option.help}" for name, option in asked.items()]
    made.__doc__ = "\n".join([
        f'Design {entry.title}: `designer.{kind}(...).save("exports/{kind}")`.', "",
        "A value is as on the command line, or a number under a name that ends in `_mm`.", "", "Args:",
        "    must_fit: refuse a part that is larger than the printer's bed", *options,
    ])  # fmt: skip
    made.__name__ = made.__qualname__ = kind
    return made


def load(spec: Place, *, must_fit: bool = False, **wishes: Wish) -> DesignedTarget:
    """Design a template's or a TOML file's target: `load("matt-ico")`.

    Wishes replace the file's values.

    Raises:
        InputError: no such template or file, or a value that breaks a rule.
    """
    place = place_of(spec, "a template, or a TOML file")
    path = preset_or_file("targets", fspath(spec))
    name = re.sub(r"[^A-Za-z0-9._-]+", "-", path.stem).strip("-._")[:64] or None
    values = {"name": name, **replaced(read_spec_file(path), _values(wishes))}
    return designed(values, str(path) if path == place else fspath(spec), must_fit=must_fit)


def designed(values: dict[str, RawValue], origin: str, *, must_fit: bool) -> DesignedTarget:
    """Size a target and hold it to the design rules.

    Args:
        values: of its spec, as a TOML file has them.
        origin: what messages name; "" for options.
        must_fit: refuse a part that is larger than the printer's bed.

    Raises:
        InputError: a value, or a design rule, that is broken.
    """
    sized = size_job(parse_spec(values, origin))
    made = Design(sized.job)
    _ = made.printed_pattern  # an ink offset that closes rings is refused with its limits, before the rules
    check = check_printability(made.target, sized.job.printing)
    refused = [found for found in check.violations if must_fit or found.rule != "bed"]
    if refused:
        raise InputError(refused[0].text)
    built = maker_of(sized.job.printing).remarks(made)  # which refuses what cannot be built so
    return DesignedTarget(made, check, (*sized.remarks, *built))


def _values(wishes: dict[str, Wish]) -> dict[str, RawValue]:
    """Wishes as a file has them: the unit in a name goes to its numbers."""
    values: dict[str, RawValue] = {}
    for key, wish in wishes.items():
        name = key.removesuffix("_mm")
        if wish is None:
            continue
        if name != key:
            if (takes := _takes(name)) and takes not in LENGTHS:
                raise InputError(f"{key} {shown(wish)}: {name} is no length; give {name}")
            if name in wishes:
                raise InputError(f"{key} and {name}: one length twice; leave one of them out")
            values[name] = "x".join(f"{one!r}" for one in _lengths_mm(key, wish)) + "mm"
        else:
            values[name] = (
                list(wish) if isinstance(wish, tuple) else fspath(wish) if isinstance(wish, PathLike) else wish
            )
    return values


def _takes(name: str) -> Value | None:
    """What an option takes, which is the same of all kinds; None: there is none."""
    return next((all_of[name].value for kind in kinds() if name in (all_of := options_of(kind.asked))), None)


def _lengths_mm(key: str, wish: object) -> list[float]:
    """One number, or the several of a size, in an order that they keep."""
    given = list(wish) if isinstance(wish, list | tuple) or (isinstance(wish, np.ndarray) and wish.ndim) else [wish]
    lengths = [one for one in given if isinstance(one, Real) and not isinstance(one, bool)]
    if len(lengths) < len(given):
        raise InputError(f"{key} {shown(wish)}: give a number of millimetres")
    if isinstance(wish, list | tuple | np.ndarray) and len(lengths) < 2:
        raise InputError(f"{key} {shown(wish)}: give the number itself, or the two of a size")
    try:
        return [float(one) for one in lengths]
    except OverflowError:
        raise InputError(f"{key} {shown(wish)}: is too large; give a number of millimetres") from None
