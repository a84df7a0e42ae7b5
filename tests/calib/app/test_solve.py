"""`calib solve`, run as a user runs it: what it reads, writes, says and refuses."""

import json
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from calib.cameras import project
from calib.cameras.camera import Camera, load_camera
from calib.core.se3 import look_at, transform
from calib.core.types import Detections, Observations
from calib.images.photo import Photo
from calib.observe.calibration_file import read_calibration
from calib.observe.dataset import write_detections
from calib.solver.calibrate import calibrate
from calib.solver.calibration import Calibration
from designer.base.errors import InputError
from designer.base.files import named_in_files
from designer.target import load_target, target_to_json
from tests.support.calibrations import board, example, icosahedron
from tests.support.command_line import (
    JUDGED,
    LENIENT,
    calib,
    detections_of,
    files_in,
    refused,
    write_correspondences,
    write_inputs,
)

BOARD = board()
TRUE = example(BOARD, np.random.default_rng(3), views=8, noise_px=0.02)
SEEN = TRUE.observations
FILES = {"calibration.json", "observations.csv", "camera.json"}
OF_FOLDER = {"target.json", *JUDGED}
ALL_MODELS = ("solve", "detections.csv", "--target", "board.target.json", *LENIENT, "-o", "out")
MODELS = ("luhmann", "opencv", "virtual")


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder to work in, with a target file and detections."""
    monkeypatch.chdir(tmp_path)
    write_inputs(SEEN, BOARD)
    return tmp_path


def solve(*options: object, file: str = "detections.csv") -> tuple[Calibration, str]:
    """Solve model opencv; the calibration as it is read back, and what was said."""
    target = ("--target", "board.target.json") if file == "detections.csv" else ()
    answer = calib("solve", file, *target, "--model", "opencv", "-o", "out", "--verbose", *LENIENT, *options)
    assert (answer.code, answer.err) == (0, ""), answer
    return read_calibration(Path("out/calibration.json"))[0], answer.out


def corners(path: str, columns: int, rows: int, poses: NDArray[np.float64]) -> None:
    """Write a corners.vnl of a 12 mm grid."""
    place = np.arange(columns * rows)
    grid = 12.0 * np.column_stack([place % columns, place // columns, 0 * place])
    lines = ["# filename x y level"]
    for number, pose in enumerate(poses):
        lines += [f"c{number}.png {u!r} {v!r} 0" for u, v in project(TRUE.camera, transform(pose, grid)).tolist()]
    Path(path).write_text("\n".join(lines) + "\n")


def part(seen: Detections, count: int, name: str) -> Detections:
    """A photo of another name that shows the first few rings."""
    return replace(seen.keep(slice(count)), image=name)


def test_all_models_are_written_read_back_and_compared(folder: Path) -> None:
    """Each model has its folder with three files that are read back; the table has a line for each."""
    answer = calib(*ALL_MODELS, "--verbose")
    assert (answer.code, answer.err) == (0, "")
    assert files_in(folder / "out") == OF_FOLDER | {f"{model}/{name}" for model in MODELS for name in FILES}
    table = answer.out[answer.out.index("Models of the camera") :]
    for model in MODELS:
        calibration, provenance = read_calibration(Path("out", model, "calibration.json"))
        assert calibration.camera.model == model
        assert calibration.status == "converged"
        assert (provenance.layout_id, provenance.geometry_id) == (BOARD.layout_id, BOARD.geometry_id)
        read = load_camera(Path("out", model, "camera.json"))
        np.testing.assert_array_equal(read.params, calibration.camera.params)
        assert re.search(rf"^{model} +\d+ .* converged", table, re.MULTILINE)
    solved = read_calibration(Path("out/opencv/calibration.json"))[0]
    sigma = np.sqrt(np.diagonal(solved.param_covariance))
    assert (np.abs(solved.camera.params - TRUE.camera.params) < 5 * sigma).all()


def test_values_are_shown_to_the_second_digit_of_their_sigma() -> None:
    """A person reads from the table no more digits than are known."""
    solved, said = solve()
    value, sigma = solved.camera.params[0], np.sqrt(solved.stated_covariance[0, 0])
    match = re.search(r"^fx_px +(\S+) +(\S+) +px", said, re.MULTILINE)
    assert match is not None
    assert abs(float(match[1]) - value) <= 0.05 * sigma
    assert float(match[2]) == pytest.approx(sigma, rel=0.05)
    assert len(match[1].split(".")[1]) == len(match[2].split(".")[1])


def test_how_the_target_was_made_is_assumed_said_and_told() -> None:
    """Sigmas hold what the way of making lets the target be off; it is said, recorded, and --made tells another."""
    assumed, said = solve("--no-page")
    assert assumed.target_error is not None
    assert "the target is taken to be made as 'fdm-board'" in said
    assert "--made tells otherwise" in said
    sheet, exact = solve("--no-page", "--made", "sheet-print")[0], solve("--no-page", "--made", "exact")[0]
    sigmas = [np.sqrt(one.stated_covariance[0, 0]) for one in (exact, sheet, assumed)]
    assert sigmas == sorted(sigmas)
    assert sigmas[0] < 0.95 * sigmas[2]
    assert (exact.target_bend, assumed.target_bend is None) == (None, False)
    assert "the target is flat within " in said
    flat, said = solve("--no-page", "--no-free-bend")
    assert np.array_equal(exact.param_covariance, flat.param_covariance)
    assert "the target is flat" not in said
    records = Path("detections.records.json")
    document = json.loads(records.read_text()) | {"rendered_id": BOARD.geometry_id}
    records.write_text(json.dumps(document))
    rendered, said = solve("--no-page")
    assert rendered.target_error is not None
    assert (rendered.target_error.made, rendered.target_bend) == ("exact", None)
    assert "the photos were rendered of it" in said
    answer = calib("solve", "detections.csv", "--target", "board.target.json", "--made", "fdm-bord", "-o", "x")
    assert (answer.code, answer.err.count("\n")) == (2, 1)
    assert "fdm-board" in answer.err


def test_options_reach_the_solver() -> None:
    """Parameters are fixed and shared, and what was chosen stands in the calibration."""
    solved, said = solve("--fix", "k3=0", "--share", "fx_px,fy_px", "--weighted", "--loss", "huber", "--focal", "900px")
    names = ["fx_px", "fy_px", "cx_px", "cy_px", "k1", "k2", "p1", "p2", "k3"]
    params = dict(zip(names, solved.camera.params, strict=True))
    assert params["k3"] == 0
    assert params["fx_px"] == params["fy_px"]
    assert solved.fixed == ("k3",)
    assert solved.weighted
    assert re.search(r"^k3 +0 +fixed", said, re.MULTILINE)
    assert "times the noise that is stated" in said
    options = read_calibration(Path("out/calibration.json"))[1].options
    assert (options.loss, options.focal_px, options.weighted) == ("huber", 900.0, True)
    assert (options.fixed, options.shared) == ((("k3", 0.0),), (("fx_px", "fy_px"),))


def test_outliers_are_left_out_and_counted() -> None:
    """--reject leaves out what is far off and says how many; without it the word is to look at them."""
    pixel = np.array(SEEN.center_px)
    pixel[[5, 77, 200]] += 12.0
    write_inputs(replace(SEEN, center_px=pixel), BOARD)
    plain, said = solve()
    assert "or reject them" in said
    robust, said = solve("--reject", "6")
    assert np.flatnonzero(robust.is_outlier).tolist() == [5, 77, 200]
    assert "3 of " in said
    assert "left out: beyond 6 robust standard deviations" in said
    assert robust.scale < 0.1 * plain.scale


def test_correspondences_from_elsewhere_give_the_same_camera() -> None:
    """A CSV with image,u,v,X,Y,Z needs no target; its image size stands in it or is given."""
    ours, _ = solve()
    write_correspondences(Path("else.csv"), SEEN)
    first, said = solve(file="else.csv")
    assert "X, Y, Z are taken as mm" in said
    assert "X, Y, Z are taken as mm" in first.remarks[-1]
    assert said.count("are taken as mm") == 1
    np.testing.assert_allclose(first.camera.params, ours.camera.params, rtol=1e-4, atol=1e-5)
    write_correspondences(Path("bare.csv"), SEEN, has_size=False)
    second, _ = solve("--image-size", "1200x900", file="bare.csv")
    np.testing.assert_array_equal(second.camera.params, first.camera.params)
    assert "--image-size" in refused("solve", "bare.csv", "-o", "x")
    assert "check the image size" in refused("solve", "bare.csv", "--image-size", "120x90", "-o", "x")


def test_corners_of_a_grid_need_its_size_and_pitch() -> None:
    """A corners.vnl as mrcal writes it is solved with --grid, --pitch and --image-size; the camera is the true one."""
    eye = np.array([[120.0, 40, -300], [-90, 100, -280], [50, -60, -260], [160, 120, -320], [50, 40, -220]])
    corners("corners.vnl", 9, 6, look_at(eye, np.tile([48.0, 30, 0], (5, 1)), np.zeros(5)))
    solved, _ = solve("--grid", "9x6", "--pitch", "12mm", "--image-size", "1200x900", file="corners.vnl")
    np.testing.assert_allclose(solved.camera.params[:4], TRUE.camera.params[:4], rtol=1e-6)
    assert "--pitch belong together" in refused("solve", "corners.vnl", "--grid", "9x6", "-o", "x")
    for grid, pitch, word in (("9by6", "12mm", "--grid"), ("9x6", "12kg", "--pitch"), ("9x6", "0mm", "--pitch")):
        assert word in refused("solve", "corners.vnl", "--grid", grid, "--pitch", pitch, "-o", "x")


def test_the_map_is_learned_from_the_photo_of_choice() -> None:
    """--reference takes a photo's name, its path, or all; other models have no use for it."""
    common = (*ALL_MODELS[:-1], "v")
    for reference in ("view_0003.png", "photos/view_0003.png"):
        answer = calib(*common, "--model", "virtual", "--reference", reference)
        assert answer.code == 0
        assert "map learned from view_0003.png" in answer.out
    settings = dict(read_calibration(Path("v/calibration.json"))[1].settings)
    assert settings["reference"] == "photos/view_0003.png"
    assert "learned from all 8 views" in calib(*common, "--model", "virtual", "--reference", "all").out
    assert "did you mean 'view_0003.png'" in refused(*common, "--reference", "view_3.png")
    assert "model opencv learns no map" in refused(*common, "--model", "opencv", "--reference", "all")
    assert "--reference PHOTO" in refused(*common, "--reference-target", "board.target.json")


