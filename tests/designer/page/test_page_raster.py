"""Pictures of pixels inside pages: their size, their kind and their small versions."""

import io

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from designer.page.pictures import media_type, raster_of, thumbnail


def encoded(pixels: np.ndarray, kind: str, **options: object) -> bytes:
    """Pixels as a file."""
    stream = io.BytesIO()
    Image.fromarray(pixels).save(stream, kind, **options)
    return stream.getvalue()


def ramp(height: int, width: int) -> np.ndarray:
    """Grey that grows to the right from black to white."""
    return np.tile(np.linspace(0, 255, width).round().astype(np.uint8), (height, 1))


@given(st.binary(max_size=200))
def test_any_bytes_after_a_jpeg_s_first(tail: bytes) -> None:
    """Whatever follows, there is a size of at least a pixel or a ValueError."""
    try:
        raster = raster_of(b"\xff\xd8\xff" + tail)
    except ValueError:
        return
    assert min(raster.width_px, raster.height_px) >= 1


@pytest.mark.parametrize(
    "content", [b"", b"GIF89a", b"<svg/>", b"RIFFxxxxWEBP", b"\x89PNG\r\n\x1a\n", b"\x89PNG\r\n\x1a\n" + bytes(30)]
)
def test_other_files_are_refused(content: bytes) -> None:
    """Only PNG and JPEG are pictures here; of what is none there is no thumbnail."""
    for read in (raster_of, lambda content: thumbnail(content, 10)):
        with pytest.raises(ValueError, match="picture"):
            read(content)


def test_thumbnail_is_small_and_the_same_picture() -> None:
    """A thumbnail has the asked width and the photo's proportions and greys, without its metadata."""
    content = encoded(ramp(400, 600), "JPEG", quality=95, exif=b"Exif\0\0secret")
    small = thumbnail(content, 150)
    assert (small.width_px, small.height_px) == (150, 100)
    assert raster_of(small.content) == small
    assert media_type(small.content) == "image/jpeg"
    assert b"secret" not in small.content
    pixels = np.asarray(Image.open(io.BytesIO(small.content)), dtype=float)
    assert np.abs(pixels[50] - np.linspace(0, 255, 150)).max() < 6


def test_thumbnail_of_pixels_and_of_their_file_agree() -> None:
    """Pixels and the PNG of these pixels give the same thumbnail."""
    pixels = np.random.default_rng(3).integers(0, 256, (80, 120, 3), dtype=np.uint8)
    assert thumbnail(pixels, 60) == thumbnail(encoded(pixels, "PNG"), 60)


def test_thumbnail_never_enlarges() -> None:
    """A small picture keeps its size."""
    assert thumbnail(ramp(5, 9), 100).width_px == 9


def test_thumbnail_ignores_the_orientation() -> None:
    """A photo is shown as the sensor read it, as in all other pictures: coordinates mean the same everywhere."""
    exif = Image.Exif()
    exif[0x0112] = 6
    small = thumbnail(encoded(ramp(40, 60), "JPEG", exif=exif.tobytes()), 30)
    assert (small.width_px, small.height_px) == (30, 20)


def test_thumbnail_of_sixteen_bits() -> None:
    """Sixteen bits are scaled to eight, not cut off."""
    deep = (ramp(20, 40).astype(np.uint16) * 257).astype(np.uint16)
    pixels = np.asarray(Image.open(io.BytesIO(thumbnail(encoded(deep, "PNG"), 40).content)), dtype=float)
    assert np.abs(pixels[10] - ramp(20, 40)[10]).max() < 6


def test_thumbnail_of_a_transparent_picture_is_on_white() -> None:
    """What is transparent becomes white, not black."""
    clear = np.zeros((10, 10, 4), dtype=np.uint8)
    assert np.asarray(Image.open(io.BytesIO(thumbnail(encoded(clear, "PNG"), 10).content))).min() > 250
