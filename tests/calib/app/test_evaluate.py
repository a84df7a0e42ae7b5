"""`calib evaluate`, run as a user runs it, and the files and tables it makes."""

import csv
import json
import math
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import typer
from typer.testing import CliRunner, Result

import calib
from calib.app import evaluate as capability
from calib.draw.run_tables import models_table
from calib.judge.folders import read_run
from calib.judge.solutions import Solution
from calib.observe.calibration_file import Provenance, write_calibration
from calib.renderer.job import RenderJob, truth_text
from calib.renderer.options import RenderOptions
from calib.solver.calibration import Calibration
from calib.solver.metrics.errors import summarise
from calib.solver.metrics.evaluation import by_point, by_view, evaluate
from calib.solver.metrics.evaluation_files import evaluation_files
from calib.solver.problem import SolveOptions
from calib.solver.solve import solve
from designer.base.errors import InputError
from designer.base.words import figure, with_digits
from tests.support.calibrations import board, example, icosahedron
from tests.support.command_line import rows_of_csv, write_correspondences

APP = typer.Typer()
COMMAND = capability.evaluate.as_command()
APP.command()(COMMAND)
ICO = icosahedron()
TRUE = example(ICO, np.random.default_rng(1), views=8, noise_px=0.1)
OPTIONS = SolveOptions(fixed=(("k3", 0.0),))


@cache
def solved() -> Calibration:
    """What the commands judge."""
    return solve(TRUE.observations, "opencv", OPTIONS)


def run(*arguments: object) -> Result:
    """Run the command in this process."""
    return CliRunner().invoke(APP, [str(argument) for argument in arguments], env={"COLUMNS": "200"})


def folder_of(calibration: Calibration, folder: Path) -> Path:
    """A calibration on disk."""
    write_calibration(folder, calibration, Provenance("test 1", options=OPTIONS))
    return folder


def truth_file(folder: Path) -> Path:
    """The truth of the photos, as `calib render` writes it."""
    job = RenderJob(ICO, TRUE.camera, TRUE.cam_from_target, RenderOptions(), seed=1)
    path = folder / "truth.json"
    path.write_text(truth_text(job))
    return path


def test_a_calibration_alone_is_enough(tmp_path: Path) -> None:
    """The folder that `calib solve` wrote: tables on the screen, metrics and pictures beside it, exit code 0."""
    folder = folder_of(solved(), tmp_path / "cal")
    result = run(folder, "--verbose")
    assert result.exit_code == 0, result.output
    for words in ("model opencv", "reprojection", "intersection", "reconstruction", "worst px", "Faces of the target"):
        assert words in result.output
    assert "of the photos that the camera was solved from" in result.output
    assert "fixed" in result.output
    assert "\nnext     calib evaluate" in result.output
    names = {path.name for path in folder.iterdir()} - {"calibration.json", "observations.csv", "camera.json"}
    assert names == {
        "metrics.json", "metrics_views.csv", "metrics_points.csv", "metrics_faces.csv", "metrics_observations.csv",
        "calibration.png",
    }  # fmt: skip


def test_truth_adds_pose_errors(tmp_path: Path) -> None:
    """With truth.json there are pose errors, and the parameters stand beside the true ones."""
    folder = folder_of(solved(), tmp_path / "cal")
    result = run(
        folder / "calibration.json", "--truth", truth_file(tmp_path), "-o", tmp_path / "out", "--no-figures", "-v"
    )
    assert result.exit_code == 0, result.output
    assert "\npose " in result.output
    assert "sigma" in result.output
    document = json.loads((tmp_path / "out" / "metrics.json").read_text())
    expected = np.linalg.norm(_centers(solved()) - _centers(TRUE), axis=1)
    assert document["metrics"]["pose"]["rmse"] == pytest.approx(math.sqrt((expected**2).mean()))
    assert document["parameters"]["fx_px"]["true"] == TRUE.camera.params[0]
    assert document["parameters"]["k3"] == {"value": 0.0, "sigma": 0.0, "unit": "1", "fixed": True, "true": 0.0}


def test_the_answer_comes_first(tmp_path: Path) -> None:
    """The root mean squares of the file, and of which photos they are, stand on the first line."""
    folder = folder_of(solved(), tmp_path / "cal")
    for more, photos in ((), "that the camera was solved from"), (("--held-out", 4), "held out"):
        first = run(folder, *more).output.splitlines()[0]
        rms = json.loads((folder / "metrics.json").read_text())["metrics"]["reprojection"]["rmse"]
        said = f"evaluated: Root mean square errors of photos {photos}: reprojection {figure(rms)} px"
        assert first.startswith(said)


def _centers(one: Calibration) -> np.ndarray:
    return np.array([-pose[:3, :3].T @ pose[:3, 3] for pose in one.cam_from_target])


