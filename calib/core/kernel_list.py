"""The kernels that the commands need, with the types of their arguments, by the part of the work that needs them first.

`kernels.txt` beside this file was written by running each part on a small example: a part's name, then a line a kernel,
after those that it calls. A kernel that is not in it is compiled when it is called, as any other.
"""

from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import cast

from numba.core import types
from numba.core.registry import cpu_target

from calib.core.kernel_cache import entry_name
from calib.core.kernel_code import Kernel, labelled, parsed_types
from calib.core.kernel_store import store

LIST = Path(__file__).with_name("kernels.txt")


@dataclass(frozen=True)
class Listed:
    """A kernel for some types of arguments: a line of the list."""

    name: str
    """`module:function`."""
    types_text: str

    @property
    def line(self) -> str:
        """As it stands in the list, and in an entry's first line."""
        return f"{self.name}({self.types_text})"

    @property
    def kernel(self) -> Kernel:
        """The kernel itself; its module is loaded.

        Raises:
            LookupError, ImportError, AttributeError, ValueError: the list is older than the sources.
        """
        return cast("Kernel", labelled(self.name))

    @property
    def arguments(self) -> tuple[types.Type, ...]:
        """The types of its arguments; raises as `kernel`."""
        return parsed_types(self.types_text)

    def is_kept(self) -> bool:
        """Whether its machine code, for this processor, is there; raises as `kernel`."""
        made_for = cpu_target.target_context.codegen().magic_tuple()
        return store().holds(entry_name(self.kernel, self.arguments, made_for))

    def compile(self) -> None:
        """Make and keep its machine code; raises as `kernel`."""
        self.kernel.compile(self.arguments)


def parse_line(line: str) -> Listed:
    """A line of the list."""
    name, _, rest = line.partition("(")
    return Listed(name, rest.removesuffix(")"))


def parse_list(text: str) -> Mapping[str, tuple[Listed, ...]]:
    """The lines of a list by part."""
    parts: dict[str, list[Listed]] = {}
    for line in filter(None, map(str.strip, text.splitlines())):
        if line.startswith("["):
            parts[line.strip("[]")] = []
        else:
            parts[next(reversed(parts))].append(parse_line(line))
    return {part: tuple(lines) for part, lines in parts.items()}


@lru_cache(maxsize=1)
def kernel_list() -> Mapping[str, tuple[Listed, ...]]:
    """The list that came with the sources, by part; empty if it is not there."""
    with suppress(OSError):
        return parse_list(LIST.read_text(encoding="utf-8"))
    return {}


def part_of(name: str) -> str | None:
    """The first part that needs a kernel."""
    parts = kernel_list().items()
    return next((part for part, lines in parts if any(line.name == name for line in lines)), None)


def missing(lines: Iterable[Listed]) -> tuple[Listed, ...]:
    """Those whose machine code is not kept; what the sources do not have any more is left out."""
    left = []
    for line in lines:
        with suppress(LookupError, ImportError, AttributeError, ValueError):
            if not line.is_kept():
                left.append(line)
    return tuple(left)
