"""The first guess of the focal length from a photo's own words."""

import math
from pathlib import Path

import pytest
from PIL import Image
from PIL.TiffImagePlugin import ImageFileDirectory_v2

from calib.images.headers import exif_focal_px

MAKE, EXIF_IFD, FOCAL_LENGTH_IN_35_MM = 0x10F, 0x8769, 0xA405


def photo(path: Path, length: object, size: tuple[int, int] = (600, 400)) -> Path:
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
    assert exif_focal_px(photo(tmp_path / f"a.{suffix}", 50)) == pytest.approx(50 * 600 / 36)
    assert exif_focal_px(photo(tmp_path / f"b.{suffix}", 50, (400, 600))) == pytest.approx(50 * 600 / 36)


def test_other_formats_of_images_compare_by_the_diagonal(tmp_path: Path) -> None:
    """A field of view that has the same diagonal angle."""
    guess = exif_focal_px(photo(tmp_path / "a.jpg", 28, (400, 300)))
    assert guess is not None
    assert math.atan(250 / guess) == pytest.approx(math.atan(math.hypot(36, 24) / 2 / 28))


@pytest.mark.parametrize("length", [0, 6000])
def test_a_length_that_no_lens_has_is_none(length: int, tmp_path: Path) -> None:
    """Zero means unknown in the tag's standard."""
    assert exif_focal_px(photo(tmp_path / "a.jpg", length)) is None


def test_photos_that_say_nothing_or_are_none_give_no_guess(tmp_path: Path) -> None:
    """Nothing that a file holds stops a run here."""
    Image.new("L", (60, 40)).save(tmp_path / "plain.png")
    (tmp_path / "text.jpg").write_text("no photo")
    good = photo(tmp_path / "good.jpg", 50).read_bytes()
    (tmp_path / "cut.jpg").write_bytes(good[:40])
    for name in ("plain.png", "text.jpg", "cut.jpg", "missing.jpg", "."):
        assert exif_focal_px(tmp_path / name) is None, name
