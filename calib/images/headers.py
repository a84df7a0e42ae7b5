"""What an image file says of itself before a pixel is decoded: format, size, orientation, and whether it is whole.

The formats are told by their first bytes, never by the name. Sizes are read here, and not by a decoder, so that a
small file cannot make a decoder ask for more memory than the machine has; nor by Pillow, which has no depth of 16-bit
colours, says what is odd as warnings of the whole process while photos are read by several threads, and takes files
that are cut off.
"""

import math
import re
import struct
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

Format = Literal["PNG", "JPEG", "TIFF", "BMP", "PNM", "WebP", "HEIC", "raw"]

MAX_SCANS = 200
"""Scans of a progressive JPEG; real ones have about ten, and each one is a pass over the whole picture."""

MAX_PAGES = 100
"""Pages of a TIFF that are counted."""

DIAGONAL_OF_35_MM = math.hypot(36, 24)
EOI, SOS, APP1, APP14 = 0xD9, 0xDA, 0xE1, 0xEE
"""Markers of a JPEG."""
FRAMES = frozenset({*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC})
BARE = frozenset({0x00, 0x01, *range(0xD0, 0xD9)})
"""Markers without a segment."""

_PNM_NUMBER = rb"(?:\s|#[^\n]*\n)+(\d{1,9})(?=\s|#|\Z)"
_PNM_START = re.compile(rb"P([1-6])" + 2 * _PNM_NUMBER + rb"(?:" + _PNM_NUMBER + rb")?")
_PAM_FIELD = re.compile(rb"^(WIDTH|HEIGHT|DEPTH|MAXVAL)[ \t]+(\d{1,9})[ \t]*\r?$", re.MULTILINE)
_PNG_START = b"\x89PNG\r\n\x1a\n"
_PNG_NEEDED = frozenset({b"IHDR", b"PLTE", b"IDAT", b"IEND"})
_OTHER_FORMATS: tuple[tuple[int, bytes, str], ...] = (
    (4, b"ftypavif", "an AVIF"), (0, b"GIF8", "a GIF"), (4, b"jP  ", "a JPEG 2000"),
    (0, b"\xff\x4f\xff\x51", "a JPEG 2000"), (0, b"v/1\x01", "an OpenEXR"), (0, b"%PDF", "a PDF"),
    (0, b"8BPS", "a Photoshop"), (0, b"Pf", "a float PFM"), (0, b"PF", "a float PFM"), (0, b"\xff\x0a", "a JPEG XL"),
    (0, b"II+\0", "a BigTIFF"), (0, b"MM\0+", "a BigTIFF"),
)  # fmt: skip


class DamagedError(Exception):
    """The file is no image that can be read, or not all of it is there. The message ends in the remedy."""


@dataclass(frozen=True)
class Exif:
    """What a camera noted in its photo."""

    orientation: int = 1  # 1 is as the sensor saw it
    focal_in_35_mm: int = 0  # focal length of a camera of 36 x 24 mm with the same diagonal field of view; 0: not known
    upright: tuple[int, bytes] = (0, b"")  # where the orientation stands, and the bytes of "1"


@dataclass(frozen=True)
class Header:
    """What is known of an image before it is decoded."""

    format: Format
    width: int  # px; 0 of a raw photo, as its decoder says it
    height: int  # px; likewise
    exif: Exif = Exif()
    page_count: int = 1
    pixel_bytes: int = 1  # as decoded
    is_white_zero: bool = False  # TIFF: the smallest number is white


def read_header(data: bytes) -> Header:
    """The header of an image file.

    Raises:
        DamagedError: not one of the formats, or cut off, or its header breaks the format's rules.
    """
    for at, magic, name in _OTHER_FORMATS:
        if data.startswith(magic, at):
            raise DamagedError(f"is {name} file; convert it to PNG or TIFF without changing its size")
    reader = next((reader for at, magic, reader in _READERS if data.startswith(magic, at)), None)
    if reader is None:
        raise DamagedError("is not an image in a known format; give PNG, JPEG, TIFF, WebP, BMP or PGM, HEIC or raw")
    try:
        header = reader(data)
    except (struct.error, LookupError, ValueError, OverflowError):
        raise DamagedError("its header is damaged or cut off; copy it again") from None
    if (header.width < 1 or header.height < 1) and header.format != "raw":
        raise DamagedError(f"its header gives a size of {header.width} x {header.height} px; copy it again")
    return header


