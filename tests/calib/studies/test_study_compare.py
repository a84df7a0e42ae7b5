"""The paper's real-world figure in simulation."""

import csv
import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib.app.study_compare import ComparedObjects
from calib.cameras.camera import Camera, camera_or_preset
from calib.solver.metrics.errors import summarise
from calib.solver.metrics.evaluation import evaluate
from calib.studies.compare import cases
from calib.studies.compare.cases import (
    FIGURE,
    CaseResult,
    Comparison,
    Explanation,
    Plan,
    comparison,
    identity,
    results_of,
)
from calib.studies.compare.prints import NO_EFFECT, NOISE, OneSource, SetsOfPhotos, calibrate_with, grouped, made_mm
from calib.studies.compare.scene import (
    ComparedScene,
    fitting_distance_mm,
    make_target,
    object_named,
    scene_of,
    stream,
    take_photos,
)
from calib.studies.runner import DrawCount, run_cases
from calib.studies.store import open_study
from calib.studies.tolerance.draw import run_draws
from calib.studies.tolerance.setting import setting_at
from designer.base.errors import InputError
from designer.target import TargetGeometry
from designer.tolerance.error_file import error_model
from designer.tolerance.source import Amount

CAMERA = camera_or_preset("phase-one-ixg")
SMALL = 12
"""Views, so that tests are quick."""


def board() -> TargetGeometry:
    """The smaller board."""
    return make_target("3d-board")


def scene(name: str = "3DBoard", template: str = "3d-board", views: int = SMALL) -> ComparedScene:
    """A scene of few views."""
    return scene_of(name, make_target(template), CAMERA, views)


def test_distances_fit_the_targets() -> None:
    """AluBoard is 720 mm away, as f = 15650 px asks for; an icosahedron's rings are in the image from every side."""
    assert fitting_distance_mm(make_target("alu-board"), CAMERA) == 720
    ico = make_target("shiny-ico")
    distance = fitting_distance_mm(ico, CAMERA)
    nearest = np.linalg.norm(ico.center_mm, axis=1).max() + ico.radius_outer_mm.max()
    assert 0 <= distance - nearest / math.sin(math.atan(0.5 * 8707 / 15650)) < 10
    half = replace(CAMERA, params=np.array([7825.0, 7825, 5803.5, 4353.5, 0, 0, 0, 0, 0]))
    assert fitting_distance_mm(make_target("alu-board"), half) == 360


def test_without_errors_only_noise_is_left() -> None:
    """Photos of a perfect print give errors of the detector's size, and the true camera."""
    one = scene()
    solved = calibrate_with(take_photos(one, one.target.center_mm, stream(1, "x"), SMALL), "opencv")
    errors = {error.metric: summarise(error).rmse for error in evaluate(solved).errors}
    assert errors["reprojection"] < 0.01
    assert errors["intersection"] < 5e-4
    assert np.abs(solved.camera.params[:4] - CAMERA.params[:4]).max() < 1


def test_noise_follows_its_covariance() -> None:
    """Pixels scatter about the projections by the stated covariances."""
    one = scene()
    first, still = (take_photos(one, one.target.center_mm, stream(1, "y"), SMALL, noise=noise) for noise in (1.0, 0.0))
    off = first.center_px - still.center_px
    square = np.einsum("mi,mij,mj->m", off, np.linalg.inv(first.cov_px2), off).mean()
    assert abs(square / 2 - 1) < 0.05


def test_models_and_cameras_see_the_same_prints() -> None:
    """The errors of a print hang on seed, object and number alone, and differ between numbers."""
    model = error_model("fdm-board")
    other = replace(scene(), camera=camera_or_preset("phase-one-spline"), views=7)
    assert np.array_equal(made_mm(scene(), model, 1, 3), made_mm(other, model, 1, 3))
    assert not np.array_equal(made_mm(scene(), model, 1, 3), made_mm(scene(), model, 1, 4))
    assert not np.array_equal(made_mm(scene(), model, 1, 3), made_mm(scene(), model, 2, 3))


def test_sets_of_a_print_share_its_errors() -> None:
    """Sample n is set n % sets of print n // sets: sets of one print are alike, prints are not; any order will do."""
    pool = SetsOfPhotos(scene(), error_model("fdm-board"), "opencv", 3)
    every = pool.run("", SMALL, 1, range(6))
    assert pool.run("", SMALL, 1, range(4, 5)) == every[4:5]
    table = grouped(np.array([one.errors.intersection_mm for one in every]), [one.number for one in every], 3)
    assert table.std(axis=1).max() < 0.3 * np.abs(np.diff(table.mean(axis=1)))[0]


