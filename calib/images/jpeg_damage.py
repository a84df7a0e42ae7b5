"""Whether a JPEG is as it was written: its compressed pixels, and what their decoder made of them.

A JPEG has no check sums. After a flipped bit a decoder reads other codes than were written, falls into step again some
blocks later, and goes on: all that follows lies a block or more from where it was, and the picture looks sound. What
decoders notice of it they tell nobody (Pillow), or standard error without a name (OpenCV). So the codes are read here
once more, without making pixels of them, and held to what every encoder keeps (ITU-T T.81, annexes F and G): each code
is in its table, no block has more than 64 coefficients, and the blocks end where the data ends. A bit that changes only
a block's brightness keeps all that; since each block tells only how it differs from the last, all that follow are
brighter or darker by as much, which shows along a row of blocks.
"""

import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import ceil
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from calib.core.jit import jit
from calib.images.headers import FRAMES, SOS, DamagedError, jpeg_segments
from designer.base.arrays import Rows

Bytes: TypeAlias = NDArray[np.uint8]
Bits: TypeAlias = NDArray[np.uint64]
Codes: TypeAlias = NDArray[np.uint16]
Whole: TypeAlias = Rows

SOF_PROGRESSIVE, HUFFMAN_FRAMES, DHT, DRI = 0xC2, (0xC0, 0xC1, 0xC2), 0xC4, 0xDD
PEEK = 16
"""Bits of the longest code."""
DC_TABLES = 4
COPY = "copy it again, or take the photo again"

SEAM_SHARE = 0.5
"""Of the pixels along a row of blocks, more that are brighter than those above than darker: of photos at most .45."""
SEAM_GREYS = 2.0
"""A step of fewer of 255 moves no centre."""
SEAM_TIMES = 4.0
"""So many times that of other rows: in a strongly compressed photo every row of blocks is a stair of a slope."""

_TAIL = bytes(4)
"""After the last byte, so that the last codes can be looked up."""


@dataclass(frozen=True)
class _Frame:
    """What a frame's header says."""

    width: int
    height: int
    is_progressive: bool
    sides: Mapping[int, tuple[int, int]]  # columns and rows of blocks of each component in an interleaved unit

    def units(self, numbers: Sequence[int]) -> int:
        """Units of a scan of some components: the blocks that hold pixels of a single one."""
        across, down = max(side for side, _ in self.sides.values()), max(side for _, side in self.sides.values())
        if len(numbers) > 1:
            return ceil(self.width / (8 * across)) * ceil(self.height / (8 * down))
        own_across, own_down = self.sides[numbers[0]]
        return ceil(ceil(self.width * own_across / across) / 8) * ceil(ceil(self.height * own_down / down) / 8)


def brightness_step(pixels: NDArray[np.uint8] | NDArray[np.uint16], unit_rows: int) -> str:
    """What to say of a step in brightness that begins at some block and goes on to the end; "" without one.

    Between the block where it begins and the one below, the upper edge of all blocks is brighter or darker than what
    lies above it, by more than the slope there says: a row's length of them, counted from any block.

    Args:
        pixels: (H, W) grey.
        unit_rows: height of a row of blocks.
    """
    row = np.arange(unit_rows, len(pixels) - 1, unit_rows)
    width = pixels.shape[1]
    if not len(row):
        return ""
    grey = pixels.astype(np.int16)
    step = (grey[row] - grey[row - 1]) - ((grey[row - 1] - grey[row - 2]) + (grey[row + 1] - grey[row])) / 2
    brighter = np.concatenate([[0], np.cumsum(np.sign(step))])
    share = np.abs(brighter[width:] - brighter[:-width]) / width
    start = int(share.argmax())
    size = float(np.median(step.ravel()[start : start + width]))
    usual = float(np.median(np.abs(np.median(step, axis=1))))
    if share[start] < SEAM_SHARE or abs(size) < SEAM_GREYS + SEAM_TIMES * usual:
        return ""
    return (
        f"may be damaged: all is {abs(size):.0f} of 255 {'brighter' if size > 0 else 'darker'} from row "
        f"{row[start // width]}, column {start % width} on; compare it with the camera's own copy"
    )