def needed_png(data: bytes) -> bytes:
    """The file without chunks that say nothing of the pixels: profiles, gamma, transparency of a colour, animation.

    Raises:
        DamagedError: a chunk is cut off or its check sum is wrong.
    """
    kept = [chunk for name, chunk in _png_chunks(memoryview(data)) if name in _PNG_NEEDED]
    return data if sum(map(len, kept)) + len(_PNG_START) == len(data) else b"".join([_PNG_START, *kept])


def _png_chunks(data: memoryview) -> Iterator[tuple[bytes, memoryview]]:
    """Name and whole text of each chunk up to IEND (PNG specification, section 5)."""
    at, name = len(_PNG_START), b""
    while name != b"IEND":
        if at + 12 > len(data):
            raise DamagedError("is cut off: its end is missing; copy it again")
        (length,) = struct.unpack_from(">I", data, at)
        end = at + 12 + length
        if end > len(data):
            raise DamagedError("is cut off: its end is missing; copy it again")
        name = bytes(data[at + 4 : at + 8])
        if name in _PNG_NEEDED and zlib.crc32(data[at + 4 : end - 4]) != struct.unpack_from(">I", data, end - 4)[0]:
            raise DamagedError("is damaged: a check sum is wrong; copy it again")
        yield name, data[at:end]
        at = end


def _png_header(data: bytes) -> Header:
    if data[12:16] != b"IHDR":
        raise DamagedError("its header is damaged or cut off; copy it again")
    width, height = struct.unpack_from(">II", data, 16)
    depth, colour = struct.unpack_from("BB", data, 24)
    pixel_bytes = {2: 3, 3: 3, 4: 4, 6: 4}.get(colour, 1) * (2 if depth == 16 else 1)
    # The block may stand before the pixels or after them.
    noted = [bytes(chunk[8:-4]) for name, chunk in _png_chunks(memoryview(data)) if name == b"eXIf"]
    return Header("PNG", width, height, _exif(noted[-1]) if noted else Exif(), pixel_bytes=pixel_bytes)


def jpeg_segments(data: bytes) -> Iterator[tuple[int, bytes, int]]:
    """Marker and body of each segment up to the end of the image, and where what follows it begins (T.81, annex B)."""
    at, is_in_scan = 2, False
    while True:
        start = data.index(0xFF, at)
        if start != at and not is_in_scan:
            raise DamagedError("its header is damaged; copy it again")
        at = start
        while data[at] == 0xFF:
            at += 1
        marker = data[at]
        at += 1
        if marker == EOI:
            return
        if marker in BARE:  # among them what stands in the compressed pixels of a scan
            continue
        is_in_scan = marker == SOS
        (length,) = struct.unpack_from(">H", data, at)
        yield marker, data[at + 2 : at + length], at + length
        at += length


def _jpeg_header(data: bytes) -> Header:
    """What the segments up to the first scan say; refused is what decoders take without a word."""
    exif, is_adobe = Exif(), False
    frame: tuple[int, int, int, int] | None = None  # marker, height, width, components
    for marker, body, after in jpeg_segments(data):
        if marker == APP1 and body.startswith(b"Exif\0\0"):
            exif = _exif(body[6:])
        is_adobe |= marker == APP14 and body.startswith(b"Adobe")
        if marker in FRAMES:
            depth, *size = struct.unpack_from(">BHHB", body)
            if depth != 8:
                raise DamagedError(f"is a JPEG of {depth} bits; convert it to a 16-bit PNG or TIFF")
            frame = marker, *size
        if marker != SOS:
            continue
        if frame is None:
            raise DamagedError("has no size before its pixels; copy it again")
        kind, height, width, components = frame
        if data.rfind(b"\xff\xd9", after) < 0:
            raise DamagedError("is cut off: its end is missing; copy it again")
        if (kind not in {0xC0, 0xC1} or body[0] < components) and data.count(b"\xff\xda", after) > MAX_SCANS:
            raise DamagedError(f"has more than {MAX_SCANS} scans, which no camera writes; convert it to PNG")
        if components == 4 and not is_adobe:
            raise DamagedError("is a four-colour JPEG that does not say whether 0 is ink or paper; convert it to RGB")
        return Header("JPEG", width, height, exif)
    raise DamagedError("is cut off before its first pixel; copy it again")


