"""Numbers as lines of text, in arrays of characters: a format call for each number takes ten times as long.

A line of `text_lines(b'x="', decimals(x, 5), b'"')` is what `'x="%.5f"' % x` gives. Numbers have as many characters as
the longest; in place of those that a shorter one lacks stands a character that is left out at the end.
"""

import numpy as np
from numpy.typing import NDArray

Characters = NDArray[np.uint8]

_LEFT_OUT = 0


def text_lines(*parts: bytes | Characters) -> bytes:
    """Lines that go on from part to part: text that all share, and characters of numbers.  # (N, W)"""
    blocks = [np.frombuffer(part, np.uint8)[None] if isinstance(part, bytes) else part for part in parts]
    ends = np.cumsum([block.shape[1] for block in blocks])
    lines = np.empty((max(len(block) for block in blocks), ends[-1]), np.uint8)
    for block, end in zip(blocks, ends, strict=True):
        lines[:, end - block.shape[1] : end] = block
    return lines.tobytes().translate(None, delete=bytes([_LEFT_OUT]))


def whole_numbers(values: NDArray[np.integer]) -> Characters:
    """Numbers from 0 on.  # (N,) -> (N, W)"""
    return _digits(values.astype(np.int64), 1)


def decimals(values: NDArray[np.float64], places: int) -> Characters:
    """Numbers rounded to so many decimal places, which all are written.  # (N,) -> (N, W)"""
    digits = _digits(np.rint(np.abs(values) * 10**places).astype(np.int64), 1 + places)
    text = np.full((len(values), 2 + digits.shape[1]), ord("."), np.uint8)
    text[:, 0] = np.where(np.signbit(values), ord("-"), _LEFT_OUT)
    text[:, 1 : -places - 1] = digits[:, :-places]
    text[:, -places:] = digits[:, -places:]
    return text


def _digits(values: NDArray[np.int64], least: int) -> Characters:
    """Decimal digits of numbers from 0 on, `least` at least.  # (N,) -> (N, W)"""
    width = max(least, len(str(values.max(initial=0))))
    digits = np.empty((len(values), width), np.uint8)
    rest = values
    for place in range(width):  # from the last one on
        tenth = rest // 10
        digit = rest - 10 * tenth + ord("0")
        digits[:, width - 1 - place] = digit if place < least else np.where(rest > 0, digit, _LEFT_OUT)
        rest = tenth
    return digits
