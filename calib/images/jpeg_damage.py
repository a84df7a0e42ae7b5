"""Whether a JPEG is as it was written: its compressed pixels, and what their decoder made of them.

A JPEG has no check sums. After a flipped bit a decoder reads other codes than were written, falls into step again some
blocks later, and goes on: all that follows lies a block or more from where it was, and the picture looks sound. So the
codes are read here once more, without making pixels of them, and held to what every encoder keeps (ITU-T T.81, annexes
F and G): each code is in its table, no block has more than 64 coefficients, brightness stays in its range, and the
blocks end where the data ends. A bit that changes only a block's brightness keeps all that; since each block tells only
how it differs from the last, all that follow are brighter or darker by as much, which shows along a row of blocks.
"""

import struct
from collections.abc import Mapping
from dataclasses import dataclass, field
from math import ceil
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from calib.core.jit import jit
from calib.images.headers import FRAMES, SOS, DamagedError, jpeg_segments

Bytes: TypeAlias = NDArray[np.uint8]
Whole: TypeAlias = NDArray[np.int64]

SOF_BASELINE, SOF_EXTENDED, SOF_PROGRESSIVE, DHT, DQT, DRI = 0xC0, 0xC1, 0xC2, 0xC4, 0xDB, 0xDD
PEEK = 16
"""Bits of the longest code."""
DC_TABLES = 4
LARGEST_DC = 1300
"""Of 8 times a block's mean, counted from grey: 1024, and a fourth for encoders that let edges ring."""
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
class _Component:
    """A colour of the frame."""

    across: int  # blocks in a unit of an interleaved scan
    down: int
    quantiser: int  # number of its table


@dataclass(frozen=True)
class _Frame:
    """What a frame's header says."""

    width: int
    height: int
    is_progressive: bool
    components: Mapping[int, _Component]

    @property
    def most_across(self) -> int:
        """Columns of blocks in a unit of an interleaved scan."""
        return max(one.across for one in self.components.values())

    @property
    def most_down(self) -> int:
        """Rows of blocks in it."""
        return max(one.down for one in self.components.values())

    def blocks(self, component: _Component) -> int:
        """Blocks that hold pixels, which are the units of a scan of one component."""
        columns = ceil(ceil(self.width * component.across / self.most_across) / 8)
        return columns * ceil(ceil(self.height * component.down / self.most_down) / 8)

    def units(self) -> int:
        """Units of a scan of several components."""
        return ceil(self.width / (8 * self.most_across)) * ceil(self.height / (8 * self.most_down))


@dataclass
class _Tables:
    """What the segments so far have set."""

    codes: NDArray[np.uint16] = field(default_factory=lambda: np.zeros((2 * DC_TABLES, 1 << PEEK), np.uint16))
    quantiser_dc: dict[int, int] = field(default_factory=dict)
    restart_every: int = 0  # units; 0: never
    nonzero: dict[int, NDArray[np.uint64]] = field(default_factory=dict)  # of each component: bit k of each block


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
    """Read all codes of a JPEG, and stop where they cannot be what an encoder wrote.

    Returns:
        The height of a row of blocks, in pixels.

    Raises:
        DamagedError: there is such a place, or the kind of compression is one that is not read here.
    """
    stream = np.frombuffer(data + _TAIL, np.uint8)
    tables, frame, seen, unit_rows = _Tables(), None, set[int](), 8
    try:
        for marker, body, after in jpeg_segments(data):
            if marker == DHT:
                _set_codes(tables, body)
            elif marker == DQT:
                _set_quantisers(tables, body)
            elif marker == DRI:
                (tables.restart_every,) = struct.unpack(">H", body)
            elif marker in FRAMES:
                frame = _frame(marker, body)
            elif marker == SOS:
                if frame is None:
                    raise DamagedError(f"is damaged: pixels before a size; {COPY}")
                seen |= _check_scan(stream, after, frame, tables, body)
                if body[0] > 1:
                    unit_rows = 8 * frame.most_down
    except (struct.error, LookupError, ValueError) as error:
        if isinstance(error, DamagedError):
            raise
        raise DamagedError(f"is damaged: a table of its compression makes no sense; {COPY}") from None
    if frame is None or seen != set(frame.components):
        raise DamagedError(f"is damaged: a part of its pixels is missing; {COPY}")
    return unit_rows


