"""What page and server say to each other over one WebSocket.

A text message is JSON with a `kind`. A binary one carries an image: four bytes, little-endian, for the length of a JSON
header, the header, and the bytes of the image.

    page -> server   binary: `FrameHeader` and its grey levels, one byte a pixel, row by row
                     text:   `PageCommand`
    server -> page   text:   `StateMessage`, `GuidanceMessage`, `LookMessage`, `TakenMessage`, `NoticeMessage`
                     binary: `FrameHeader` and a JPEG of what another source sees

A page that uses the browser's camera sends its next frame when the look at the last one has come, or after a second.
The frame that was looked at is the one that is kept: nothing is taken again. A page that another one took over from
is told so by its last state, before its socket is closed. The page's addresses are in `calib.capture.server`.
"""

import json
from dataclasses import dataclass
from typing import Literal, cast

from calib.judge.guidance import Guidance, Look, TakenPhoto
from calib.judge.target_hints import Line
from designer.base.codec import decode, encode
from designer.base.files import JsonValue

MOST_HEADER_BYTES = 1000

SourceKind = Literal["browser", "camera", "folder"]
Phase = Literal["taking", "ending", "solving", "done", "failed"]
"""Photos are taken; they suffice, and it ends in a moment; the whole run is made; its report is there; it has none."""
CommandKind = Literal["take", "delete", "restore", "skip", "finish", "more", "automatic", "by_hand", "source", "bye"]


@dataclass(frozen=True)
class FrameHeader:
    """Of an image that is sent."""

    source: int  # row of the sources
    number: int  # of the frames of that source, from 0
    time_s: float  # since any moment, the same for all frames of a source
    width: int
    height: int


@dataclass(frozen=True)
class PageCommand:
    """What a person does, or the browser's camera."""

    kind: CommandKind
    name: str = ""  # of the photo to delete or to restore; of `source`: "", or why there is no camera any more


@dataclass(frozen=True)
class SourceState:
    """One camera, or folder."""

    kind: SourceKind
    name: str  # "camera 0"
    fault: str  # why nothing comes from it, in a line that names it; "" if it works


@dataclass(frozen=True)
class StateMessage:
    """Where the session is; sent at first, and whenever it changes."""

    phase: Phase
    target: str  # what is photographed, "icosahedron, edge 60 mm, 420 rings"
    folder: str  # where photos are written, by its name
    sources: tuple[SourceState, ...]
    is_automatic: bool
    is_here: bool  # this page has the session; another one took it over otherwise
    ends_in_s: float | None  # of phase "ending"
    said: str  # of "solving": what is done; of "done" and "failed": what came of it


@dataclass(frozen=True, eq=False)
class GuidanceMessage:
    """After each photo, and each that was deleted."""

    guidance: Guidance
    scene: str  # the target for the 3D view as designer/page/scene.py has it, JSON; "" if it was sent before
    left_out: tuple[TakenPhoto, ...]  # deleted photos, which can be restored


@dataclass(frozen=True, eq=False)
class LookMessage:
    """Of one frame."""

    source: int
    number: int
    rings_px: tuple[Line, ...]  # one (N, 3) of named rings: u, v, radius
    labels: tuple[tuple[float, float, str], ...]  # of faces: u, v, what they are called
    look: Look
    still: float  # how long it has stood still, of how long it is to: 0 to 1


@dataclass(frozen=True)
class TakenMessage:
    """A photo was written; a guidance follows."""

    name: str
    by_itself: bool


@dataclass(frozen=True)
class NoticeMessage:
    """A line to be shown for a while."""

    said: str
    is_fault: bool


Message = StateMessage | GuidanceMessage | LookMessage | TakenMessage | NoticeMessage


def text_of(message: Message) -> str:
    """A message as text: `{"kind": "look", "source": 0, ...}`, of a `LookMessage`."""
    kind = type(message).__name__.removesuffix("Message").lower()
    fields = cast("dict[str, JsonValue]", encode(type(message), message))
    return json.dumps({"kind": kind, **fields}, allow_nan=False)


def command_from(text: str) -> PageCommand:
    """What the page says; ValueError: it is no command."""
    return decode(PageCommand, cast("JsonValue", json.loads(text)))


def with_header(header: FrameHeader, image: bytes) -> bytes:
    """A binary message."""
    head = json.dumps(encode(FrameHeader, header)).encode()
    return len(head).to_bytes(4, "little") + head + image


def header_of(data: bytes) -> tuple[FrameHeader, memoryview]:
    """A binary message's header, and its image; ValueError: it is none."""
    length = int.from_bytes(data[:4], "little")
    if not 0 < length <= min(MOST_HEADER_BYTES, len(data) - 4):
        raise ValueError("a binary message without a header")
    header = decode(FrameHeader, cast("JsonValue", json.loads(data[4 : 4 + length])))
    return header, memoryview(data)[4 + length :]
