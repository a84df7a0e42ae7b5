"""HEIC, WebP and raw photos: what their decoders give, as the sensor saw it, or a line."""

import io
import struct
from pathlib import Path

import numpy as np
import pillow_heif
import pytest
from numpy.typing import NDArray
from PIL import Image

from calib.images.photo import Photo, read_image
from calib.observe.photos import images_in, not_read_in
from designer.base.errors import InputError

ROWS, COLUMNS = np.mgrid[0:96, 0:128]
GREY = (128 + 90 * np.sin(COLUMNS / 9.0) * np.cos(ROWS / 13.0)).astype(np.uint8)
COLOUR = np.stack([GREY, GREY, GREY], axis=2)


def heic(pixels: NDArray[np.uint8], turn: int = 0) -> bytes:
    """A HEIC file, turned by quarters against the clock when it is viewed."""
    stream = io.BytesIO()
    pillow_heif.from_bytes("RGB", pixels.shape[1::-1], pixels.tobytes()).save(stream, quality=95)
    data = stream.getvalue()
    if not turn:
        return data
    exif = Image.Exif()
    exif[274] = {1: 8, 2: 3, 3: 6}[turn]  # written as a turn of the picture
    stream = io.BytesIO()
    image = pillow_heif.from_bytes("RGB", pixels.shape[1::-1], pixels.tobytes())
    image.info["exif"] = exif.tobytes()
    image.save(stream, quality=95)
    return stream.getvalue()


def webp(pixels: NDArray[np.uint8], **options: object) -> bytes:
    """A WebP file."""
    stream = io.BytesIO()
    Image.fromarray(pixels).save(stream, "WEBP", **options)
    return stream.getvalue()


def dng(level: NDArray[np.uint16], *, black: int, white: int, pattern: bytes = b"\0\1\1\2", **tags: int) -> bytes:
    """An uncompressed DNG of a Bayer mosaic (Adobe's specification 1.4)."""
    height, width = level.shape
    matrix = struct.pack("<18i", *(n for one in np.eye(3).ravel() for n in (int(one), 1)))
    entries: list[tuple[int, int, int, bytes]] = [
        (254, 4, 1, struct.pack("<I", 0)), (256, 4, 1, struct.pack("<I", width)),
        (257, 4, 1, struct.pack("<I", height)), (258, 3, 1, struct.pack("<HH", 16, 0)),
        (259, 3, 1, struct.pack("<HH", 1, 0)), (262, 3, 1, struct.pack("<HH", 32803, 0)), (271, 2, 4, b"abc\0"),
        (272, 2, 4, b"def\0"), (273, 4, 1, b"DATA"), (274, 3, 1, struct.pack("<HH", tags.get("turn", 1), 0)),
        (277, 3, 1, struct.pack("<HH", 1, 0)), (278, 4, 1, struct.pack("<I", height)),
        (279, 4, 1, struct.pack("<I", level.nbytes)), (33421, 3, 2, struct.pack("<HH", 2, 2)), (33422, 1, 4, pattern),
        (50706, 1, 4, b"\1\4\0\0"), (50707, 1, 4, b"\1\1\0\0"), (50708, 2, 4, b"xyz\0"),
        (50714, 3, 1, struct.pack("<HH", black, 0)), (50717, 3, 1, struct.pack("<HH", white, 0)),
        (50721, 10, 9, matrix), (50778, 3, 1, struct.pack("<HH", 21, 0)),
    ]  # fmt: skip
    at, extra, body = 8 + 2 + 12 * len(entries) + 4, b"", b""
    start = at + len(matrix)
    for tag, kind, count, value in entries:
        here = value
        if len(value) > 4:
            here, extra = struct.pack("<I", at + len(extra)), extra + value
        body += struct.pack("<HHI", tag, kind, count) + (struct.pack("<I", start) if value == b"DATA" else here)
    return b"II*\0" + struct.pack("<IH", 8, len(entries)) + body + bytes(4) + extra + level.astype("<u2").tobytes()


def read(folder: Path, name: str, data: bytes) -> Photo:
    """What is read of a file of such content."""
    (folder / name).write_bytes(data)
    return read_image(folder / name)


@pytest.mark.parametrize("turn", [0, 1, 2, 3])
def test_heic_is_read_as_the_sensor_saw_it(turn: int, tmp_path: Path) -> None:
    """Whatever viewers turn it by, which is said as of a JPEG."""
    photo = read(tmp_path, "a.heic", heic(COLOUR, turn))
    assert np.abs(photo.pixels.astype(int) - GREY).mean() < 2
    assert len(photo.remarks) == (turn > 0)
    if turn:
        assert f"viewers show it turned by {360 - 90 * turn} degrees" in photo.remarks[0]


