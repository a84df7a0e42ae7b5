"""Dictionaries of square markers, by the names that OpenCV has for them: `dictionary_named("5x5_100")`."""

from collections.abc import Mapping
from functools import cache

import numpy as np
from numpy.typing import NDArray

from designer.base.arrays import Array
from designer.base.words import suggestion_or_all
from designer.marks.face_marks import black_cells_mm

MARKERS: Mapping[str, int] = {
    **{f"DICT_{n}X{n}_{count}": count for n in (4, 5, 6, 7) for count in (50, 100, 250, 1000)},
    "DICT_ARUCO_ORIGINAL": 1024, "DICT_ARUCO_MIP_36h12": 250, "DICT_APRILTAG_16h5": 30, "DICT_APRILTAG_25h9": 35,
    "DICT_APRILTAG_36h10": 2320, "DICT_APRILTAG_36h11": 587,
}  # fmt: skip
"""How many markers each holds."""
TAG_TURN = "DICT_APRILTAG_"
"""Of these dictionaries OpenCV draws markers turned by half a turn against those who print them (AprilTag, Kalibr)."""


def dictionary_named(name: str) -> str:
    """OpenCV's name of a dictionary, in whatever letters it is written, with or without what they all begin with.

    Raises:
        ValueError: there is none of this name.
    """
    word = name.strip().upper().replace("-", "_")
    word = {"APRILTAG": "APRILTAG_36H11", "ARUCO": "ARUCO_ORIGINAL"}.get(word, word)
    for prefix in ("", "DICT_", "DICT_APRILTAG_", "DICT_ARUCO_"):
        for one in MARKERS:
            if one.upper() == prefix + word or one.upper() == prefix + word.removeprefix("T").removeprefix("TAG"):
                return one
    raise ValueError(f"dictionary {name!r} is unknown{suggestion_or_all(name, MARKERS)}")


def family_of(dictionary: str) -> str:
    """Dictionaries of one family begin with the same markers: that of `DICT_5X5_100` is `DICT_5X5`."""
    stem, _, ending = dictionary.rpartition("_")
    return stem if ending.isdigit() else dictionary


def check_markers(dictionary: str, first_id: int, count: int) -> None:
    """Refuse a dictionary that is none, or holds less than the markers from an id on.

    Raises:
        ValueError: which rule is broken.
    """
    if dictionary not in MARKERS:
        raise ValueError(f"dictionary {dictionary!r} is unknown{suggestion_or_all(dictionary, MARKERS)}")
    if first_id < 0:
        raise ValueError(f"first id {first_id}: ids count from 0")
    if first_id + count > (most := MARKERS[dictionary]):
        stem = dictionary.rpartition("_")[0]
        larger = [one for one, n in MARKERS.items() if n >= first_id + count and one.startswith(stem)]
        raise ValueError(
            f"{count} markers from id {first_id} on are more than the {most} of {dictionary}"
            f"{f'; use {larger[0]}' if larger else '; use a larger dictionary, or fewer markers'}"
        )


def marker_mm(black: NDArray[np.bool_], corner: Array, side: float) -> list[Array]:
    """What is black of a marker whose lower left corner (2,) and side are given, in few rectangles."""
    lines = np.linspace(0, side, len(black) + 1)
    return black_cells_mm(black, corner[0] + lines, corner[1] + lines)


@cache
def marker_cells(dictionary: str, number: int, border_bits: int = 1) -> NDArray[np.bool_]:
    """Which cells of a marker are black, from its upper left one, as OpenCV draws it.  # (N, N)"""
    import cv2

    known = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, dictionary))
    side = known.markerSize + 2 * border_bits
    black: NDArray[np.bool_] = np.asarray(cv2.aruco.generateImageMarker(known, number, side, None, border_bits)) == 0
    black.setflags(write=False)
    return black
