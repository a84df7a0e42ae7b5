"""`next_views.json`: the photos to take next, as they stand in the folder of a run."""

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from calib.core.rigid import rigid_fault
from calib.verdict.next_views import NextView
from designer.command import printable
from designer.errors import InputError
from designer.small_file import JsonValue, parse_json, read_small_text
from designer.spec_file import shown

FORMAT = "ringsolid.next_views"
VERSION = 1
NEXT_VIEWS_FILE = "next_views.json"
KIND = "a next_views.json"
MAX_FILE_BYTES = 8 * 2**20
MAX_VIEWS, MAX_LINES, MAX_POINTS, MAX_SENTENCE = 16, 1000, 5000, 500
MAX_PX = 1e7
"""Of a place in the image or a deviation."""

_Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
_Pixel = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=-MAX_PX, le=MAX_PX)]
_Sigma = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0, le=MAX_PX)]
_Share = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0, le=1)]
_Row = tuple[_Number, _Number, _Number, _Number]


class _NextView(BaseModel):
    """The keys of one photo in their order."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    sentence: Annotated[str, Field(min_length=1, max_length=MAX_SENTENCE)]
    sigma_px_before: _Sigma | None
    sigma_px_after: _Sigma
    covered_before: _Share = 0.0
    covered_after: _Share = 0.0
    cam_from_target: tuple[_Row, _Row, _Row, _Row]
    outline_px: Annotated[
        list[Annotated[list[tuple[_Pixel, _Pixel]], Field(min_length=2, max_length=MAX_POINTS)]],
        Field(max_length=MAX_LINES),
    ]


class _Views(BaseModel):
    """The whole file."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    format: Literal["ringsolid.next_views"]
    version: Literal[1]
    views: Annotated[list[_NextView], Field(max_length=MAX_VIEWS)]


def next_views_to_json(views: Sequence[NextView]) -> list[JsonValue]:
    """The views as JSON values; a deviation that is not determined is null, places are to a hundredth of a pixel."""
    return [
        {
            "sentence": view.sentence,
            "sigma_px_before": view.sigma_px_before if math.isfinite(view.sigma_px_before) else None,
            "sigma_px_after": view.sigma_px_after,
            "covered_before": round(view.covered_before, 6),
            "covered_after": round(view.covered_after, 6),
            "cam_from_target": view.cam_from_target.tolist(),
            "outline_px": [[[round(u, 2), round(v, 2)] for u, v in line.tolist()] for line in view.outline_px],
        }
        for view in views
    ]


def next_views_file(views: Sequence[NextView]) -> bytes:
    """The content of `next_views.json`: one line a view."""
    rows = ",\n".join(json.dumps(row, allow_nan=False) for row in next_views_to_json(views))
    return f'{{\n"format": "{FORMAT}",\n"version": {VERSION},\n"views": [\n{rows}\n]\n}}\n'.encode()


def read_next_views(folder: Path) -> tuple[NextView, ...]:
    """The views that a run's folder keeps; none if it keeps no such file.

    Raises:
        InputError: the file is there and cannot be read, or breaks a rule; the message says which.
    """
    path = folder / NEXT_VIEWS_FILE
    if not path.exists():
        return ()
    document = parse_json(read_small_text(path, MAX_FILE_BYTES, KIND), path, KIND)
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise InputError(f'{path}: not the next views of a run: it must hold "format": "{FORMAT}"; run again')
    if type(document.get("version")) is not int or document["version"] != VERSION:
        raise InputError(f"{path}: version {shown(document.get('version'))}; this program reads version {VERSION}")
    try:
        file = _Views.model_validate(document)
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(map(str, first["loc"]))
        raise InputError(f"{path}: {place}: {' '.join(first['msg'].split())}; run again") from None
    poses = np.array([view.cam_from_target for view in file.views], dtype=np.float64).reshape(-1, 4, 4)
    if fault := rigid_fault(poses):
        raise InputError(f"{path}: views.{fault[0]}.cam_from_target {fault[1]}; run again")
    return tuple(_view(view) for view in file.views)


def _view(view: _NextView) -> NextView:
    return NextView(
        np.array(view.cam_from_target, dtype=np.float64),
        printable(view.sentence),
        math.inf if view.sigma_px_before is None else view.sigma_px_before,
        view.sigma_px_after,
        view.covered_before,
        view.covered_after,
        tuple(np.array(line, dtype=np.float64) for line in view.outline_px),
    )
