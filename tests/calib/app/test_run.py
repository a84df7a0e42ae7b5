"""`calib run`, run as a user runs it: from photos to compared cameras."""

import json
import re
import shutil
from dataclasses import replace
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from calib.cameras.camera import Camera
from calib.core.types import Detections
from calib.observe.calibration_file import read_calibration
from calib.observe.dataset import read_detections
from calib.renderer.job import RenderJob, truth_text
from calib.renderer.options import RenderOptions
from calib.renderer.view import render_view
from designer.target import TargetGeometry, target_to_json
from tests.support.calibrations import board, camera, poses_around
from tests.support.command_line import JUDGED, LENIENT, PICTURE, calib, detector_of, files_in, instead, refused
from tests.support.run_folders import BLANK, PANEL
from tests.support.sightings import sighting

EXIF_IFD, FOCAL_LENGTH_IN_35_MM = 0x8769, 0xA405
BOARD = board(7, 5, "12mm")
SIZE = (640, 480)
CAMERA = camera("opencv", SIZE, 700.0)
POSES = poses_around(6, np.random.default_rng(2), half_angle_rad=0.7, distance_mm=150.0)
OPTIONS = RenderOptions(blur_px=0.6, contrast_to_noise=80)
JOB = RenderJob(BOARD, CAMERA, POSES, OPTIONS, seed=0)
OF_A_MODEL = {
    "calibration.json", "observations.csv", "camera.json", "metrics.json", "metrics_views.csv", "metrics_points.csv",
    "metrics_faces.csv", "metrics_observations.csv",
}  # fmt: skip
MODELS = ("luhmann", "opencv", "virtual")


@cache
def seen_in_photos() -> dict[str, Detections]:
    """By file name; a test may put a photo's detections in for its time."""
    return {
        name: sighting(BOARD, CAMERA, pose, np.random.default_rng(n), options=OPTIONS, name=name)[1]
        for n, (name, pose) in enumerate(zip(JOB.file_names, POSES, strict=True))
    }


