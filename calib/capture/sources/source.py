"""What a source of frames is, and what it is told."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from calib.capture.messages import SourceKind
from calib.images.photo import Grey


@dataclass(frozen=True, eq=False)
class Frame:
    """One picture, grey, as it came."""

    source: int  # row of the sources
    number: int  # of the frames of that source, from 0
    time_s: float  # since any moment, the same for all cameras of this machine, and for all videos
    pixels: Grey  # (H, W)
    file: Path | None = None  # a person's own photo, which is taken whatever it shows; None: of a video


Put = Callable[[Frame], None]
"""Takes a frame; those that come too fast are passed over for newer ones, but for a person's own photos."""
Say = Callable[[str], None]
"""Takes why nothing comes from a source, in one line; "": it works (again)."""


class Source(Protocol):
    """A camera or a folder, read by a thread of its own."""

    kind: SourceKind
    name: str  # "camera 0"

    def start(self, row: int, put: Put, say: Say) -> None:
        """Begin to read.

        Args:
            row: of the source.
            put: takes each frame.
            say: takes what is wrong.
        """

    def stop(self) -> None:
        """End, and give the camera back."""
