"""Registries: things of one kind, a file each, by their names."""

from collections.abc import Collection, Iterator, Mapping
from importlib import import_module
from typing import TypeVar, cast

Entry = TypeVar("Entry")


class Registry(Mapping[str, Entry]):
    """What the files of a package hold, by the files' names; a file is loaded when its entry is used.

    So a command can offer the names without waiting for compiled kernels.
    """

    def __init__(self, package: str, word: str, names: Collection[str]) -> None:
        """Remember the names, in the order in which they are offered, and the word by which a file calls its entry."""
        self._package, self._word, self._names = package, word, names
        self._used: dict[str, Entry] = {}

    def __getitem__(self, name: str) -> Entry:
        if name not in self._used:
            if name not in self._names:
                raise KeyError(name)
            self._used[name] = cast("Entry", getattr(import_module(f"{self._package}.{name}"), self._word))
        return self._used[name]

    def __contains__(self, name: object) -> bool:
        return name in self._names

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)
