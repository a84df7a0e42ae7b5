"""Reading photos: the pixels of the sensor, or one line that says why not."""

import io
import math
import os
import stat
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from PIL import Image
from PIL.TiffImagePlugin import ImageFileDirectory_v2

from calib.images.headers import MAX_PAGES, MAX_SCANS, exif_focal_px, read_header
from calib.images.photo import MAX_PIXELS, Photo, read_image, read_preview
from designer.base.errors import InputError

WIDTH, HEIGHT = 23, 17
RNG = np.random.default_rng(5)
GREY = RNG.integers(0, 256, (HEIGHT, WIDTH), dtype=np.uint8)
DEEP = RNG.integers(0, 65536, (HEIGHT, WIDTH), dtype=np.uint16)
COLOUR = RNG.integers(0, 256, (HEIGHT, WIDTH, 3), dtype=np.uint8)
SMOOTH = np.add.outer(np.arange(HEIGHT) * 5, np.arange(WIDTH) * 6).astype(np.uint8)
LUMA = np.rint(COLOUR @ np.array([0.299, 0.587, 0.114]))


def encoded(image: Image.Image, kind: str, **options: object) -> bytes:
    """A file as Pillow writes it."""
    buffer = io.BytesIO()
    image.save(buffer, kind, **options)
    return buffer.getvalue()


def chunk(name: bytes, body: bytes) -> bytes:
    """A chunk of a PNG."""
    return struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))


def png(width: int, height: int, depth: int, colour: int, rows: bytes, extra: bytes = b"") -> bytes:
    """A PNG of filtered rows."""
    header = struct.pack(">IIBBBBB", width, height, depth, colour, 0, 0, 0)
    chunks = chunk(b"IHDR", header) + extra + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + chunks


def tiff(pixels: NDArray[np.generic], order: str = "<", **changed: int) -> bytes:
    """An uncompressed grey TIFF; tags may be replaced, as `t262=0`."""
    body = pixels.astype(pixels.dtype.newbyteorder(order)).tobytes()
    kind = {"u": 1, "i": 2, "f": 3}[pixels.dtype.kind]
    tags = {254: 0, 256: pixels.shape[1], 257: pixels.shape[0], 258: 8 * pixels.itemsize, 259: 1, 262: 1, 273: 8,
            277: 1, 278: pixels.shape[0], 279: len(body), 339: kind}  # fmt: skip
    tags |= {int(name[1:]): value for name, value in changed.items()}
    directory = b"".join(struct.pack(order + "HHII", tag, 4, 1, value) for tag, value in sorted(tags.items()))
    start = (b"II*\0" if order == "<" else b"MM\0*") + struct.pack(order + "I", 8 + len(body))
    return start + body + struct.pack(order + "H", len(tags)) + directory + bytes(4)


def oriented(orientation: int) -> Image.Exif:
    """EXIF data with an orientation."""
    exif = Image.Exif()
    exif[0x112] = orientation
    return exif


def read(folder: Path, name: str, data: bytes) -> Photo:
    """Write a file and read it as a photo."""
    path = folder / name
    path.write_bytes(data)
    return read_image(path)


def refusal(folder: Path, name: str, data: bytes) -> str:
    """The line that refuses a file."""
    with pytest.raises(InputError) as refused:
        read(folder, name, data)
    message = str(refused.value)
    assert message.startswith(str(folder / name))
    assert "\n" not in message
    return message


