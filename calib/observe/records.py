"""The records of a detection run: what happened to each photo, and why rings are missing."""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal

from calib.core.types import Detections, FaceRecord
from designer.errors import InputError
from designer.small_file import parse_json, read_small_text

MAX_FILE_BYTES = 256 * 2**20
FORMAT = "ringsolid.records"


@dataclass(frozen=True)
class ImageRecord:
    """What happened to one photo: the target found, not found, or the photo not read."""

    image: str
    image_size: tuple[int, int] | None  # width, height in px; None: it could not be read
    features: int
    rejected: int  # ring-like things that got no name
    faces: tuple[FaceRecord, ...]
    remarks: tuple[str, ...]
    failure: str = ""  # why it could not be read or searched


@dataclass(frozen=True)
class Records:
    """What happened to each photo of a run."""

    detector: str  # program and version
    layout_id: str
    geometry_id: str
    images: tuple[ImageRecord, ...]
    format: Literal["ringsolid.records"] = "ringsolid.records"
    version: Literal[1] = 1
    rendered_id: str = ""  # of the geometry that the photos were rendered of; "": real photos


def image_record(seen: Detections) -> ImageRecord:
    """The record of a photo that was searched."""
    rejected = 0 if seen.rejected_px is None else len(seen.rejected_px)
    return ImageRecord(seen.image, seen.image_size, len(seen.ring), rejected, seen.faces, seen.remarks)


def common_remarks(remarks: Sequence[Sequence[str]]) -> tuple[str, ...]:
    """What is remarked of each of several photos, to be said once."""
    if len(remarks) < 2:
        return ()
    return tuple(remark for remark in dict.fromkeys(remarks[0]) if all(remark in each for each in remarks))


def records_path(detections: Path) -> Path:
    """Where the records of a `NAME.csv` lie: NAME.records.json."""
    return detections.with_suffix(".records.json")


def records_to_json(records: Records) -> bytes:
    """The text of `NAME.records.json`: one line a photo."""
    document = asdict(records)
    images = document.pop("images")
    first = {name: document.pop(name) for name in ("format", "version")}
    head = ",\n".join(f"{json.dumps(name)}: {json.dumps(value)}" for name, value in (first | document).items())
    body = ",\n".join(json.dumps(image) for image in images)
    return f'{{\n{head},\n"images": [\n{body}\n]\n}}\n'.encode()


def read_records(path: Path) -> Records:
    """Read `NAME.records.json`.

    Raises:
        InputError: it cannot be read, or holds no records of this version; the message names it.
    """
    from pydantic import TypeAdapter, ValidationError

    document = parse_json(read_small_text(path, MAX_FILE_BYTES, "a records file"), path, "a records file")
    try:
        return TypeAdapter(Records).validate_python(document)
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(map(str, first["loc"])) or "the document"
        raise InputError(f"{path}: {place}: {first['msg']}; detect again") from None