def check_jpeg_scans(data: bytes) -> int:
    """Read the codes of a JPEG, and stop where they cannot be what an encoder wrote.

    Returns:
        The height of a row of blocks, in pixels.

    Raises:
        DamagedError: there is such a place, or the kind of compression is one that is not read here.
    """
    stream = np.frombuffer(data + _TAIL, np.uint8)
    codes = np.zeros((2 * DC_TABLES, 1 << PEEK), np.uint16)  # the tables of means, then of the other coefficients
    frame, seen, unit_rows, restart_every = None, set[int](), 8, 0
    nonzero: dict[int, Bits] = {}  # of each component: which coefficients of its blocks were read so far
    try:
        for marker, body, after in jpeg_segments(data):
            if marker == DHT:
                _set_codes(codes, body)
            elif marker == DRI:
                (restart_every,) = struct.unpack(">H", body)
            elif marker in FRAMES:
                frame = _frame(marker, body)
            elif marker == SOS:
                if frame is None:
                    raise DamagedError(f"is damaged: pixels before a size; {COPY}")
                seen |= _check_scan(stream, after, frame, codes, restart_every, nonzero, body)
                if body[0] > 1:
                    unit_rows = 8 * max(down for _, down in frame.sides.values())
    except (struct.error, LookupError, ValueError):
        raise DamagedError(f"is damaged: a table of its compression makes no sense; {COPY}") from None
    if frame is None or seen != set(frame.sides):
        raise DamagedError(f"is damaged: a part of its pixels is missing; {COPY}")
    return unit_rows


def _set_codes(codes: Codes, body: bytes) -> None:
    """For every 16 bits the code that they begin with: its length in the high byte, its symbol in the low (annex C)."""
    at = 0
    while at < len(body):
        kind, counts = body[at], body[at + 1 : at + 17]
        symbols = body[at + 17 : at + 17 + sum(counts)]
        if kind & 0x0F >= DC_TABLES or kind >> 4 > 1 or len(symbols) != sum(counts):
            raise LookupError
        lengths = np.repeat(np.arange(1, PEEK + 1), list(counts))
        spans = 1 << (PEEK - lengths)
        if spans.sum() > 1 << PEEK:
            raise LookupError
        row = codes[DC_TABLES * (kind >> 4) + (kind & 0x0F)]
        row[:] = 0
        row[: spans.sum()] = np.repeat(lengths << 8 | np.frombuffer(symbols, np.uint8), spans)
        at += 17 + sum(counts)


def _frame(marker: int, body: bytes) -> _Frame:
    if marker not in HUFFMAN_FRAMES:
        raise DamagedError("is a JPEG without Huffman codes or without loss, which no camera writes; convert it to PNG")
    height, width, count = struct.unpack_from(">xHHB", body)
    sides = {number: (both >> 4, both & 0x0F) for number, both, _ in struct.iter_unpack("3B", body[6 : 6 + 3 * count])}
    if not all(1 <= side <= 4 for both in sides.values() for side in both):
        raise LookupError
    return _Frame(width, height, marker == SOF_PROGRESSIVE, sides)


def _check_scan(
    stream: Bytes, at: int, frame: _Frame, codes: Codes, restart_every: int, nonzero: dict[int, Bits], body: bytes
) -> set[int]:
    """Read a scan's codes; the numbers of the components whose means it holds."""
    count = body[0]
    numbers, chosen = body[1 : 1 + 2 * count : 2], body[2 : 2 + 2 * count : 2]
    first, last, approximation = body[1 + 2 * count : 4 + 2 * count]
    is_table = all(both >> 4 < DC_TABLES and both & 0x0F < DC_TABLES for both in chosen)
    if not is_table or not first <= last <= 63 or (first and count > 1):
        raise LookupError
    units = frame.units(numbers)
    known = np.zeros(1, np.uint64)  # nothing, in all blocks
    if first > 0 and frame.is_progressive:
        known = nonzero.setdefault(numbers[0], np.zeros(units, np.uint64))
    tables: list[tuple[int, int]] = []  # of each block of a unit
    for number, both in zip(numbers, chosen, strict=True):
        across, down = frame.sides[number]
        tables += [(both >> 4, DC_TABLES + (both & 0x0F))] * (across * down if count > 1 else 1)
    clean, ends = _runs_of_codes(stream, at, ceil(units / restart_every) if restart_every else 1)
    read = _read_codes(
        clean, ends, units, restart_every or units, codes, np.array(tables, np.int64), first, last,
        approximation > 15, known,
    )  # fmt: skip
    if read < units:
        part = f"{1000 * read // units / 10:g} %"  # rounded down: nothing is damaged from 100 % on
        raise DamagedError(f"is damaged: its compressed pixels make no sense from {part} of them on; {COPY}")
    return set(numbers) if first == 0 else set()


def _runs_of_codes(stream: Bytes, at: int, count: int) -> tuple[Bytes, Whole]:
    """The bytes of a scan's codes without what only marks them, and where each of its runs between restarts ends."""
    rest = stream[at : -len(_TAIL)]
    full = np.flatnonzero(rest[:-1] == 0xFF)
    after = rest[full + 1]
    is_mark = (after != 0) & (after != 0xFF)
    is_restart = (after & 0xF8) == 0xD0
    others = np.flatnonzero(is_mark & ~is_restart)
    if not len(others):
        raise DamagedError(f"is cut off: its end is missing; {COPY}")
    last = others[0]
    stop, full, after = full[last], full[:last], after[:last]
    restarts = full[is_restart[:last]]
    if not np.array_equal(rest[restarts + 1] & 7, np.arange(len(restarts)) % 8) or len(restarts) != count - 1:
        raise DamagedError(f"is damaged: the marks between its compressed pixels are not in order; {COPY}")
    is_kept = np.ones(stop + 1, bool)
    is_kept[full[after != 0]] = False  # a mark, or a filling before one
    is_kept[full[after != 0xFF] + 1] = False  # the number of a mark, or the zero that tells a byte from one
    is_kept = is_kept[:stop]
    ends = np.cumsum(is_kept)
    runs = np.append(ends[restarts], ends[-1] if stop else 0)
    return np.append(rest[:stop][is_kept], np.frombuffer(_TAIL, np.uint8)), runs.astype(np.int64)