def _bmp_header(data: bytes) -> Header:
    (size,) = struct.unpack_from("<I", data, 14)
    width, height = struct.unpack_from("<HH" if size == 12 else "<ii", data, 18)
    return Header("BMP", width, abs(height), pixel_bytes=4)


def _pnm_header(data: bytes) -> Header:
    """Numbers in text after the magic, with comments; P7 has names before them (netpbm's manual pages)."""
    text, bitmaps, colours = data[:4096], b"14", b"36"
    if data.startswith(b"P7"):
        named = dict(_PAM_FIELD.findall(text.split(b"ENDHDR")[0]))
        width, height, depth, most = (int(named[name]) for name in (b"WIDTH", b"HEIGHT", b"DEPTH", b"MAXVAL"))
        return Header("PNM", width, height, pixel_bytes=depth * (1 if most < 256 else 2))
    found = _PNM_START.match(text)
    if found is None or (found[4] is None and found[1] not in bitmaps):
        raise DamagedError("its header is damaged; copy it again")
    deep = 1 if found[1] in bitmaps or int(found[4]) < 256 else 2
    return Header("PNM", int(found[2]), int(found[3]), pixel_bytes=deep * (3 if found[1] in colours else 1))


def _tiff_header(data: bytes) -> Header:
    """The first directory (TIFF 6.0, section 2), and how many follow it."""
    tags, order, following = _directory(data, struct.unpack_from(_byte_order(data) + "I", data, 4)[0])
    value = {tag: entry[0] for tag, entry in tags.items()}
    photometric = value.get(262, 1)
    if 50706 in tags or value.get(254, 0) & 1 or photometric in {32803, 34892}:
        return Header("raw", 0, 0)
    if value.get(339, 1) != 1 or value.get(258, 1) > 16:
        kind = {2: "signed numbers", 3: "floating-point numbers"}.get(value.get(339, 1), "numbers of more than 16 bits")
        raise DamagedError(f"holds {kind}; convert it to 8 or 16 bits without sign")
    pages, seen = 1, set[int]()
    while following and following not in seen and pages < MAX_PAGES:
        seen.add(following)
        try:
            (count,) = struct.unpack_from(order + "H", data, following)
            (following,) = struct.unpack_from(order + "I", data, following + 2 + 12 * count)
        except struct.error:
            raise DamagedError("is cut off: a page is missing; copy it again") from None
        pages += 1
    pixel_bytes = max(1, min(value.get(277, 1), 4)) * (2 if value.get(258, 1) > 8 else 1)
    return Header("TIFF", value[256], value[257], _exif(data), pages, pixel_bytes, photometric == 0)


def _byte_order(data: bytes) -> str:
    return "<" if data.startswith(b"II") else ">"


def _directory(data: bytes, at: int) -> tuple[dict[int, tuple[int, int]], str, int]:
    """The tags of a TIFF directory with their first value and its place; the byte order; the next directory's place.

    Values of other types than whole numbers are 0.
    """
    order = _byte_order(data)
    (count,) = struct.unpack_from(order + "H", data, at)
    tags = {}
    for k in range(count):
        tag, kind, length = struct.unpack_from(order + "HHI", data, at + 2 + 12 * k)
        letter = {1: "B", 3: "H", 4: "I"}.get(kind)
        place = at + 10 + 12 * k
        if letter is not None and length * struct.calcsize(letter) > 4:
            (place,) = struct.unpack_from(order + "I", data, place)
        tags[tag] = (struct.unpack_from(order + letter, data, place)[0] if letter and length else 0, place)
    return tags, order, struct.unpack_from(order + "I", data, at + 2 + 12 * count)[0]


def _exif(block: bytes) -> Exif:
    """What a camera noted in a TIFF, or in an EXIF block, which is one; nothing where that cannot be read."""
    try:
        tags, order, _ = _directory(block, struct.unpack_from(_byte_order(block) + "I", block, 4)[0])
        orientation, at = tags.get(274, (1, 0))
        inner = _directory(block, tags[0x8769][0])[0] if 0x8769 in tags else {}
    except struct.error:
        return Exif()
    focal = inner.get(0xA405, (0, 0))[0]
    return Exif(orientation if 1 <= orientation <= 8 else 1, focal, (at, struct.pack(order + "H", 1)))