EXACT = {
    "8.png": (encoded(Image.fromarray(GREY), "PNG"), GREY),
    "16.png": (encoded(Image.fromarray(DEEP), "PNG"), DEEP),
    "8.tif": (encoded(Image.fromarray(GREY), "TIFF"), GREY),
    "16.tif": (encoded(Image.fromarray(DEEP), "TIFF", compression="tiff_lzw"), DEEP),
    "big-endian.tif": (tiff(DEEP, ">"), DEEP),
    "white-zero.tif": (tiff(GREY, t262=0), 255 - GREY),
    "white-zero-16.tif": (tiff(DEEP, t262=0), 65535 - DEEP),
    "8.bmp": (encoded(Image.fromarray(GREY), "BMP"), GREY),
    "8.pgm": (encoded(Image.fromarray(GREY), "PPM"), GREY),
    "16.pgm": (b"P5 # deep\n%d %d\n65535\n" % (WIDTH, HEIGHT) + DEEP.astype(">u2").tobytes(), DEEP),
    "bits.pbm": (b"P4\n# bits\n8 1\n\x0f", np.array([[255] * 4 + [0] * 4], np.uint8)),
    "text.pgm": (b"P2\n2 1\n255\n3 200", np.array([[3, 200]], np.uint8)),
    "2-bit.png": (png(4, 1, 2, 0, bytes([0, 0b00011011])), np.array([[0, 85, 170, 255]], np.uint8)),
    "palette.png": (
        png(3, 1, 8, 3, bytes([0, 1, 0, 1]), chunk(b"PLTE", bytes([0, 0, 0, 200, 200, 200]))),
        np.array([[200, 0, 200]], np.uint8),
    ),
    "one.png": (png(1, 1, 8, 0, bytes([0, 7])), np.array([[7]], np.uint8)),
}


@pytest.mark.parametrize("name", EXACT)
def test_grey_files_without_loss_give_their_numbers(name: str, tmp_path: Path) -> None:
    """8 and 16 bits, any byte order, either sense of white: the pixels are the numbers written, without a remark."""
    data, pixels = EXACT[name]
    photo = read(tmp_path, name, data)
    assert photo.pixels.dtype == pixels.dtype
    assert np.array_equal(photo.pixels, pixels)
    assert photo.remarks == ()


@pytest.mark.parametrize("kind", ["PNG", "TIFF", "BMP", "PPM"])
def test_colours_become_grey_by_the_usual_weights(kind: str, tmp_path: Path) -> None:
    """Grey is 0.299 R + 0.587 G + 0.114 B, to the rounding."""
    photo = read(tmp_path, f"a.{kind.lower()}", encoded(Image.fromarray(COLOUR), kind))
    assert np.abs(photo.pixels - LUMA).max() <= 1