def test_held_out_solves_as_it_was_solved(tmp_path: Path) -> None:
    """--held-out keeps the options of the solution, and the output says what the errors are of."""
    folder = folder_of(solved(), tmp_path)
    result = run(folder, "--held-out", 4, "--no-figures", "--verbose")
    assert result.exit_code == 0, result.output
    assert "Errors by cross-validation" in result.output
    assert "in 4 parts" in result.output
    document = json.loads((folder / "metrics.json").read_text())
    assert document["of"] == "views held out of the solution"
    assert document["metrics"]["reprojection"]["rmse"] > summarise(evaluate(solved()).errors[0]).rmse


def test_sightings_that_were_not_solved_from(tmp_path: Path) -> None:
    """--on says what the errors are of on screen and in its files, which the folder's page tells apart from its own."""
    folder = folder_of(solved(), tmp_path / "cal")
    other = tmp_path / "b.csv"
    write_correspondences(other, example(ICO, np.random.default_rng(2), views=3, noise_px=0.1).observations)
    result = run(folder, "--on", other, "--no-figures", "--verbose")
    assert result.exit_code == 0, result.output
    assert "Errors of b.csv, which the camera was not solved from: of these, poses only" in result.output
    assert "view_0002.png" in result.output
    document = json.loads((folder / "metrics.json").read_text())
    assert (document["of"], document["on"]) == ("views the camera was not solved from", "b.csv")
    assert document["views"] == 3
    found = calib.evaluate(folder, on=other)
    assert found.on is found.asked
    assert summarise(found.asked.errors[0]).rmse == document["metrics"]["reprojection"]["rmse"]
    told = read_run(folder).best
    assert told.held_out is not None
    assert told.held_out.on == "b.csv"
    assert told.metrics.views == 8