def test_a_reference_board_goes_with_a_solid(monkeypatch: pytest.MonkeyPatch) -> None:
    """The map of an icosahedron's camera is learned from a photo of a board, and both are named in the record."""
    solid = icosahedron()
    seen = example(solid, np.random.default_rng(5), views=6, noise_px=0.02).observations
    write_inputs(seen, solid)
    Path("flat.target.json").write_text(target_to_json(BOARD))
    photo = detections_of(SEEN, BOARD)[2]
    monkeypatch.setattr("calib.images.photo.read_image", lambda _path: Photo(np.zeros((1, 1), dtype=np.uint8), ()))
    monkeypatch.setattr("calib.detector.pipeline.detect", lambda _pixels, _board, *, name: replace(photo, image=name))
    answer = calib(
        "solve", "detections.csv", "--target", "board.target.json", "--model", "virtual", "-o", "v",
        "--reference", "flat/a.png", "--reference-target", "flat.target.json", *LENIENT,
    )  # fmt: skip
    assert answer.code == 0, answer
    assert "map learned from a.png" in answer.out
    settings = dict(read_calibration(Path("v/calibration.json"))[1].settings)
    assert (settings["reference"], settings["reference-target"]) == ("flat/a.png", "flat.target.json")


def test_a_focal_length_is_not_fixed_on_a_learned_sensor() -> None:
    """A map learned from a photo has a sensor of its own, so a camera's focal length means nothing there."""
    answer = calib(*ALL_MODELS, "--fix", "fx_px=1400")
    assert answer.code == 0
    assert "virtual was not solved: fx_px cannot be fixed" in answer.out
    of_models = {f"{model}/{name}" for model in ("luhmann", "opencv") for name in FILES}
    assert files_in(Path("out")) == OF_FOLDER | of_models
    assert "fx_px" in refused("solve", "detections.csv", "--target", "board.target.json", "-o", "x", "--model",
                              "virtual", "--fix", "fx_px=1400")  # fmt: skip