def test_a_colour_jpeg_gives_the_luminance_it_holds(tmp_path: Path) -> None:
    """The grey of a colour JPEG is that of its decoded colours, to the rounding of the colour conversion."""
    data = encoded(Image.fromarray(np.dstack([SMOOTH, SMOOTH // 2, 255 - SMOOTH])), "JPEG", quality=95, subsampling=0)
    colours = np.asarray(Image.open(io.BytesIO(data)))
    photo = read(tmp_path, "a.jpg", data)
    assert np.abs(photo.pixels - colours @ np.array([0.299, 0.587, 0.114])).max() <= 2


def test_four_colour_jpegs_are_read_the_right_way_round(tmp_path: Path) -> None:
    """A CMYK JPEG gives the grey of its colours; one that does not say what 0 means is refused."""
    data = encoded(Image.fromarray(np.dstack([SMOOTH] * 3)).convert("CMYK"), "JPEG", quality=95)
    assert np.abs(read(tmp_path, "a.jpg", data).pixels.astype(int) - SMOOTH).max() < 8
    at = data.index(b"\xff\xee")
    unmarked = data[:at] + data[at + 2 + int.from_bytes(data[at + 2 : at + 4]) :]
    assert "does not say whether 0 is ink" in refusal(tmp_path, "b.jpg", unmarked)


def test_transparency_does_not_change_a_pixel(tmp_path: Path) -> None:
    """The colour below a transparent pixel counts, and a remark says so."""
    layers = np.dstack([GREY, GREY, GREY, COLOUR[:, :, 0]])
    photo = read(tmp_path, "a.png", encoded(Image.fromarray(layers), "PNG"))
    assert np.array_equal(photo.pixels, GREY)
    assert photo.remarks == ("transparency ignored",)
    listed = png(3, 1, 8, 3, bytes([0, 1, 0, 1]), chunk(b"PLTE", bytes([9] * 3 + [8] * 3)) + chunk(b"tRNS", b"\0\0"))
    assert read(tmp_path, "b.png", listed).pixels.tolist() == [[8, 9, 8]]


@pytest.mark.parametrize("kind", ["PNG", "JPEG", "TIFF"])
@pytest.mark.parametrize("orientation", [3, 5, 6])
def test_pixels_stay_as_the_sensor_saw_them(kind: str, orientation: int, tmp_path: Path) -> None:
    """A noted orientation changes no pixel; it is said."""
    image = Image.fromarray(SMOOTH)
    options = {"tiffinfo": {274: orientation}} if kind == "TIFF" else {"exif": oriented(orientation)}
    plain = read(tmp_path, f"plain.{kind.lower()}", encoded(image, kind))
    photo = read(tmp_path, f"turned.{kind.lower()}", encoded(image, kind, **options))
    assert np.array_equal(photo.pixels, plain.pixels)
    (remark,) = photo.remarks
    assert f"orientation {orientation}" in remark


@pytest.mark.parametrize("kind", ["PNG", "JPEG"])
@pytest.mark.parametrize(("columns", "shrink"), [(400, 1), (200, 2), (150, 2), (30, 8)])
def test_a_preview_has_the_columns_asked_for_and_the_whole_picture(
    kind: str, columns: int, shrink: int, tmp_path: Path
) -> None:
    """A JPEG is decoded to fewer pixels, other formats as they are; a part of a pixel at the edge counts as one."""
    ramp = np.repeat(np.linspace(0, 255, 401).astype(np.uint8)[None], 101, axis=0)
    (tmp_path / "a").write_bytes(encoded(Image.fromarray(ramp).convert("RGB"), kind))
    by = shrink if kind == "JPEG" else 1
    pixels = read_preview(tmp_path / "a", columns, 10**6).pixels
    assert pixels.shape == (-(-101 // by), -(-401 // by), 3)
    middle = by * np.arange(pixels.shape[1]) + (by - 1) / 2  # of the pixels that one stands for
    assert np.abs(pixels[3, :-1, 0] - middle[:-1] * 255 / 400).max() < 3


def test_the_content_tells_the_format(tmp_path: Path) -> None:
    """A PNG named .jpg is read as what it is, and said to be one."""
    photo = read(tmp_path, "a.JPG", encoded(Image.fromarray(GREY), "PNG"))
    assert np.array_equal(photo.pixels, GREY)
    assert photo.remarks == ("the file is PNG, whatever its name says",)


def test_pages_are_not_counted_without_end() -> None:
    """A TIFF of very many pages, which may overlap, costs no more than a few of them."""
    data = struct.pack("<2sHIH", b"II", 42, 8, 2) + struct.pack("<HHIIHHIII", 256, 4, 1, 9, 257, 4, 1, 9, 38)
    data += b"".join(struct.pack("<HI", 0, 38 + 6 * k) for k in range(1, 10 * MAX_PAGES))
    assert read_header(data).page_count == MAX_PAGES


def test_the_first_of_several_pages_is_read(tmp_path: Path) -> None:
    """A TIFF of three pages gives the first one, and the count."""
    others = [Image.fromarray(255 - GREY), Image.fromarray(DEEP)]
    photo = read(tmp_path, "a.tif", encoded(Image.fromarray(GREY), "TIFF", save_all=True, append_images=others))
    assert np.array_equal(photo.pixels, GREY)
    assert photo.remarks == ("page 1 of 3 read",)


def test_profiles_and_gamma_change_nothing_and_print_nothing(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """A broken colour profile and a gamma leave the numbers alone, and standard error clean."""
    extra = chunk(b"gAMA", struct.pack(">I", 100000)) + chunk(b"iCCP", b"x\0\0bad")
    assert read(tmp_path, "a.png", png(2, 1, 8, 0, bytes([0, 10, 20]), extra)).pixels.tolist() == [[10, 20]]
    assert capfd.readouterr().err == ""


JPEG = encoded(Image.fromarray(COLOUR), "JPEG")
WHOLE = {
    "a.png": EXACT["8.png"][0],
    "a.jpg": JPEG,
    "raw.tif": EXACT["8.tif"][0],
    "lzw.tif": EXACT["16.tif"][0],
    "a.bmp": EXACT["8.bmp"][0],
    "a.pgm": EXACT["8.pgm"][0],
}


@pytest.mark.parametrize("name", WHOLE)
@pytest.mark.parametrize("part", [0.4, 0.7, 0.97])
def test_a_part_of_a_file_is_refused(name: str, part: float, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """Half a picture would give wrong answers: a file cut anywhere is refused, with nothing on standard error."""
    message = refusal(tmp_path, name, WHOLE[name][: int(part * len(WHOLE[name]))])
    assert "cut off" in message or "damaged" in message
    assert capfd.readouterr().err == ""


def test_a_jpeg_whose_preview_is_whole_is_still_cut_off(tmp_path: Path) -> None:
    """The end mark of a preview inside the EXIF data does not stand for the end of the photo."""
    preview = b"\xff\xe1" + struct.pack(">H", 2 + len(JPEG)) + JPEG
    assert "cut off" in refusal(tmp_path, "a.jpg", JPEG[:2] + preview + JPEG[2 : len(JPEG) * 3 // 4])


def test_a_changed_bit_in_a_png_is_refused(tmp_path: Path) -> None:
    """A PNG's check sums are held to."""
    data = bytearray(WHOLE["a.png"])
    data[len(data) // 2] ^= 4
    assert "check sum" in refusal(tmp_path, "a.png", bytes(data))


REFUSED = {
    "empty.png": (b"", "0 bytes"),
    "text.png": (b"hello", "not an image"),
    "heic.jpg": (b"\0\0\0\x18ftypheic" + bytes(20), "header is damaged"),
    "float.tif": (tiff(GREY.astype(np.float32)), "floating-point"),
    "signed.tif": (tiff(DEEP.astype(np.int16)), "signed"),
    "32-bit.tif": (tiff(GREY.astype(np.uint32)), "more than 16 bits"),
    "raw.tif": (tiff(DEEP, t262=32803), "raw photo"),
    "preview.tif": (tiff(GREY, t254=1), "raw photo"),
    "no-width.tif": (tiff(GREY).replace(struct.pack("<HH", 256, 4), struct.pack("<HH", 255, 4)), "header is damaged"),
    "zero.png": (png(0, 1, 8, 0, b""), "0 x 1"),
    "bomb.png": (png(200_000, 200_000, 8, 0, b""), "at most 250 million"),
    "deep.png": (png(15_000, 15_000, 16, 6, b""), "8 bytes; at most 1 GB"),
    "bomb.jpg": (JPEG.replace(struct.pack(">HH", HEIGHT, WIDTH), b"\xff\xff\xff\xff", 1), "at most 250 million"),
    "bomb.tif": (tiff(GREY, t256=100_000, t257=100_000), "at most 250 million"),
    "bomb.bmp": (WHOLE["a.bmp"][:18] + struct.pack("<ii", 90_000, -90_000) + WHOLE["a.bmp"][26:], "at most 250"),
    "bomb.pgm": (b"P5 99999 99999 255\n", "at most 250 million"),
    "number.pgm": (b"P5 999999999999 1 255\n", "damaged"),
    "scans.jpg": (
        encoded(Image.fromarray(COLOUR), "JPEG", progressive=True)[:-2] + b"\xff\xda" * (MAX_SCANS + 1) + b"\xff\xd9",
        "scans",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_no_photo_is_refused_before_it_is_decoded(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each refusal names the file and the rule, and no decoder sees it, whatever size a header claims."""
    data, rule = REFUSED[name]
    monkeypatch.setattr("cv2.imdecode", lambda *_: pytest.fail("was decoded"))
    assert rule in refusal(tmp_path, name, data)


def test_photos_of_200_megapixels_are_read(tmp_path: Path) -> None:
    """The limit admits the largest sensors on sale."""
    assert MAX_PIXELS > 200e6
    rows = zlib.compress(bytes(16385) * 12288, 1)
    header = chunk(b"IHDR", struct.pack(">IIBBBBB", 16384, 12288, 8, 0, 0, 0, 0))
    data = b"\x89PNG\r\n\x1a\n" + header + chunk(b"IDAT", rows) + chunk(b"IEND", b"")
    assert read(tmp_path, "a.png", data).pixels.shape == (12288, 16384)


def test_what_is_no_file_is_refused_and_never_waited_for(tmp_path: Path) -> None:
    """A missing file, a folder, a pipe, a device and an impossible name end in one line, at once."""
    pipe = tmp_path / "pipe.png"
    os.mkfifo(pipe)
    assert stat.S_ISFIFO(pipe.stat().st_mode)
    for path, rule in (
        (tmp_path / "missing.png", "cannot be read"),
        (tmp_path, "folder"),
        (pipe, "pipe"),
        (Path("/dev/zero"), "pipe or a device"),
        (Path("a\0b.png"), "no file name"),
        (Path("x" * 5000), "cannot be read"),
    ):
        with pytest.raises(InputError, match=rule):
            read_image(path)


@given(data=st.data())
@settings(max_examples=150, deadline=2000, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_damaged_bytes_end_in_pixels_or_one_line(data: st.DataObject, tmp_path: Path) -> None:
    """Cuts and changed bytes of any small file give a photo or a refusal; never a crash, never a hang."""
    files = [*WHOLE.values(), *(content for content, _ in EXACT.values()), encoded(Image.fromarray(COLOUR), "JPEG",
             exif=oriented(6), progressive=True)]  # fmt: skip
    content = bytearray(data.draw(st.sampled_from(files)))
    for at, value in data.draw(st.lists(st.tuples(st.integers(0, len(content) - 1), st.integers(0, 255)), max_size=8)):
        content[at] = value
    content = content[: data.draw(st.integers(0, len(content)))] if data.draw(st.booleans()) else content
    try:
        photo = read(tmp_path, "a.img", bytes(content))
    except InputError:
        return
    assert photo.pixels.ndim == 2
    assert photo.pixels.dtype in (np.uint8, np.uint16)


MAKE, EXIF_IFD, FOCAL_LENGTH_IN_35_MM = 0x10F, 0x8769, 0xA405


def with_length(path: Path, length: object, size: tuple[int, int] = (600, 400)) -> Path:
    """A photo whose tag holds something."""
    if path.suffix == ".tif":
        directory = ImageFileDirectory_v2()
        directory[EXIF_IFD] = {FOCAL_LENGTH_IN_35_MM: length}
        Image.new("L", size).save(path, tiffinfo=directory)
        return path
    exif = Image.Exif()
    exif[MAKE] = "maker"  # Pillow writes no part of what has no main tags
    exif.get_ifd(EXIF_IFD)[FOCAL_LENGTH_IN_35_MM] = length
    Image.new("L", size).save(path, exif=exif)
    return path


@pytest.mark.parametrize("suffix", ["jpg", "png", "tif"])
def test_the_tag_compares_diagonals(suffix: str, tmp_path: Path) -> None:
    """An image of 3:2 has width over 36 mm pixels a millimetre, and one turned upright the same."""
    assert exif_focal_px(with_length(tmp_path / f"a.{suffix}", 50)) == pytest.approx(50 * 600 / 36)
    assert exif_focal_px(with_length(tmp_path / f"b.{suffix}", 50, (400, 600))) == pytest.approx(50 * 600 / 36)


def test_other_formats_of_images_compare_by_the_diagonal(tmp_path: Path) -> None:
    """A field of view that has the same diagonal angle."""
    guess = exif_focal_px(with_length(tmp_path / "a.jpg", 28, (400, 300)))
    assert guess is not None
    assert math.atan(250 / guess) == pytest.approx(math.atan(math.hypot(36, 24) / 2 / 28))


@pytest.mark.parametrize("length", [0, 6000])
def test_a_length_that_no_lens_has_is_none(length: int, tmp_path: Path) -> None:
    """Zero means unknown in the tag's standard."""
    assert exif_focal_px(with_length(tmp_path / "a.jpg", length)) is None


def test_photos_that_say_nothing_or_are_none_give_no_guess(tmp_path: Path) -> None:
    """Nothing that a file holds stops a run here."""
    Image.new("L", (60, 40)).save(tmp_path / "plain.png")
    (tmp_path / "text.jpg").write_text("no photo")
    good = with_length(tmp_path / "good.jpg", 50).read_bytes()
    (tmp_path / "cut.jpg").write_bytes(good[:40])
    for name in ("plain.png", "text.jpg", "cut.jpg", "missing.jpg", "."):
        assert exif_focal_px(tmp_path / name) is None, name
