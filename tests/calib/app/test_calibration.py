"""What `run` and `solve` return is saved whole, or refused before anything is written."""

import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import calib
from calib.core.types import Detections
from tests.support.calibrations import board, camera, example
from tests.support.command_line import detections_of

BOARD = board(7, 5, "12mm")
CAMERA = camera("opencv", (320, 240), 350.0)
MODEL = {"model": "opencv", "criteria": "robotics"}


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder to work in."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture(scope="module")
def photos(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Rendered photos."""
    place = tmp_path_factory.mktemp("photos")
    light = calib.RenderOptions(blur_px=0.6, contrast_to_noise=60)
    shots = calib.render(BOARD, CAMERA, views=5, distance_mm=150.0, aim_offset_mm=10, random_roll=True, options=light)
    shots.save(place)
    return place


@pytest.fixture(scope="module")
def run(photos: Path) -> calib.Run:
    """The run of these."""
    return calib.run(BOARD, photos, **MODEL)


def seen() -> Sequence[Detections]:
    """Detections in photos."""
    return detections_of(example(BOARD, np.random.default_rng(1), views=6, noise_px=0.05).observations, BOARD)


def test_detections_of_arrays_are_told_apart_and_saved() -> None:
    """Arrays have no names: detections that are called alike are numbered, and the result is saved as any other."""
    run = calib.solve([replace(one, image="image") for one in seen()], BOARD, **MODEL)
    assert repr(run) == f"<Run, {run.verdict.grade}: {run.verdict.sentence}>"
    assert run.observations.view_names == tuple(f"image-{n}" for n in range(1, 7))
    assert any(path.name == "index.html" for path in run.save("x"))
    with pytest.raises(calib.InputError, match="each Detections"):
        calib.solve(["a.csv"], BOARD)
    with pytest.raises(calib.InputError, match="is no path; give a folder"):
        calib.solve(seen(), BOARD, out="", **MODEL)


def test_a_photo_that_is_gone_is_named_on_the_page(run: calib.Run, photos: Path) -> None:
    """The others have their overlays."""
    kept = (photos / "view_0003.png").rename("kept.png")
    run.save("c")
    kept.rename(photos / "view_0003.png")
    assert len(list(Path("c/overlays").iterdir())) == 4
    assert "no overlay for view_0003.png" in Path("c/index.html").read_text()


def test_another_runs_photos_are_not_this_ones(run: calib.Run) -> None:
    """A camera of other photos, saved into the folder of an earlier run, does not show that run's photos."""
    run.save("a")
    calib.solve([replace(one, image=f"other-{one.image}") for one in seen()], BOARD, **MODEL).save("a")
    assert "<bdi>view_0003.png" not in Path("a/index.html").read_text()


def test_what_an_earlier_run_left_goes_and_other_files_stay(run: calib.Run) -> None:
    """Cameras and overlays of ours that are not of this run are removed; whatever else lies there is as it was."""
    run.save("a")
    names = ("calibration.json", "camera.json", "observations.csv", "metrics.json", "metrics_views.csv")
    Path("a/luhmann").mkdir()
    for name in names:
        shutil.copy(Path("a", name), Path("a/luhmann", name))
    shutil.copy("a/overlays/view_0000.overlay.jpg", "a/overlays/gone.overlay.jpg")
    for mine in (Path("a/luhmann/notes.txt"), Path("a/overlays/mine.overlay.jpg")):
        mine.write_text("mine")
    run.save("a")
    assert [path.name for path in Path("a/luhmann").iterdir()] == ["notes.txt"]
    assert not Path("a/overlays/gone.overlay.jpg").exists()
    assert Path("a/overlays/mine.overlay.jpg").read_text() == "mine"