def exif_focal_px(path: Path) -> float | None:
    """A first guess of the focal length in pixels, or None if the photo does not say.

    The tag `FocalLengthIn35mmFilm` compares diagonals, is rounded to whole millimetres, and knows of no crop.
    """
    try:
        header = read_header(path.read_bytes())
    except (OSError, ValueError, DamagedError):
        return None  # a photo may hold anything; the solver needs no guess
    focal_mm = header.exif.focal_in_35_mm
    if not (1 <= focal_mm <= 5000 and header.width):
        return None
    return focal_mm / DIAGONAL_OF_35_MM * math.hypot(header.width, header.height)


def _webp_header(data: bytes) -> Header:
    """RFC 9649: the first chunk's size is that of the picture, in one of three ways."""
    name, (size,) = data[12:16], struct.unpack_from("<I", data, 4)
    if size + 8 > len(data):
        raise DamagedError("is cut off: its end is missing; copy it again")
    if name == b"VP8X":
        if data[20] & 2:
            raise DamagedError("is an animation; give photos")
        width, height = (1 + int.from_bytes(data[at : at + 3], "little") for at in (24, 27))
    elif name == b"VP8L":
        (bits,) = struct.unpack_from("<I", data, 21)
        width, height = 1 + (bits & 0x3FFF), 1 + (bits >> 14 & 0x3FFF)
    else:
        width, height = (side & 0x3FFF for side in struct.unpack_from("<HH", data, 26))
    return Header("WebP", width, height, _exif_within(data, data.find(b"EXIF")), pixel_bytes=4)


HEIC_TURN = b"\0\0\0\x09irot"
"""The box of a HEIC file that says by how many quarters it is turned against the clock, in the byte that follows."""
_HEIC_SIZE = b"\0\0\0\x14ispe"
_ORIENTATION_OF_TURN = (1, 8, 3, 6)


def _heic_header(data: bytes) -> Header:
    """The largest of its pictures, which are its tiles, the photo and a thumbnail (ISO/IEC 23008-12)."""
    sizes = [struct.unpack_from(">II", data, found.end() + 4) for found in re.finditer(re.escape(_HEIC_SIZE), data)]
    width, height = max(sizes, key=lambda size: size[0] * size[1])
    turn = data.find(HEIC_TURN)
    noted = _exif_within(data, data.find(b"Exif\0\0"))
    orientation = _ORIENTATION_OF_TURN[data[turn + len(HEIC_TURN)] & 3] if turn >= 0 else 1
    return Header("HEIC", width, height, replace(noted, orientation=orientation), pixel_bytes=6)


def _exif_within(data: bytes, at: int) -> Exif:
    """What a camera noted in the block that begins after a word."""
    starts = [place for start in (b"II*\0", b"MM\0*") if 0 <= (place := data.find(start, max(at, 0))) < at + 32]
    return _exif(data[min(starts) :]) if at >= 0 and starts else Exif()


def _raw_header(_: bytes) -> Header:
    return Header("raw", 0, 0)


_READERS: tuple[tuple[int, bytes, Callable[[bytes], Header]], ...] = (
    (0, _PNG_START, _png_header), (0, b"\xff\xd8\xff", _jpeg_header), (8, b"CR\x02\x00", _raw_header),
    (0, b"II*\0", _tiff_header), (0, b"MM\0*", _tiff_header), (0, b"BM", _bmp_header), (8, b"WEBP", _webp_header),
    *((0, b"P%d" % digit, _pnm_header) for digit in range(1, 8)), (4, b"ftyphei", _heic_header),
    (4, b"ftyphev", _heic_header), (4, b"ftypmif1", _heic_header), (4, b"ftypcrx", _raw_header),
    (0, b"FUJIFILM", _raw_header), (0, b"IIRO", _raw_header), (0, b"IIRS", _raw_header), (0, b"IIU\x00", _raw_header),
)  # fmt: skip
"""How a file of a format begins: where, with what."""