@jit
def _peek(clean: Bytes, at: int) -> int:
    """The next 16 bits."""
    k = at >> 3
    bits = (int(clean[k]) << 16) | (int(clean[k + 1]) << 8) | int(clean[k + 2])
    return (bits >> (8 - (at & 7))) & 0xFFFF


@jit
def _read_codes(
    clean: Bytes, ends: Whole, units: int, restart_every: int, codes: Codes, tables: Whole, first: int, last: int,
    is_refined: bool, nonzero: Bits,
) -> int:  # fmt: skip
    """Read the codes of a scan; the number of units before the first that makes no sense, `units` if all do.

    Args:
        clean: of `_runs_of_codes`.
        ends: likewise.
        units: of the scan.
        restart_every: so many units.
        codes: of all tables.
        tables: (B, 2) rows of these for the mean and the other coefficients of each block of a unit.
        first: coefficient.
        last: coefficient.
        is_refined: the scan has one more bit of what is known (annex G).
        nonzero: of a progressive scan beyond means: bit k of each block, changed here; else one 0.
    """
    at, unit = 0, 0
    for end in ends:
        end_bit, empty = 8 * int(end), 0
        until = min(unit + restart_every, units)
        while unit < until:
            for row in range(tables.shape[0]):
                if at >= end_bit and empty == 0:
                    return unit
                if first == 0 and is_refined:
                    at += 1
                elif first == 0:
                    code = codes[tables[row, 0], _peek(clean, at)]
                    if code == 0 or (code & 0xFF) > 11:
                        return unit
                    at += int(code >> 8) + int(code & 0xFF)
                if last > 0:
                    block = unit % len(nonzero)
                    at, empty = _read_ac(
                        clean, at, end_bit, codes[tables[row, 1]], first, last, is_refined, empty, nonzero, block
                    )
                if not 0 <= at <= end_bit:
                    return unit
            unit += 1
        if empty > 0 or not _is_end(clean, at, end):
            return unit - 1
        at = end_bit
    return unit


@jit
def _is_end(clean: Bytes, at: int, end: int) -> bool:
    """Whether the last block of a run ends where its bytes end."""
    rest = -at & 7  # bits that fill the last byte, ones by the standard
    filling = _peek(clean, at) >> (PEEK - rest)
    if at > 8 * end or (filling != 0 and filling != (1 << rest) - 1):
        return False
    return not clean[(at + 7) >> 3 : end].any()  # some cameras fill up with bytes of zero


@jit
def _read_ac(
    clean: Bytes, at: int, end: int, codes: Codes, first: int, last: int, is_refined: bool, empty: int,
    nonzero: Bits, block: int,
) -> tuple[int, int]:  # fmt: skip
    """Read a block but for its mean; where it ends (-1: no sense), and how many after it are empty."""
    k = max(first, 1)
    while empty == 0 and k <= last:
        if at >= end:
            return -1, 0
        code = codes[_peek(clean, at)]
        zeros, size = int(code >> 4 & 15), int(code & 15)
        if code == 0 or size > (1 if is_refined else 10):
            return -1, 0
        at += int(code >> 8)
        if size == 0 and zeros < 15:
            if zeros > 0 and (first == 0 or at + zeros > end):
                return -1, 0
            empty = (1 << zeros) + (_peek(clean, at) >> (PEEK - zeros))
            at += zeros
            break
        k, bits = _skip_zeros(nonzero[block], k, last, zeros)
        at += size + bits
        if k > last:
            return -1, 0
        if size > 0 and first > 0:
            nonzero[block] |= np.uint64(1) << np.uint64(k)
        k += 1
    if empty > 0:
        at += _skip_zeros(nonzero[block], k, last, 64)[1]
        empty -= 1
    return at, empty


@jit
def _skip_zeros(nonzero: np.uint64, k: int, last: int, zeros: int) -> tuple[int, int]:
    """The coefficient after so many that were zero so far, and how many that were not lie before it: a bit each."""
    if nonzero == 0:
        return k + zeros, 0
    bits = 0
    while k <= last:
        if nonzero >> np.uint64(k) & np.uint64(1):
            bits += 1
        elif zeros == 0:
            break
        else:
            zeros -= 1
        k += 1
    return k, bits