@pytest.mark.parametrize(
    "options", [{"lossless": True}, {"quality": 95}, {"quality": 95, "exif": b"Exif\0\0II*\0" + bytes(8)}]
)
def test_webp_is_read(options: dict[str, object], tmp_path: Path) -> None:
    """Of all three ways its size may be told."""
    photo = read(tmp_path, "a.webp", webp(COLOUR, **options))
    assert np.abs(photo.pixels.astype(int) - GREY).mean() < 2


@pytest.mark.parametrize(("pattern", "green_first"), [(b"\0\1\1\2", False), (b"\1\0\2\1", True)])
def test_of_a_mosaic_green_is_taken_between_black_and_white(pattern: bytes, green_first: bool, tmp_path: Path) -> None:
    """Linear in light, at full size; red and blue, which are darker here, are seen nowhere, and the turn is said."""
    light = 0.5 + 0.4 * np.sin(COLUMNS / 9.0) * np.cos(ROWS / 13.0)
    is_green = (0 if green_first else 1) == (COLUMNS + ROWS) % 2
    level = 512 + (16000 - 512) * np.where(is_green, light, 0.3 * light)
    photo = read(
        tmp_path, "a.dng", dng(level.round().astype(np.uint16), black=512, white=16000, pattern=pattern, turn=6)
    )
    assert photo.pixels.dtype == np.uint16
    np.testing.assert_allclose(photo.pixels[2:-2, 2:-2] / 65535, light[2:-2, 2:-2], atol=0.006)
    assert "its green pixels, linear in light, 128 x 96 px" in photo.remarks[0]
    assert "viewers show it turned by 90 degrees" in photo.remarks[1]


@pytest.mark.parametrize(("red", "blue", "is_noticed"), [(0.5, 0.7, True), (0.9, 0.9, True), (1.0, 1.0, False)])
def test_a_mosaic_in_a_plain_file_is_noticed(red: float, blue: float, is_noticed: bool, tmp_path: Path) -> None:
    """Where red and blue are darker than green in nearly all cells; not an image in grey, with its noise."""
    level = GREY * np.where(COLUMNS % 2 == ROWS % 2, np.where(ROWS % 2 == 0, red, blue), 1.0)
    level += np.random.default_rng(1).normal(0, 2, level.shape)
    stream = io.BytesIO()
    Image.fromarray(level.clip(0, 255).astype(np.uint8)).save(stream, "PNG")
    assert any("Bayer mosaic" in one for one in read(tmp_path, "a.png", stream.getvalue()).remarks) == is_noticed


BROKEN = {
    "cut.heic": heic(COLOUR)[:-700], "cut.webp": webp(COLOUR)[:-100], "head.heic": heic(COLOUR)[:40],
    "cut.dng": dng(np.ones((96, 128), np.uint16), black=0, white=9)[:200],
    "half.dng": dng(np.ones((96, 128), np.uint16), black=0, white=9)[:-12000], "text.nef": b"II*\0\x08\0\0\0\0\0",
    "film.webp": webp(COLOUR, save_all=True, append_images=[Image.fromarray(255 - COLOUR)]),
}  # fmt: skip


@pytest.mark.parametrize("name", BROKEN)
def test_damage_is_a_line(name: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """Of each format, with the file's name and without a decoder's word."""
    with pytest.raises(InputError, match=rf"{name}: (is|its header|has) .*") as error:
        read(tmp_path, name, BROKEN[name])
    assert "\n" not in str(error.value)
    assert capfd.readouterr() == ("", "")


def test_a_missing_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a photo, and once of a folder of them, with how many there are."""
    monkeypatch.setattr("calib.images.more_formats.find_spec", lambda _: None)
    with pytest.raises(
        InputError, match=r"a.heic: is a HEIC photo, which needs an extra: pip install 'ringsolid\[heif\]'"
    ):
        read(tmp_path, "a.heic", heic(COLOUR))
    (tmp_path / "b.heic").touch()
    assert images_in(tmp_path) == []
    (line,) = not_read_in(tmp_path)
    assert line.startswith("2 HEIC photos are not read: pip install 'ringsolid[heif]', or convert")


def test_raw_photos_beside_developed_ones_are_left_out(tmp_path: Path) -> None:
    """Each would count twice, and they are other images; alone they are taken."""
    for name in ("1.dng", "1.jpg", "2.DNG"):
        (tmp_path / name).touch()
    assert [path.name for path in images_in(tmp_path)] == ["1.jpg"]
    assert not_read_in(tmp_path)[0].startswith("2 raw photos are not read: developed ones stand beside them")
    (tmp_path / "1.jpg").unlink()
    assert [path.name for path in images_in(tmp_path)] == ["1.dng", "2.DNG"]
    assert not_read_in(tmp_path) == ()
