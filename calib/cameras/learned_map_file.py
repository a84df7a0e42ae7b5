"""The learned map in a camera file: plain numbers, one line a field, that read back bit for bit."""

import json
from typing import Annotated

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from calib.cameras.camera import LearnedMap
from calib.cameras.learned import MAX_KNOTS, MAX_LENGTHS
from designer.errors import InputError

FIELDS = ("knot_px", "weight", "noise_variance", "trend", "length_px", "limit")
LARGEST = 1e15
LEAST_NOISE = 1e-12
"""Less leaves the equations of the process singular in floating point."""

Number = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=-LARGEST, le=LARGEST)]
Pairs = Annotated[list[tuple[Number, Number]], Field(min_length=1, max_length=MAX_KNOTS)]
Row = tuple[Number, Number, Number]


class LearnedMapFile(BaseModel):
    """The keys of a learned map."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    knot_px: Pairs
    weight: Pairs
    noise_variance: Annotated[list[Annotated[Number, Field(ge=LEAST_NOISE)]], Field(max_length=MAX_KNOTS)]
    trend: tuple[Row, Row, Row]
    length_px: Annotated[Number, Field(gt=0)]
    limit: Annotated[Number, Field(gt=0, le=1)]


def learned_map_lines(learned: LearnedMap) -> list[str]:
    """The fields as lines of JSON."""
    values = {name: getattr(learned, name) for name in FIELDS}
    plain = {name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in values.items()}
    return [f"{json.dumps(name)}: {json.dumps(value, allow_nan=False)}" for name, value in plain.items()]


def learned_map_from_file(file: LearnedMapFile, image_size: tuple[int, int], origin: str) -> LearnedMap:
    """The map of a file.

    Raises:
        InputError: fields that do not fit each other or the image.
    """
    learned = LearnedMap(
        knot_px=np.array(file.knot_px),
        weight=np.array(file.weight),
        noise_variance=np.array(file.noise_variance),
        trend=np.array(file.trend),
        length_px=file.length_px,
        limit=file.limit,
    )
    counts = {name: len(getattr(learned, name)) for name in ("knot_px", "weight", "noise_variance")}
    if len(set(counts.values())) > 1:
        found = ", ".join(f"{count} of {name}" for name, count in counts.items())
        raise InputError(f"{origin}: learned_map holds {found}; there must be as many of each")
    least = max(image_size) / MAX_LENGTHS
    if learned.length_px < least:
        raise InputError(
            f"{origin}: learned_map.length_px {learned.length_px:g}: must be at least {least:g} in this image"
        )
    if not abs(np.linalg.det(learned.trend)) > 0:
        raise InputError(f"{origin}: learned_map.trend must be a homography, which is invertible")
    return learned