def test_it_agrees_with_the_tolerance_study() -> None:
    """The same print seen from the same poses gives the metrics of `calib.studies.tolerance`, an independent path."""
    one, model = scene(), error_model("fdm-board").only("warp").with_amount("warp", Amount("fixed", 0.3))
    seen = take_photos(one, made_mm(one, model, 1, 0), stream(1, "z"), SMALL)
    solved = calibrate_with(seen, "opencv")
    ours = {error.metric: summarise(error).rmse for error in evaluate(solved).errors}
    setting = setting_at(one.target, CAMERA, solved.cam_from_target, model="opencv")
    theirs = run_draws(setting, model, 1, range(1))[0, -1]
    assert ours["reprojection"] == pytest.approx(theirs[0], rel=0.03)
    assert ours["intersection"] == pytest.approx(theirs[1], rel=0.03)
    assert ours["reconstruction"] == pytest.approx(theirs[2], rel=0.03)


def test_one_source_is_scaled_until_the_error_is_met() -> None:
    """The multiple found gives the wanted intersection error; twice the wanted error takes about twice the source."""
    model = error_model("fdm-board")
    small, large = (OneSource(scene(), model, "warp", wanted).run("", SMALL, 1, range(1))[0] for wanted in (0.05, 0.1))
    assert (small.status, large.status) == ("converged", "converged")
    assert small.errors.intersection_mm == pytest.approx(0.05, rel=0.02)
    assert large.errors.intersection_mm == pytest.approx(0.1, rel=0.02)
    assert large.params[0] / small.params[0] == pytest.approx(2, rel=0.03)


def test_multiples_are_of_what_was_drawn() -> None:
    """A print whose one number happens to be small takes the same size of error as any other, not a larger one."""
    pool = OneSource(scene(), error_model("fdm-board"), "warp", 0.1)
    sizes = [one.params[0] for one in pool.run("", SMALL, 1, range(5))]
    assert max(sizes) < 2 * min(sizes)


def test_sources_that_do_not_show_are_said_so() -> None:
    """A scale is taken up by the poses: no multiple of it gives any error, and the sample says it."""
    found = OneSource(scene(), error_model("fdm-board"), "scale", 0.1).run("", SMALL, 1, range(1))[0]
    assert found.status == "failed"
    assert NO_EFFECT in found.message


def test_noise_is_averaged_by_reconstruction() -> None:
    """Noise that gives an intersection error gives a far lower reconstruction error; a warp does not."""
    noise, warp = (
        OneSource(scene(), error_model("fdm-board"), source, 0.1).run("", SMALL, 1, range(1))[0]
        for source in (NOISE, "warp")
    )
    assert noise.errors.reconstruction_mm < 0.6 * noise.errors.intersection_mm
    assert warp.errors.reconstruction_mm > 0.9 * warp.errors.intersection_mm


def test_virtual_wins_behind_the_spline_lens() -> None:
    """Where no Brown model fits, the learned map is better in photos held out, too."""
    lens = scene_of("3DBoard", board(), camera_or_preset("phase-one-spline"), SMALL)
    brown, learned = (
        SetsOfPhotos(lens, None, name, 1).run("", SMALL, 1, range(1))[0] for name in ("opencv", "virtual")
    )
    assert learned.errors.intersection_mm < 0.2 * brown.errors.intersection_mm
    assert learned.params[1] < 0.2 * brown.params[1]  # held out
    assert 0.3 < learned.params[4] < brown.params[4] == 1  # share of the image


def test_failures_become_samples() -> None:
    """Photos that do not determine a camera, and errors that leave no target, are samples with a reason."""
    one, broken = scene(views=1), error_model("fdm-board").scaled(1e4)
    found = SetsOfPhotos(one, None, "opencv", 1).run("", 1, 1, range(1))[0]
    assert found.status == "degenerate"
    assert found.message
    found = SetsOfPhotos(one, broken, "opencv", 1).run("", 1, 1, range(1))[0]
    assert found.status == "failed"
    assert "use a smaller amount" in found.message


