"""The program's name, and small matters of writing.

Numbers as people read them.
"""

import math
import re
from collections.abc import Iterable, Sequence
from typing import TypeVar

from designer.base.errors import InputError

Item = TypeVar("Item")

NAME = "ringsolid"
"""Files say whose they are: JSON by `"format": "ringsolid.KIND"`, tables by `# ringsolid KIND, version 1`."""


def capital(text: str) -> str:
    """With a capital first letter, unless it begins with a name, as `left.mp4` and `cam0`, which stay as the rest."""
    return text if re.match(r"[\w./]*(\d|[./_]\w)", text) else text[:1].upper() + text[1:]


def counted(count: int, thing: str) -> str:
    """As in `1 photo` and `2 photos`."""
    return f"{count} {thing}{'s' * (count != 1)}"


def with_article(text: str) -> str:
    """As in `an icosahedron`: with the article that goes before its first letter."""
    return f"{'an' if text[:1].lower() in 'aeio' else 'a'} {text}"


def printable(text: str) -> str:
    """Text as one line, with characters that would steer a terminal escaped: file names may hold any."""
    line = " ".join(text.split())
    return "".join(c if c.isprintable() else c.encode("unicode_escape", "backslashreplace").decode() for c in line)


def shown(value: object) -> str:
    """A value as a message shows it."""
    try:
        text = repr(value)
    except (RecursionError, ValueError):  # nested too deep, or an integer of thousands of digits
        return f"({type(value).__name__})"
    return cut(re.sub(r"\s*\n\s*", " ", text))


def cut(text: str, most: int = 60) -> str:
    """A text, or as much of a longer one as fits."""
    return text if len(text) <= most else f"{text[: most - 3]}..."


def first_few(texts: Sequence[str], most: int = 4) -> str:
    """The first texts, and how many more there are: `a, b, c, d and 12 more`."""
    return ", ".join(texts[:most]) + (f" and {len(texts) - most} more" if len(texts) > most else "")


def no_two_alike(words: Iterable[str]) -> tuple[str, ...]:
    """Words as names of files: those that are as one before in any letters, with their number behind."""
    found: list[str] = []
    for number, word in enumerate(words):
        own = word
        while own.lower() in map(str.lower, found):
            own += f"_{number}"
        found.append(own)
    return tuple(found)


def several(option: str, value: Iterable[Item] | str) -> tuple[Item | str, ...]:
    """What an option was given: one text, or any number of values.

    Raises:
        InputError: neither.
    """
    if isinstance(value, str):
        return (value,)
    if not isinstance(value, Iterable):
        raise InputError(f"{option} {shown(value)}: is of type {type(value).__name__}; give a text, or a list of them")
    return tuple(value)


def suggestion(word: object, known: list[str]) -> str:
    """`; did you mean 'x'?` for the known word nearest to a misspelt one, or nothing."""
    import difflib

    match = difflib.get_close_matches(str(word), known, n=1, cutoff=0.5)
    return f"; did you mean {match[0]!r}?" if match else ""


def suggestion_or_all(word: object, known: Iterable[str]) -> str:
    """`suggestion`, or `; there are a, b` where nothing is near."""
    names = list(known)
    return suggestion(word, names) or f"; there are {', '.join(names)}"


def figure(number: float, digits: int = 4) -> str:
    """A number to some significant digits, without an exponent where that is readable; "-" for nan."""
    if not math.isfinite(number):
        return "-"
    if number == 0:
        return "0"
    exponent = math.floor(math.log10(abs(number)))
    if -7 < exponent < 7:
        return f"{number:.{max(0, digits - 1 - exponent)}f}"
    return f"{number:.{digits - 1}e}"


def runs(numbers: Sequence[int]) -> str:
    """Numbers with those that follow one another in a word: `5 to 19, 0`."""
    parts: list[tuple[int, int]] = []
    for number in numbers:
        first = parts.pop()[0] if parts and parts[-1][1] == number - 1 else number
        parts.append((first, number))
    return ", ".join(str(a) if a == b else f"{a} to {b}" for a, b in parts)


def span(numbers: Iterable[float], digits: int = 4) -> str:
    """From the least to the largest of some numbers, or the one that they all are: `3.1 to 4.2`."""
    known = list(numbers)
    least, most = figure(min(known), digits), figure(max(known), digits)
    return least if least == most else f"{least} to {most}"


def with_digits(value: float, sigma: float) -> str:
    """A value to the second digit of its standard deviation."""
    if not sigma > 0 or not math.isfinite(sigma):
        return figure(value, 7)
    # The z: what is rounded to zero has no sign.
    return f"{value:z.{min(max(0, 1 - math.floor(math.log10(sigma))), 15)}f}"
