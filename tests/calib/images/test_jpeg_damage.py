"""Damaged JPEGs: refused or marked, never measured as sound; sound ones are never doubted."""

import re
from itertools import product
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from calib.images.headers import DamagedError
from calib.images.jpeg_damage import SEAM_GREYS, check_jpeg_scans
from calib.images.photo import read_image
from designer.base.errors import InputError

Picture = NDArray[np.uint8]
RNG = np.random.default_rng(7)
ROWS, COLUMNS = np.mgrid[:240, :328]
RINGS = 128 + 90 * np.sign(np.sin(ROWS / 9) * np.cos(COLUMNS / 11)) * np.minimum(1, np.abs(np.sin(ROWS / 9)) * 3)
GREY = np.clip(cv2.GaussianBlur(RINGS, (0, 0), 1) + RNG.normal(0, 3, RINGS.shape), 0, 255).astype(np.uint8)
COLOUR = np.dstack([GREY, GREY[::-1], GREY[:, ::-1]])

QUALITY, PROGRESSIVE, RESTART, SAMPLING = (
    cv2.IMWRITE_JPEG_QUALITY, cv2.IMWRITE_JPEG_PROGRESSIVE, cv2.IMWRITE_JPEG_RST_INTERVAL,
    cv2.IMWRITE_JPEG_SAMPLING_FACTOR,
)  # fmt: skip
KINDS = {
    "grey": (GREY, (QUALITY, 95)),
    "coarse": (GREY, (QUALITY, 60)),
    "colour, 4:2:0": (COLOUR, (QUALITY, 90, SAMPLING, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_420)),
    "restarts": (GREY, (QUALITY, 90, RESTART, 41)),
    "progressive": (COLOUR, (QUALITY, 90, PROGRESSIVE, 1)),
}


def jpeg(picture: Picture, options: tuple[int, ...]) -> bytes:
    """A file as OpenCV writes it."""
    done, data = cv2.imencode(".jpg", picture, options)
    assert done
    return data.tobytes()


def flipped(data: bytes, rng: np.random.Generator) -> bytes:
    """The file with one bit of its compressed pixels changed."""
    start = data.index(b"\xff\xda")
    at = int(rng.integers(start + 2 + int.from_bytes(data[start + 2 : start + 4]), len(data) - 2))
    return data[:at] + bytes([data[at] ^ 1 << int(rng.integers(8))]) + data[at + 1 :]


@pytest.mark.parametrize("kind", KINDS)
def test_a_flipped_bit_shows_or_stays_in_its_row(kind: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """It is refused by name, or marked, or what follows has not moved: a row changed at most, or all is a bit brighter.

    No line of a decoder, which names no file, reaches standard error.
    """
    sound = jpeg(*KINDS[kind])
    pixels = cv2.imdecode(np.frombuffer(sound, np.uint8), cv2.IMREAD_GRAYSCALE).astype(np.int16)
    rng, refused = np.random.default_rng(1), 0
    for number in range(25):
        path = tmp_path / f"{number}.jpg"
        path.write_bytes(flipped(sound, rng))
        try:
            photo = read_image(path)
        except InputError as error:
            refused += str(error).startswith(f"{path}: ")
            continue
        if any("may be damaged" in remark for remark in photo.remarks):
            continue
        off = np.abs(photo.pixels.astype(np.int16) - pixels)
        blocks = np.median(off.reshape(30, 8, 41, 8), axis=(1, 3))
        changed = np.flatnonzero(blocks > 3 * SEAM_GREYS)
        assert len(changed) == 0 or np.ptp(changed) <= 41, number
    assert refused >= 3
    assert capfd.readouterr().err == ""


def test_sound_files_of_all_kinds_are_read() -> None:
    """Any quality, sampling, order of scans and restarts, of smooth, noisy, black and white pictures."""
    noise = RNG.integers(0, 256, (50, 67, 3), dtype=np.uint8)
    white = np.full((40, 40, 3), 255, np.uint8)
    samplings = (0x111111, 0x211111, 0x121111, 0x221111, 0x411111)
    for picture, quality, progressive, restart in product((noise, white, COLOUR), (1, 100), (0, 1), (0, 7)):
        options = (QUALITY, quality, PROGRESSIVE, progressive, RESTART, restart)
        check_jpeg_scans(jpeg(np.ascontiguousarray(picture[:, :, 0]), options))
        for sampling in samplings:
            rows = check_jpeg_scans(jpeg(picture, (*options, SAMPLING, sampling)))
            assert rows == 8 * (sampling >> 16 & 15)


@pytest.mark.parametrize("quality", [20, 60, 95])
def test_slopes_and_edges_are_no_damage(quality: int, tmp_path: Path) -> None:
    """A strongly compressed slope, which decodes as stairs, and a border across the picture are not doubted."""
    slope = (ROWS * 0.9 + 20).astype(np.uint8)
    for number, picture in enumerate((slope, np.where(ROWS + COLUMNS // 40 > 120, GREY, GREY // 3), COLOUR)):
        path = tmp_path / f"{number}.jpg"
        path.write_bytes(jpeg(picture, (QUALITY, quality)))
        assert read_image(path).remarks == ()


def test_a_step_in_brightness_is_named(tmp_path: Path) -> None:
    """Where all blocks from one on are brighter, the remark says from which row and column."""
    picture = GREY.astype(np.int16).reshape(-1, 8, GREY.shape[1])
    picture[16:] += 12
    picture[15, :, 160:] += 12  # of 30 rows of blocks
    path = tmp_path / "a.jpg"
    path.write_bytes(jpeg(np.clip(picture, 0, 255).astype(np.uint8).reshape(GREY.shape), (QUALITY, 95)))
    (remark,) = read_image(path).remarks
    assert re.match(r"may be damaged: all is 1[1-3] of 255 brighter from row 120, column 1[56]\d on; ", remark)


def test_a_scan_that_names_a_table_there_cannot_be_is_refused() -> None:
    """A damaged choice of tables is said, and no memory is read where none is."""
    data = bytearray(jpeg(GREY, (QUALITY, 90)))
    data[data.index(b"\xff\xda") + 6] = 0xF0
    with pytest.raises(DamagedError, match="a table of its compression makes no sense"):
        check_jpeg_scans(bytes(data))
