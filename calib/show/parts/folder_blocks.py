"""What the pages of folders have in common: what was asked, warnings and notes, and the files that lie there."""

import stat
from collections.abc import Sequence
from pathlib import Path

from designer.base.words import capital
from designer.page.blocks import Block, Command, Facts, FileList, FileRow, Finding, Findings, Section
from designer.page.links import is_linkable

LONGEST_SUBJECT = 60
MOST_LINES = 20
"""Of one kind, on a page."""


def read_small_bytes(path: Path, most: int) -> bytes | None:
    """The content of a regular file of at most so many bytes; None if it is none."""
    try:
        # Asked before it is opened: a pipe would wait, a device would never end.
        if not stat.S_ISREG(path.stat().st_mode):
            return None
        with path.open("rb") as stream:
            content = stream.read(most + 1)
    except (OSError, ValueError):
        return None
    return content if len(content) <= most else None


def size_bytes(path: Path) -> int | None:
    """Of a regular file; None if it is none."""
    try:
        found = path.stat()
    except (OSError, ValueError):
        return None
    return found.st_size if stat.S_ISREG(found.st_mode) else None


def question_section(question: str, setting: Sequence[tuple[str, str]], *more: Block) -> Section:
    """What a study asks, and of what."""
    facts: tuple[Block, ...] = (Facts(tuple(setting)),) if setting else ()
    return Section("Question", (*facts, *more), lead=question)


def warnings(title: str, lines: Sequence[str]) -> tuple[Block, ...]:
    """Lines that call for care, each under the same title; nothing if there are none."""
    return (Findings(tuple(Finding("usable", title, line) for line in lines)),) if lines else ()


def some_of(lines: Sequence[str]) -> list[str]:
    """The first of very many lines, and how many more there are."""
    more = [f"{len(lines) - MOST_LINES} more"] if len(lines) > MOST_LINES else []
    return [*lines[:MOST_LINES], *more]


def notes(lines: Sequence[str]) -> tuple[Block, ...]:
    """Lines that a study says of itself: `subject: what`, those of one subject together; nothing if there are none."""
    by_subject: dict[str, list[str]] = {}
    for line in lines:
        subject, colon, text = line.partition(": ")
        has_subject = bool(colon) and len(subject) <= LONGEST_SUBJECT
        by_subject.setdefault(subject if has_subject else "", []).append(_sentence(text if has_subject else line))
    rows = [
        Finding("note", subject if "_" in subject else capital(subject), " ".join(texts))
        for subject, texts in by_subject.items()
        if subject
    ]
    rows += [Finding("note", "", text) for text in by_subject.get("", [])]
    return (Findings(tuple(rows)),) if rows else ()


def _sentence(text: str) -> str:
    start = text if text.startswith("sqrt(") else capital(text)
    return start + ("" if text.endswith(".") else ".")


def files_section(folder: Path, purposes: Sequence[tuple[str, str]], again: Command) -> Section:
    """The files of the folder that are there, and the command that makes tables or figures again."""
    known = [(name, why, size_bytes(folder / name)) for name, why in purposes if is_linkable(name)]
    rows = tuple(FileRow(name, why, size) for name, why, size in known if size is not None)
    blocks: tuple[Block, ...] = (FileList(rows),) if rows else ()
    return Section("Files", (*blocks, again))