def _set_codes(tables: _Tables, body: bytes) -> None:
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
        row = tables.codes[DC_TABLES * (kind >> 4) + (kind & 0x0F)]
        row[:] = 0
        row[: spans.sum()] = np.repeat(lengths << 8 | np.frombuffer(symbols, np.uint8), spans)
        at += 17 + sum(counts)


def _set_quantisers(tables: _Tables, body: bytes) -> None:
    at = 0
    while at < len(body):
        is_wide, number = body[at] >> 4, body[at] & 0x0F
        tables.quantiser_dc[number] = struct.unpack_from(">H" if is_wide else ">B", body, at + 1)[0]
        at += 1 + (128 if is_wide else 64)


def _frame(marker: int, body: bytes) -> _Frame:
    if marker not in (SOF_BASELINE, SOF_EXTENDED, SOF_PROGRESSIVE):
        raise DamagedError("is a JPEG without Huffman codes or without loss, which no camera writes; convert it to PNG")
    _, height, width, count = struct.unpack_from(">BHHB", body)
    components = {}
    for number, sides, quantiser in struct.iter_unpack("3B", body[6 : 6 + 3 * count]):
        if not (1 <= sides >> 4 <= 4 and 1 <= sides & 0x0F <= 4):
            raise LookupError
        components[number] = _Component(sides >> 4, sides & 0x0F, quantiser)
    return _Frame(width, height, marker == SOF_PROGRESSIVE, components)


def _check_scan(stream: Bytes, at: int, frame: _Frame, tables: _Tables, body: bytes) -> set[int]:
    """Read a scan's codes; the numbers of its components."""
    count = body[0]
    chosen = [(body[1 + 2 * k], body[2 + 2 * k]) for k in range(count)]
    first, last, approximation = body[1 + 2 * count : 4 + 2 * count]
    if not first <= last <= 63 or (first and count > 1):
        raise LookupError
    plan = []  # a row a block of a unit: its component within the scan, its two tables, its quantiser
    for k, (number, chosen_tables) in enumerate(chosen):
        component = frame.components[number]
        blocks = component.across * component.down if count > 1 else 1
        dc, ac = chosen_tables >> 4, DC_TABLES + (chosen_tables & 0x0F)
        plan += [(k, dc, ac, tables.quantiser_dc.get(component.quantiser, 1))] * blocks
    only = chosen[0][0]
    units = frame.blocks(frame.components[only]) if count == 1 else frame.units()
    if count == 1 and frame.is_progressive:
        nonzero = tables.nonzero.setdefault(only, np.zeros(units, np.uint64))
    else:
        nonzero = np.zeros(0, np.uint64)
    clean, ends = _runs_of_codes(stream, at, ceil(units / tables.restart_every) if tables.restart_every else 1)
    read = _read_codes(
        clean, ends, units, tables.restart_every or units, np.array(plan, np.int64), tables.codes, nonzero,
        np.array([first, last, approximation >> 4, approximation & 0x0F, frame.is_progressive], np.int64),
    )  # fmt: skip
    if read < units:
        part = f"{1000 * read // units / 10:g} %"  # rounded down: nothing is damaged from 100 % on
        raise DamagedError(f"is damaged: its compressed pixels make no sense from {part} of them on; {COPY}")
    return {number for number, _ in chosen} if first == 0 else set()


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
    clean: Bytes, ends: Whole, units: int, restart_every: int, plan: Whole, codes: NDArray[np.uint16],
    nonzero: NDArray[np.uint64], scan: Whole,
) -> int:  # fmt: skip
    """Read the codes of a scan; the number of units before the first that makes no sense, `units` if all do.

    `scan`: first and last coefficient, their bits before and below this scan, and whether it is progressive (annex G).
    """
    first, last, before, below = scan[0], scan[1], scan[2], scan[3]
    mean = np.zeros(4, np.int64)
    at, unit = 0, 0
    for end in ends:
        end_bit, bands_left = 8 * int(end), 0
        mean[:] = 0
        until = min(unit + restart_every, units)
        while unit < until:
            for row in range(plan.shape[0]):
                if first == 0:
                    at = _read_dc(clean, at, end_bit, plan[row], codes, mean, before, below)
                    if at < 0:
                        return unit
                if last > 0:
                    at, bands_left = _read_bands(
                        clean, at, end_bit, codes[plan[row, 2]], scan, bands_left, nonzero, unit
                    )
                if at < 0:
                    return unit
            unit += 1
        if bands_left > 0 or not _is_end(clean, at, end):
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
def _read_dc(
    clean: Bytes, at: int, end: int, row: Whole, codes: NDArray[np.uint16], mean: Whole, before: int, below: int
) -> int:
    """Read the mean of a block; where its code ends, -1 if it makes no sense."""
    if at >= end:
        return -1
    if before > 0:
        return at + 1
    code = codes[row[1], _peek(clean, at)]
    size = int(code & 0xFF)
    if code == 0 or size > 11:
        return -1
    at += int(code >> 8)
    if at + size > end:
        return -1
    if size > 0:
        value = _peek(clean, at) >> (PEEK - size)
        if value < 1 << (size - 1):
            value -= (1 << size) - 1
        mean[row[0]] += value
        at += size
    if abs(mean[row[0]] << below) * row[3] > LARGEST_DC + row[3]:
        return -1
    return at


