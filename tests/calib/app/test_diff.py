"""The command `calib diff`."""

import re
from pathlib import Path

import numpy as np
import pytest

from calib.app.diff import diff
from calib.cameras.camera import Camera, camera_to_json
from calib.cameras.refit import camera_difference
from designer.base.errors import InputError
from tests.support.foreign_cameras import CAMERAS, SIZE, text_of

BARREL = CAMERAS["barrel"]
MOVED = Camera("opencv", BARREL.params + np.array([1, 0.5, 3, -2, 0.001, 0, 0, 0, 0]), SIZE)


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder to work in, with two cameras of different kinds of files."""
    monkeypatch.chdir(tmp_path)
    Path("a").mkdir()
    Path("a/camera.json").write_text(camera_to_json(BARREL))
    Path("b.cameramodel").write_text(text_of("mrcal", MOVED))
    return tmp_path


def run(a: str, b: str, **options: object) -> None:
    """The command, whose options are given as a shell gives them."""
    diff.as_command()(a=a, b=b, **options)


def stated(said: str, row: str) -> list[float]:
    """The numbers in a row of the table."""
    found = re.search(rf"^{row} +([0-9. ]+)$", said, re.MULTILINE)
    assert found is not None
    return [float(number) for number in found[1].split()]


def test_the_difference_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    """RMS, median and max over the image, the rotation, and where it is largest, from files of any kind."""
    run("a", "b.cameramodel")
    said = capsys.readouterr().out
    true = camera_difference(BARREL, MOVED)
    expected = [np.sqrt(np.mean(true.length_px**2)), np.median(true.length_px), true.length_px.max(),
                np.degrees(np.sqrt(np.mean(true.angle_rad**2)))]  # fmt: skip
    assert stated(said, "whole image") == pytest.approx(expected, abs=1e-4)
    assert stated(said, "centre")[2] < stated(said, "corners")[2] == stated(said, "whole image")[2]
    assert f"rotation removed: {np.degrees(true.turn_rad):.4f} deg, fitted to the whole image" in said
    assert "A        a: camera.json, opencv, 1024 x 768 px" in said
    assert "B        b.cameramodel: mrcal camera model, opencv" in said


def test_the_radius_of_the_fit(capsys: pytest.CaptureFixture[str]) -> None:
    """A radius fits the rotation to the centre, which then agrees better; 0 removes none."""
    centres = []
    for radius in (None, "128", "0"):
        run("a", "b.cameramodel", radius_px=radius)
        said = capsys.readouterr().out
        centres.append(stated(said, "centre")[0])
    assert centres[1] < centres[0] < centres[2]
    assert "no rotation removed" in said


def test_a_picture_is_written(capsys: pytest.CaptureFixture[str]) -> None:
    """The map is a PNG; another ending is refused before anything is compared."""
    run("a", "b.cameramodel", out=Path("maps/d.png"))
    assert Path("maps/d.png").read_bytes().startswith(b"\x89PNG")
    assert "wrote    maps: d.png" in capsys.readouterr().out
    with pytest.raises(InputError, match=r"the picture is a \.png file; name it so, such as d\.png"):
        run("a", "b.cameramodel", out=Path("d.jpg"))
    assert capsys.readouterr().out == ""


def test_what_is_not_known_is_counted(capsys: pytest.CaptureFixture[str]) -> None:
    """Pixels that one camera has no ray for are not compared, and their number is told."""
    Path("c.json").write_text(
        camera_to_json(Camera("opencv", np.array([900.0, 905, 510, 390, -0.6, 0, 0, 0, 0]), SIZE))
    )
    run("c.json", "a")
    found = re.search(r"not compared +(\d+) of 2700 pixels", capsys.readouterr().out)
    assert found is not None
    assert 0 < int(found[1]) < 2700