def test_middle_is_over_sets_then_prints() -> None:
    """The median of the prints' medians: one print with many bad sets does not outweigh the others."""
    table = np.array([[1.0, 1.0, 9.0], [2.0, 2.0, np.nan], [30.0, 31.0, 32.0]])
    middle = CaseResult("MattIco", FIGURE, "opencv", {"intersection": table}, 0, 0).row("intersection")
    assert (middle.median, middle.prints) == (2.0, 3)
    assert 1.0 <= middle.low < 2.0 < middle.high <= 31.0


def test_an_explanation_gives_both_numbers() -> None:
    """A source fits if its reconstruction error is the paper's too, and is within reach of its template."""
    one = Explanation("AluBoard", "warp", 8.0, 7.0, 9.0, "1.2mm", 0.52, 0.5, 6.0, 6, 0, "")
    assert one.fits
    assert one.is_within_reach
    assert not replace(one, reconstruction_mm=0.3).fits
    assert not replace(one, multiple=30.0).is_within_reach


def only_boards(monkeypatch: pytest.MonkeyPatch) -> None:
    """A comparison that takes seconds: one board with few views."""
    few = (replace(object_named("3DBoard"), views=SMALL),)
    monkeypatch.setattr(cases, "OBJECTS", few)
    monkeypatch.setattr(cases, "LENS_OBJECTS", ("3DBoard",))
    monkeypatch.setattr(cases, "object_named", lambda _: few[0])


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Comparison]:
    """A small comparison, its file and its output."""
    folder = tmp_path_factory.mktemp("compare")
    plan = Plan("phase-one-ixg", 2, 2, alone=1)
    with pytest.MonkeyPatch.context() as patched:
        only_boards(patched)
        whole = comparison(plan)
    with open_study(folder / "study.sqlite", identity(plan), resume=False) as study:
        wanted = ("opencv", "virtual", "warp", "scale", NOISE)
        run_cases([one for one in whole.cases if one.case.sightings in wanted], study, jobs=1, chunk=8)
        ComparedObjects(results_of(study, whole), DrawCount(), "out").save(folder, has_page=False)
    return folder, whole


def test_outputs_agree(finished: tuple[Path, Comparison]) -> None:
    """Table, CSV and JSON hold the same medians, pictures are there in three formats, sentences name the paper."""
    folder, whole = finished
    with (folder / "table.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    document = json.loads((folder / "compare.json").read_text())
    for row, same in zip(rows, document["cases"], strict=True):
        assert row["median"] == ("" if same["median"] is None else f"{same['median']!r}")
    (one,) = (row for row in rows if (row["part"], row["model"], row["metric"]) == (FIGURE, "opencv", "intersection"))
    assert float(one["paper"]) == 0.6
    text = (folder / "table.md").read_text()
    assert f"{float(one['median']):.3f}" in text
    assert "warp" in text
    assert "the paper has 0.6" in text
    assert f"3DBoard {whole.scenes['3DBoard'].distance_mm:g} mm" in text
    for name in ("objects", "lens", "alone"):
        assert all((folder / "figures" / f"{name}.{suffix}").stat().st_size > 1000 for suffix in ("png", "pdf", "svg"))


def test_a_study_without_samples_draws(tmp_path: Path, finished: tuple[Path, Comparison]) -> None:
    """An interrupted run that has nothing yet makes empty tables and pictures that say so."""
    _, whole = finished
    with open_study(tmp_path / "study.sqlite", identity(whole.plan), resume=False) as study:
        assert not results_of(study, whole).cases
        assert ComparedObjects(results_of(study, whole), DrawCount(), "out").tables()


def test_a_study_of_another_plan_is_not_gone_on_with(tmp_path: Path) -> None:
    """Another number of sets is another study; more prints of the same are not."""
    one = Plan("phase-one-ixg", 2, 2)
    with open_study(tmp_path / "study.sqlite", identity(one), resume=False):
        pass
    assert identity(replace(one, prints=9)) == identity(one)
    assert identity(replace(one, sets=3)) != identity(one)
    assert identity(replace(one, camera="machine-vision")) != identity(one)


def test_a_camera_that_sees_nothing_is_refused() -> None:
    """A camera so coarse that no ring is 5 px across is told so, with the remedy."""
    coarse = Camera("opencv", np.array([60.0, 60, 31.5, 23.5, 0, 0, 0, 0, 0]), (64, 48))
    with pytest.raises(InputError, match="choose a camera with a longer lens or more pixels"):
        scene_of("3DBoard", board(), coarse, SMALL)