@jit
def _read_bands(
    clean: Bytes, at: int, end: int, codes: NDArray[np.uint16], scan: Whole, bands_left: int,
    nonzero: NDArray[np.uint64], block: int,
) -> tuple[int, int]:  # fmt: skip
    """Read what a scan has of a block beside its mean; where it ends (-1: no sense), and how many empty ones follow."""
    if scan[2] > 0:
        return _refine_ac(clean, at, end, codes, scan[0], scan[1], bands_left, nonzero, block)
    if bands_left > 0:
        return at, bands_left - 1
    return _read_ac(clean, at, end, codes, scan[0], scan[1], scan[4], nonzero, block)


@jit
def _read_ac(
    clean: Bytes, at: int, end: int, codes: NDArray[np.uint16], first: int, last: int, is_progressive: int,
    nonzero: NDArray[np.uint64], block: int,
) -> tuple[int, int]:  # fmt: skip
    """Read the other coefficients of a block; where they end (-1: no sense), and how many blocks after it are empty."""
    k = max(first, 1)
    while k <= last:
        if at >= end:
            return -1, 0
        code = codes[_peek(clean, at)]
        zeros, size = int(code >> 4 & 15), int(code & 15)
        if code == 0 or size > 10:
            return -1, 0
        at += int(code >> 8)
        if size == 0 and zeros < 15:
            if zeros == 0:
                return at, 0
            if not is_progressive or at + zeros > end:
                return -1, 0
            return at + zeros, (1 << zeros) + (_peek(clean, at) >> (PEEK - zeros)) - 1
        k += zeros
        if k > last:
            return -1, 0
        if size > 0 and is_progressive:
            nonzero[block] |= np.uint64(1) << np.uint64(k)
        at += size
        k += 1
    if at > end:
        return -1, 0
    return at, 0


@jit
def _refine_ac(
    clean: Bytes, at: int, end: int, codes: NDArray[np.uint16], first: int, last: int, bands_left: int,
    nonzero: NDArray[np.uint64], block: int,
) -> tuple[int, int]:  # fmt: skip
    """Read one bit more of a block's coefficients (annex G.1.2.3); as `_read_ac`, this block among the empty ones."""
    k = first
    while bands_left == 0 and k <= last:
        if at >= end:
            return -1, 0
        code = codes[_peek(clean, at)]
        zeros, size = int(code >> 4 & 15), int(code & 15)
        if code == 0 or size > 1:
            return -1, 0
        at += int(code >> 8)
        if size == 0 and zeros < 15:
            bands_left = 1 << zeros
            if zeros > 0:
                bands_left += _peek(clean, at) >> (PEEK - zeros)
                at += zeros
            break
        k, bits = _skip_zeros(nonzero[block], k, last, zeros)
        at += size + bits
        if k > last:
            return -1, 0
        if size > 0:
            nonzero[block] |= np.uint64(1) << np.uint64(k)
        k += 1
    if bands_left > 0:
        _, bits = _skip_zeros(nonzero[block], k, last, 64)
        at += bits
        bands_left -= 1
    if at > end:
        return -1, 0
    return at, bands_left


@jit
def _skip_zeros(nonzero: np.uint64, k: int, last: int, zeros: int) -> tuple[int, int]:
    """The coefficient after so many that were zero so far, and how many that were not lie before it: a bit each."""
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