@pytest.fixture(scope="module")
def rendered(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Rendered photos with their truth."""
    place = tmp_path_factory.mktemp("rendered")
    rng = np.random.default_rng(7)
    for name, pose in zip(JOB.file_names, POSES, strict=True):
        image = render_view(BOARD, CAMERA, pose, OPTIONS, rng).image
        cv2.imwrite(str(place / name), image.astype(np.uint8))
    (place / "truth.json").write_text(truth_text(JOB))
    return place


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, rendered: Path) -> Path:
    """A folder to work in, with a target file and photos."""
    monkeypatch.chdir(tmp_path)
    Path("board.target.json").write_text(target_to_json(BOARD))
    shutil.copytree(rendered, "photos")
    return tmp_path


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, bool]]:
    """What photos are searched for, and whether with a camera, by a detector that knows; pictures are not drawn."""
    calls, found = list[tuple[str, bool]](), detector_of(seen_in_photos())

    def detect(pixels: NDArray[np.generic], target: TargetGeometry, *, name: str, **given: object) -> Detections:
        calls.append((name, given.get("camera") is not None))
        return found(pixels, target, name=name)

    monkeypatch.setattr("calib.detector.pipeline.find", lambda *_: None)
    monkeypatch.setattr("calib.detector.pipeline.detect", detect)
    monkeypatch.setattr("calib.draw.picture", lambda *_, **__: PICTURE)
    monkeypatch.setattr(PANEL, lambda *_, **__: BLANK)
    return calls


def quick(*arguments: object) -> tuple[str, ...]:
    """The arguments of a run of one model."""
    return ("run", "board.target.json", *map(str, arguments), "--model", "opencv", "-o", "out", *LENIENT)


def test_photos_become_cameras_that_are_compared(folder: Path) -> None:
    """Rendered photos end in three models near the truth, which is found beside them, and all files are there."""
    answer = calib("run", "board.target.json", "photos", "-o", "out", "--verbose", *LENIENT)
    assert (answer.code, answer.err) == (0, "")
    wanted = {f"{model}/{name}" for model in MODELS for name in OF_A_MODEL}
    wanted |= {"detections.csv", "detections.records.json", "target.json", *JUDGED}
    wanted |= {"calibration.png"}
    wanted |= {f"overlays/{name.replace('.png', '.overlay.jpg')}" for name in JOB.file_names}
    assert files_in(folder / "out") == wanted
    table = answer.out[answer.out.index("Models of the camera") :]
    assert "pose mm" in table
    for model in MODELS:
        calibration, provenance = read_calibration(Path("out", model, "calibration.json"))
        assert calibration.observations.view_names == tuple(JOB.file_names)
        assert provenance.layout_id == BOARD.layout_id
        pose = json.loads(Path("out", model, "metrics.json").read_text())["metrics"]["pose"]
        assert pose["rmse"] < 0.05
        assert re.search(rf"^{model} +\d+ .* converged", table, re.MULTILINE)
    assert re.search(r"^fx_px .* [-+]\d\.\d sigma", answer.out, re.MULTILINE)
    for path in (folder / "out").rglob("*.*"):
        if path.suffix in (".json", ".csv"):
            assert str(folder) not in path.read_text()


def test_the_real_detector_is_asked_again_with_the_lens(asked: list[tuple[str, bool]]) -> None:
    """Each photo is searched without, then with the camera of the first solution."""
    assert calib(*quick("photos")).code == 0
    assert sorted(asked) == sorted((name, known) for name in JOB.file_names for known in (False, True))


def test_photos_of_another_size_are_kept_and_named(
    asked: list[tuple[str, bool]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The lens of the first solution is not theirs; they are searched without it, and left out of the solution."""
    Image.new("L", (320, 240)).save("photos/large.png")
    large = replace(seen_in_photos()["view_0000.png"], image_size=(320, 240))
    monkeypatch.setitem(seen_in_photos(), "large.png", large)
    answer = calib(*quick("photos"))
    assert answer.code == 0
    assert asked.count(("large.png", False)) == 1
    assert ("large.png", True) not in asked
    assert "left out views that are not of 640 x 480 px as the others: large.png" in answer.out
    assert "camera file" not in answer.out
    data = read_detections(Path("out/detections.csv"), BOARD, target_path=Path("t"))
    assert "large.png" in {one.image for one in data}


def test_odd_photos_do_not_stop_the_others(asked: list[tuple[str, bool]], monkeypatch: pytest.MonkeyPatch) -> None:
    """A copy, a photo without target: each is named, and the others are solved."""
    shutil.copy("photos/view_0001.png", "photos/sub [x] 1.png")
    Image.new("L", SIZE).save("photos/black.png")
    monkeypatch.setitem(seen_in_photos(), "sub [x] 1.png", seen_in_photos()["view_0001.png"])
    answer = calib(*quick("photos", "missing.png"))
    assert answer.code == 0
    assert "left out views that are another one once more: view_0001.png (as sub [x] 1.png)" in answer.out
    assert re.search(r"without the target: black\.png: nothing here", answer.out)
    assert read_calibration(Path("out/calibration.json"))[0].observations.view_count == len(JOB.file_names)
    assert ("missing.png", False) not in asked


def test_bad_input_leaves_nothing(folder: Path, asked: list[tuple[str, bool]]) -> None:
    """One line, exit code 2, and no file or folder, before a photo is searched."""
    Path("foreign.json").write_text("{}")
    before = files_in(folder)
    for arguments, rule in (
        (("photos", "--truth", "foreign.json"), "not the truth"),
        (("photos", "--fix", "k9"), "no such parameter"),
        (("photos", "--reference", "view_0001.png"), "learns no map"),
    ):
        assert re.search(rule, refused(*quick(*arguments))), arguments
    assert "none of the photos" in refused("run", "board.target.json", "photos", "--reference", "x.png", "-o", "out")
    assert files_in(folder) == before
    assert not asked


def test_rendered_photos_are_of_an_exact_target_for_every_command(asked: list[tuple[str, bool]]) -> None:
    """Wherever their truth lies, a solution from their detections takes the target as the run did."""
    Path("photos/truth.json").rename("truth.json")
    calib(*quick("photos", "--truth", "truth.json"))
    again = ("--target", "board.target.json", "--model", "opencv", "-o", "again", "--no-page")
    calib("solve", "out/detections.csv", *again)
    made = [read_calibration(Path(place, "calibration.json"))[0].target_error for place in ("out", "again")]
    assert [one and one.made for one in made] == ["exact", "exact"]


def test_a_foreign_truth_beside_the_photos_does_no_harm(asked: list[tuple[str, bool]]) -> None:
    """A file that happens to be called truth.json is named and not used; results go below exports by default."""
    Path("photos/truth.json").write_text('{"answer": 42}')
    answer = calib("run", "board.target.json", "photos", "--model", "opencv", *LENIENT)
    assert answer.code == 0
    assert Path("exports/board/calibration/camera.json").exists()
    assert "not used: photos/truth.json: not the truth of rendered photos" in answer.out
    assert "pose mm" not in answer.out


def test_one_photo_alone_may_not_determine_a_camera(
    asked: list[tuple[str, bool]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A frontal photo of a board: exit code 1 with the reason; it is searched once, as there is no lens to know."""
    flat = Camera("pinhole", CAMERA.params[:4], SIZE)
    straight = np.diag([1.0, -1, -1, 1])
    straight[2, 3] = 150
    _, seen = sighting(BOARD, flat, straight, np.random.default_rng(0), name="view_0000.png")
    monkeypatch.setitem(seen_in_photos(), "view_0000.png", seen)
    words = ("--model", "pinhole", "--fix", "cx_px=320", "--fix", "cy_px=240")
    answer = calib(*instead(quick("photos/view_0000.png"), words))
    assert answer.code == 1
    assert "focal length" in answer.out
    assert answer.out.startswith("do not use: ")
    assert "no camera is determined: " in answer.out
    assert "; then run the same command again" in answer.out
    assert "calib convert" not in answer.out
    assert asked[0] == ("view_0000.png", False)


def test_the_photos_own_focal_length_is_a_first_guess(asked: list[tuple[str, bool]]) -> None:
    """It is said and recorded; a person's own guess goes before it."""
    exif = Image.Exif()
    exif[0x10F] = "maker"  # Pillow writes no part of what has no main tags
    exif.get_ifd(EXIF_IFD)[FOCAL_LENGTH_IN_35_MM] = 40
    for name in JOB.file_names:
        Image.open(Path("photos", name)).save(Path("photos", name), exif=exif)
    answer = calib(*quick("photos"))
    assert "first guess of the focal length: 740 px, from what view_0000.png says" in answer.out
    guess = read_calibration(Path("out/calibration.json"))[1].options.focal_px
    assert guess == pytest.approx(739.6, abs=0.5)
    answer = calib(*quick("photos", "--focal", "650px"))
    assert "first guess" not in answer.out
    assert read_calibration(Path("out/calibration.json"))[1].options.focal_px == 650


def test_a_reference_photo_of_a_board_is_searched_for_itself(asked: list[tuple[str, bool]]) -> None:
    """--reference-target names the target of the reference, which is no photo of the run."""
    answer = calib(
        "run", "board.target.json", *sorted(map(str, Path("photos").glob("view_000[1-5].png"))), "--model", "virtual",
        "--reference", "photos/view_0000.png", "--reference-target", "board.target.json", "-o", "out", *LENIENT,
    )  # fmt: skip
    assert answer.code == 0, answer
    assert "map learned from view_0000.png" in answer.out
    assert asked[0] == ("view_0000.png", False)
    assert read_calibration(Path("out/calibration.json"))[0].observations.view_count == 5
    assert "cannot be read" in refused(
        "run", "board.target.json", "photos", "--model", "virtual", "--reference", "no.png",
        "--reference-target", "board.target.json", "-o", "o",
    )  # fmt: skip