def test_a_model_that_fails_does_not_stop_the_others(monkeypatch: pytest.MonkeyPatch) -> None:
    """What can be solved is written; what cannot is named with its reason, and an old solution of it goes."""

    def fail(seen: Observations, model: str, *rest: object) -> Calibration:
        if model == "luhmann":
            raise InputError("no light")
        return calibrate(seen, model, *rest)  # type: ignore[arg-type]

    common = ALL_MODELS
    assert calib(*common).code == 0
    monkeypatch.setattr("calib.judge.solutions.calibrate", fail)
    answer = calib(*common)
    assert answer.code == 0
    assert "luhmann was not solved: no light" in answer.out
    assert "luhmann/ (" not in answer.out
    assert not Path("out/luhmann").exists()
    assert calib(*common[:-1], "new").code == 0
    assert not Path("new/luhmann").exists()
    assert refused(*common, "--model", "luhmann") == "error: no light\n"


GRID = 20.0 * np.stack(np.meshgrid(np.arange(9.0) - 4, np.arange(7.0) - 3, 0.0), axis=-1).reshape(-1, 3)
TILTED = [look_at(300 * np.array([np.sin(a), 0.1, np.cos(a)]), np.zeros(3), a) for a in (0.1, 0.4, 0.7, 1.0)]