def test_a_degenerate_calibration_ends_with_1(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """What the photos do not determine is said, with its reason, and the exit code is 1."""
    lost = replace(
        solved(), status="degenerate", remarks=("one view that faces the board squarely",), scale=math.nan,
        param_covariance=np.full((9, 9), np.nan), pose_covariance=np.full((8, 6, 6), np.nan),
    )  # fmt: skip
    done = COMMAND(calibration=folder_of(lost, tmp_path), figures=False, page=True, verbose=False)
    assert done.exit_code == 1
    assert "one view that faces the board squarely" in capsys.readouterr().out
    assert json.loads((tmp_path / "metrics.json").read_text())["parameters"]["fx_px"]["sigma"] is None


def test_bad_input_is_one_line(tmp_path: Path) -> None:
    """Parts that do not fit, a folder of several cameras, a truth of other photos, an output that is a file."""
    folder = folder_of(solved(), tmp_path / "cal")
    other = tmp_path / "other"
    other.mkdir()
    truth, seen = truth_file(other), other / "seen.csv"
    write_correspondences(seen, TRUE.observations)
    truth.write_text(truth.read_text().replace("view_", "photo_"))
    for arguments, words in (
        ([tmp_path], f"name the folder of one: {folder}"),
        ([folder, "--truth", truth], "none of which was calibrated with"),
        ([folder, "--held-out", 1], "--held-out 1: 8 photos fall into 2 to 8 parts"),
        ([folder, "--held-out", 9], "--held-out 9: 8 photos fall into 2 to 8 parts"),
        ([folder, "--on", seen, "--held-out", 4], "choose one"),
        ([folder, "--on", seen, "--truth", truth], "leave it out with --on"),
        ([folder, "--on", seen, "--image-size", "10x20"], "leave one out"),
        ([folder, "--target", truth], "--target: is of the sightings that --on names"),
        ([folder, "--image-size", "10x20"], "--image-size: is of the sightings that --on names"),
    ):
        result = run(*arguments)
        assert isinstance(result.exception, InputError), result.output
        assert words in str(result.exception)
        assert "\n" not in str(result.exception)
    assert not (folder / "metrics.json").exists()


def test_a_truth_of_other_photos_is_told(tmp_path: Path) -> None:
    """Photos of one name but another size cannot be the same."""
    path = truth_file(tmp_path)
    document = json.loads(path.read_text())
    document["camera"]["image_size"] = [10, 20]
    path.write_text(json.dumps(document))
    result = run(folder_of(solved(), tmp_path / "cal"), "--truth", path, "--no-figures")
    assert "the truth is of photos of 10 x 20 px, the calibration is not" in result.output


def test_files_hold_the_summaries(tmp_path: Path) -> None:
    """metrics.json and the CSV files hold what the functions compute, row by row."""
    found = evaluate(solved())
    for path, content in evaluation_files(found, tmp_path).items():
        path.write_bytes(content)
    document = json.loads((tmp_path / "metrics.json").read_text())
    assert document["of"] == "the views the camera was solved from"
    for errors in found.errors:
        assert document["metrics"][errors.metric]["rmse"] == summarise(errors).rmse
    views, rings = rows_of_csv(tmp_path / "metrics_views.csv"), rows_of_csv(tmp_path / "metrics_points.csv")
    reprojection, reconstruction = found.errors[0], found.errors[2]
    for row, summary in zip(views, by_view(found, reprojection) or (), strict=True):
        assert int(row["reprojection_count"]) == summary.count
        assert float(row["reprojection_rmse_px"]) == pytest.approx(summary.rmse, rel=1e-5)
    for row, summary in zip(rings, by_point(found, reconstruction) or (), strict=True):
        assert (
            row["reconstruction_rmse_mm"] == ""
            if not summary.count
            else float(row["reconstruction_rmse_mm"]) == pytest.approx(summary.rmse, rel=1e-5)
        )
    of_point = reprojection.point == 40
    mean = reprojection.vector[of_point].mean(axis=0)
    assert float(rings[40]["reprojection_mean_u_px"]) == pytest.approx(mean[0], rel=1e-4)
    assert len(rows_of_csv(tmp_path / "metrics_faces.csv")) == ICO.face_count
    sightings = rows_of_csv(tmp_path / "metrics_observations.csv")
    assert len(sightings) == len(reprojection.size)
    assert float(sightings[7]["reprojection_px"]) == pytest.approx(reprojection.size[7], rel=1e-4)
    assert (sightings[7]["image"], sightings[7]["reprojection_left_out"]) == ("view_0000.png", "")


def test_outliers_are_in_the_files_with_their_reason(tmp_path: Path) -> None:
    """A sighting that does not count is listed with its error, and named an outlier."""
    flag = np.zeros(len(solved().is_outlier), dtype=bool)
    flag[5] = True
    for path, content in evaluation_files(evaluate(replace(solved(), is_outlier=flag)), tmp_path).items():
        path.write_bytes(content)
    row = rows_of_csv(tmp_path / "metrics_observations.csv")[5]
    assert row["reprojection_left_out"] == "outlier"
    assert float(row["reprojection_px"]) > 0
    document = json.loads((tmp_path / "metrics.json").read_text())
    assert document["outliers"] == 1
    assert document["metrics"]["intersection"]["left_out"] == {"outlier": 1}


def test_names_cannot_steer_the_terminal(tmp_path: Path) -> None:
    """File names with control characters or markup are printed escaped, and cannot break a line of CSV."""
    names = tuple(f"[red]\x1b[31m{n}\n,\udc80.png" for n in range(8))
    seen = replace(solved().observations, view_names=names)
    result = run(folder_of(replace(solved(), observations=seen, remarks=(names[0],)), tmp_path), "--no-figures")
    assert result.exit_code == 0, result.output
    assert "\x1b[31m" not in result.output
    assert r"[red]\x1b[31m" in result.output
    with (tmp_path / "metrics_views.csv").open(newline="", encoding="utf-8", errors="surrogatepass") as stream:
        assert [row["image"] for row in csv.DictReader(stream)] == list(names)


def test_models_stand_side_by_side() -> None:
    """A row a model: RMSE of every metric, the focal length with its sigma, and whether it can be trusted."""
    evaluations = [evaluate(solve(TRUE.observations, model)) for model in ("luhmann", "opencv", "pinhole")]
    table = models_table([Solution(one.calibration.camera.model, one) for one in evaluations])
    heads = ["model", "observations", "reprojection px", "intersection mm", "reconstruction mm", "fx px", "status"]
    assert [column.title for column in table.columns] == heads
    for row, one in zip(table.rows, evaluations, strict=True):
        assert row[0].text == one.calibration.camera.model
        assert row[2].text == figure(summarise(one.errors[0]).rmse)
        assert row[-1].text == "converged"
        sigma = float(row[-2].text.split("±")[1])
        assert sigma == pytest.approx(math.sqrt(one.calibration.param_covariance[0, 0]), rel=0.05)


def test_numbers_have_the_digits_that_mean_something() -> None:
    """Four figures without an exponent where that is readable; a value to the second digit of its sigma."""
    assert [figure(x) for x in (0.0012345, 0.5, 12.3456, 123456.0, 0.0, math.nan)] == [
        "0.001234", "0.5000", "12.35", "123456", "0", "-",
    ]  # fmt: skip
    assert figure(1.23456e-9) == "1.235e-09"
    assert [with_digits(1400.31109, sigma) for sigma in (0.25, 0.031, 12.0)] == ["1400.31", "1400.311", "1400"]
    assert with_digits(1400.31109, 0.0) == "1400.311"
    assert with_digits(-1e-6, 0.001) == "0.0000"


def test_a_board_has_no_worst_face(tmp_path: Path) -> None:
    """One face is not compared with others."""
    one = example(board(), np.random.default_rng(3), views=4, noise_px=0.1)
    result = run(folder_of(one, tmp_path), "--no-figures", "--verbose")
    assert result.exit_code == 0, result.output
    assert "Faces of the target" not in result.output
