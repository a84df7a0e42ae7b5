"""Files that a person names are read with bounds, whatever they are."""

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from calib.cameras.camera import load_camera
from calib.observe.dataset import RECORDS
from calib.renderer.poses import load_poses
from designer.base.errors import InputError
from designer.base.files import read_small_text
from designer.kinds.spec_file import read_spec_file
from designer.target import load_target

READERS = (load_camera, RECORDS.read, load_poses, read_spec_file, load_target)


@pytest.mark.parametrize("read", READERS)
def test_no_reader_waits_or_fills_the_memory(read: Callable[[Path], object], tmp_path: Path) -> None:
    """Devices, pipes, folders, missing files and other bytes end in one line that names them."""
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "bytes").write_bytes(b"\xff\xfe\x00")
    for path, rule in (
        (Path("/dev/zero"), "not a regular file"),
        (tmp_path / "pipe", "not a regular file"),
        (tmp_path, "not a regular file"),
        (tmp_path / "none", "cannot be read"),
        (tmp_path / "bytes", "not UTF-8"),
    ):
        with pytest.raises(InputError, match=rule) as caught:
            read(path)
        assert str(path) in str(caught.value)
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize("read", READERS[:3])
@pytest.mark.parametrize("text", ["[" * 100_000, "1" * 5000, "{"])
def test_no_json_is_too_odd(read: Callable[[Path], object], text: str, tmp_path: Path) -> None:
    """Nesting and numbers beyond Python's limits are bad input as a missing brace is."""
    (tmp_path / "a.json").write_text(text)
    with pytest.raises(InputError, match=r"nested too deep|too long|line 1"):
        read(tmp_path / "a.json")


def test_no_more_than_the_limit_is_read(tmp_path: Path) -> None:
    """A file of the limit's size is read, one byte more is refused; a byte order mark is no text."""
    (tmp_path / "a").write_bytes(b"\xef\xbb\xbf" + b"x" * 7)
    assert read_small_text(tmp_path / "a", 10, "a test") == "x" * 7
    with pytest.raises(InputError, match="more than 9 bytes"):
        read_small_text(tmp_path / "a", 9, "a test")