@pytest.mark.parametrize(
    ("points", "poses", "code"),
    [
        (GRID[GRID[:, 1] == 0], TILTED, 2),
        (GRID[:1], TILTED, 2),
        (np.repeat(GRID[:1], 6, axis=0) + 1e-9 * np.arange(6)[:, None], TILTED, 2),
        (GRID, [TILTED[2], TILTED[2]], 1),
        (GRID, [TILTED[0]], 1),
    ],
    ids=["collinear", "one ring only", "all in one spot", "two identical views", "one nearly frontal view"],
)
def test_what_determines_no_camera_is_refused_or_judged(
    points: NDArray[np.float64], poses: list[NDArray[np.float64]], code: int
) -> None:
    """One line and exit code 2, or a verdict and exit code 1; never a traceback, never a camera to go on with."""
    lines = ["# image_size 1281 x 961", "image,u,v,X,Y,Z"]
    one = Camera("pinhole", np.array([1000.0, 1000, 640, 480]), (1281, 961))
    for view, pose in enumerate(poses):
        seen = np.column_stack([project(one, transform(pose, points)), points])
        lines += [f"{view}.png," + ",".join(f"{x:.9f}" for x in row) for row in seen.tolist()]
    Path("few.csv").write_text("\n".join(lines) + "\n")
    answer = calib("solve", "few.csv", "--model", "opencv", "-o", "out", "--no-page")
    assert answer.code == code
    assert answer.err.count("\n") == (code == 2)
    assert answer.out.startswith("do not use: ") == (code == 1)


def bad_files() -> Iterator[tuple[tuple[object, ...], str]]:
    """Commands on bad input, and what their one line says."""
    write_correspondences(Path("good.csv"), SEEN)
    yield (".",), "is a folder"
    yield ("detections.csv",), "give --target"
    yield ("good.csv", "--target", "none.target.json"), "none.target.json"
    Path("other.target.json").write_text(target_to_json(board(8, 6)))
    other = load_target(Path("other.target.json"))
    yield ("detections.csv", "--target", "other.target.json"), f"{BOARD.layout_id}, but .* has {other.layout_id}"
    text = Path("detections.csv").read_text()
    Path("none.csv").write_text("".join(line for line in text.splitlines(keepends=True) if line[:4] != "view"))
    yield ("none.csv", "--target", "board.target.json"), "no view is left"


def test_bad_input_ends_in_one_line_and_leaves_nothing(folder: Path) -> None:
    """Exit code 2, the file, the line and the rule; no folder and no file is made."""
    for arguments, rule in bad_files():
        before = files_in(folder)
        assert re.search(rule, refused("solve", *arguments, "-o", "out/deep")), arguments
        assert files_in(folder) == before
    assert not Path("out").exists()


def test_options_that_mean_nothing_are_refused_before_any_work(folder: Path) -> None:
    """Also those that only some of the models cannot take, and a place that cannot be written."""
    before = files_in(folder)
    for arguments, rule in (
        (("--fix", "k4"), "did you mean"),
        (("--fix", "k1", "--fix", "k1=3"), "fixed twice"),
        (("--share", "fx_px,k1"), "different units"),
        (("--share", "fx_px"), "two or more"),
    ):
        line = refused("solve", "detections.csv", "--target", "board.target.json", "-o", "out", *arguments)
        assert re.search(rule, line), line
    assert files_in(folder) == before


def test_no_place_of_this_machine_gets_into_the_files(folder: Path) -> None:
    """Files are named as the user typed them, so that advice can be typed too; of absolute paths the name alone."""
    assert named_in_files(Path("a/b.csv")) == "a/b.csv"
    place = folder / "detections.csv"
    assert calib("solve", place, "--target", folder / "board.target.json", "-o", folder / "out", *LENIENT).code == 0
    for path in (folder / "out").rglob("*"):
        if path.is_file():
            assert str(folder) not in path.read_text(), path
            assert str(Path.home()) + "/" not in path.read_text(), path


def test_two_hundred_photos_do_not_flood_the_screen() -> None:
    """What is said does not grow with the photos, and names of many left-out ones are cut short."""
    seen = detections_of(SEEN, BOARD)
    odd = [part(seen[0], 2, f"odd{n}.png") for n in range(200)]
    write_detections(Path("detections.csv"), [*seen, *odd], BOARD)
    _, said = solve()
    assert said.count("\n") < 60
    assert "odd0.png, odd1.png, odd2.png, odd3.png and 196 more" in said
