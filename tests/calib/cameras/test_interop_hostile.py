"""Broken and hostile camera files: one clear line, at once, and never anything else."""

from contextlib import suppress
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from calib.cameras.formats import FORMATS, READ_FORMATS, READ_RIG_FORMATS
from calib.cameras.formats.format import MAX_FILE_BYTES
from calib.cameras.formats.parsing import DEEPEST, MOST_NODES, parse_yaml
from calib.cameras.formats.reading import open_camera
from designer.base.errors import InputError
from tests.support.foreign_cameras import written

YAML = ("opencv", "ros", "kalibr")
LONG = MAX_FILE_BYTES // 2

BOMBS = {
    "nested flow": ("[" * LONG, YAML),
    "nested mappings": ("{a: " * (LONG // 4), YAML),
    "nested blocks": ("- " * (LONG // 2), YAML),
    "nested keys": ("? " * (LONG // 2), YAML),
    "aliases": (
        "a0: &a0 [x, x, x, x, x, x, x, x, x]\n"
        + "".join(f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 9)}]\n" for n in range(1, 200))
        + "camera_matrix: *a199\nintrinsics: *a199\nresolution: *a199\nimage_width: *a199\nwidth: 3\n"
        + "image_height: *a199\ndistortion_coefficients: *a199\ncamera_model: *a199\ndistortion_model: *a199\n",
        YAML,
    ),
    "merge keys": (
        "a0: &a0 {x: 1}\n" + "".join(f"a{n}: &a{n} {{<<: [{', '.join([f'*a{n - 1}'] * 9)}]}}\n" for n in range(1, 60)),
        YAML,
    ),
    "an alias to itself": ("camera_matrix: &a [*a]\nintrinsics: &b {x: *b}\n", YAML),
    "a tag that makes objects": ("image_width: !!python/object/apply:os.system ['exit 3']\nintrinsics: !!int x", YAML),
    "long lines": ("camera_matrix: " + "x" * LONG, YAML),
    "an impossible character": ('camera_matrix: "\\UFFFFFFFF"\nintrinsics: "\\UFFFFFFFF"', YAML),
    "control characters": ("intrinsics: \x00\x01\ncamera_matrix: \x00\x01\n", YAML),
    "unhashable keys": ("? [a]\n: b\nK: {[a]: b}\nwidth: {[a]: b}\nintrinsics: {[a]: b}", YAML),
    "only a number": ("3", FORMATS),
    "nothing": ("", FORMATS),
    "a megabyte of one letter": ("x" * 2**20, FORMATS),
    "many words deep inside": ("intrinsics: " + "[" * 300 + "x," * (LONG - 200), YAML),
    "line ends": ("\n" * 2**17, FORMATS),
    "nested literals": ("{'lensmodel': " * 50_000, ("mrcal",)),
    "nested brackets": ("{'lensmodel': " + "[" * 10**6, ("mrcal",)),
    "signs": ("{'lensmodel': " + "-" * 10**6 + "1}", ("mrcal",)),
    "sums": ("{'lensmodel': 1" + "+1" * 10**5 + "}", ("mrcal",)),
    "a huge number": ("{'lensmodel': 'LENSMODEL_PINHOLE', 'imagersize': [" + "9" * 10**5 + ", 3]}", ("mrcal",)),
    "powers": ("{'lensmodel': 9**9**9**9}", ("mrcal",)),
    "calls": ("{'lensmodel': __import__('os').system('exit 3')}", ("mrcal",)),
    "an open string": ("{'lensmodel': '" + "\\'" * 10**6, ("mrcal",)),
    "many values": ("{'lensmodel': [" + "1," * 10**6 + "]}", ("mrcal",)),
    "entities": (
        '<!DOCTYPE c [<!ENTITY a "aaaaaaaaaa">'
        + "".join(f'<!ENTITY a{n} "{f"&a{n - 1 if n else str()};" * 10}">' for n in range(20))
        + "]><calibration><f>&a19;</f></calibration>",
        ("metashape",),
    ),
    "a file as an entity": (
        '<!DOCTYPE c [<!ENTITY a SYSTEM "file:///etc/hostname">]><calibration><f>&a;</f></calibration>',
        ("metashape",),
    ),
    "nested elements": ("<a>" * 10**6, ("metashape",)),
    "an encoding that hides": (
        '<?xml version="1.0" encoding="UTF-7"?><calibration>+ADw-</calibration>',
        ("metashape",),
    ),
    "half a surrogate": ("<calibration>\ud800</calibration>", ("metashape",)),
    "no end": ("<calibration><f>3", ("metashape",)),
    "nested json": ('{"format": ' + "[" * 10**5, ("json",)),
    "a long line": ("1 PINHOLE 9 9 " + "1 " * 10**6, ("colmap",)),
    "many cameras": ("".join(f"{n} PINHOLE 9 9 5 5 5 5\n" for n in range(10**5)), ("colmap",)),
    "a long name": ("1 " + "P" * 10**6 + " 9 9 5 5 5 5", ("colmap",)),
}


@pytest.mark.parametrize("bomb", BOMBS)
def test_bombs_are_refused_at_once(bomb: str) -> None:
    """Nested, self-referring, swelling and executable content ends in one short line."""
    text, formats = BOMBS[bomb]
    for name in formats:
        with pytest.raises(InputError) as caught:
            FORMATS[name].read(text, "f.x", None)
        message = str(caught.value)
        assert message.startswith("f.x: ")
        assert len(message.splitlines()) == 1
        assert len(message) < 250


def test_kinds_are_told_in_time_that_grows_with_the_text() -> None:
    """A pattern that takes line ends where a line begins takes the square of how many there are."""
    patterns = [kind.recognised.pattern for kind in (*READ_FORMATS.values(), *READ_RIG_FORMATS.values())]
    assert not [one for one in patterns if r"^\s" in one]


@pytest.mark.parametrize(
    ("text", "rule"),
    [("a: " + "[" * DEEPEST + "]" * DEEPEST, "nested too deep"), ("a: [" + "x," * MOST_NODES + "]", "values")],
    ids=["deep", "many"],
)
def test_yaml_is_parsed_up_to_a_depth_and_a_number_of_values(text: str, rule: str) -> None:
    """The time that parsing takes is bounded by these two; what is within both is read."""
    with pytest.raises(InputError, match=rule):
        parse_yaml(text, "f.x")
    flat, nested = "a: [" + "x," * (MOST_NODES - 4) + "]", "a: " + "[" * (DEEPEST - 1) + "]" * (DEEPEST - 1)
    assert parse_yaml(flat, "f.x") == {"a": ["x"] * (MOST_NODES - 4)}
    assert parse_yaml(nested, "f.x")


@pytest.mark.parametrize("name", FORMATS)
@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(data=st.data())
def test_damaged_files_are_read_or_refused(name: str, data: st.DataObject) -> None:
    """A file with some characters lost, doubled or changed gives a camera or an InputError, nothing else."""
    text = written(name, "barrel")[1]
    for _ in range(data.draw(st.integers(1, 4))):
        start = data.draw(st.integers(0, len(text)))
        end = data.draw(st.integers(start, min(len(text), start + 30)))
        text = text[:start] + data.draw(st.text("0.-e[]{}<>:,'\"!&*#\n\t x\x00é\U0001f600", max_size=8)) + text[end:]
    with suppress(InputError):
        assert FORMATS[name].read(text, "f.x", None).camera.params.size in (4, 5, 8, 9, 12, 16, 18)


def test_files_that_are_no_camera(tmp_path: Path) -> None:
    """What cannot be told is answered with what to say; what is known by sight is named."""
    for content, rule in (
        (b"hello", "not a camera file of a known kind; if you know, say --from json"),
        (b"<?xml version='1.0'?>\n<opencv_storage>\n</opencv_storage>", "OpenCV's XML is not read; save it as .yaml"),
        (b'{"format": "ringsolid.other"}', "no camera file; name the camera.json beside it"),
        (b"\xff\xfe\x00", "not UTF-8 text"),
        (b"1 FOV 9 9 5 5 5 5 0.5", "'FOV': not supported"),
    ):
        (tmp_path / "f").write_bytes(content)
        with pytest.raises(InputError, match=rule):
            open_camera(str(tmp_path / "f"))


def test_a_file_too_large_for_its_kind(tmp_path: Path) -> None:
    """Each kind has its size; a chain of cameras of 200 kB is none."""
    (tmp_path / "c").write_text(written("kalibr", "barrel")[1] + "# " + "x" * 200_000)
    with pytest.raises(InputError, match=r"more than 131072 bytes; Kalibr camchain is smaller"):
        open_camera(str(tmp_path / "c"))


def test_opening_by_name(tmp_path: Path) -> None:
    """A folder stands for its camera.json, a template for itself; #NAME picks a camera."""
    (tmp_path / "camera.json").write_text(written("json", "barrel")[1])
    assert open_camera(str(tmp_path)).format.name == "json"
    assert open_camera("wide-webcam").read.camera.image_size == (1024, 768)
    marked = tmp_path / "a#b.txt"
    marked.write_text(written("colmap", "barrel")[1])
    assert open_camera(str(marked)).format.name == "colmap"
    assert open_camera(f"{marked}#1").read.camera.model == "opencv"
    with pytest.raises(InputError, match="holds no camera '2'; there is 1"):
        open_camera(f"{marked}#2")
    with pytest.raises(InputError, match=r"camera\.json holds one camera; leave out '#x'"):
        open_camera(f"{tmp_path / 'camera.json'}#x")
    with pytest.raises(InputError, match="unknown camera format 'opencvv'; did you mean 'opencv'"):
        open_camera(str(marked), "opencvv")
