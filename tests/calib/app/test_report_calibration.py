"""The page of a calibration's folder: built from what is stored, whole or not, and with its numbers."""

import json
import math
import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib.cameras.camera import Camera
from calib.draw.camera_scene import camera_view
from calib.draw.rig_scene import view_of
from calib.draw.run_tables import as_sentence, field_of_view_words, finding_of, headline_by
from calib.draw.sigma_map import place_in_image
from calib.judge.checks import read_criteria
from calib.judge.folders import judge_again, read_run
from calib.judge.verdict import Check, Verdict
from calib.observe.observations import known_points
from calib.renderer.truth import Truth, true_views
from calib.solver.metrics.errors import centers_mm
from designer.base.errors import InputError
from designer.page.blocks import Figure, FileList, Page, Paragraph, View3d
from designer.target import target_to_json
from tests.support.calibrations import board, example, icosahedron
from tests.support.pages import blocks_of, findings_of, section_of, table_of
from tests.support.run_folders import BLANK, PANEL, page_of_run, solved, write_overlays, write_run


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of two models, with poses known and overlays; not to be changed."""
    folder = tmp_path_factory.mktemp("kept") / "run"
    every = solved()
    one = every[0]
    truth = Truth("", one.camera, true_views(one.observations.view_names, one.cam_from_target))
    write_run(folder, every, truth=truth)
    write_overlays(folder, one.observations.view_names)
    return folder


@pytest.fixture(scope="module")
def page(kept: Path) -> Page:
    """Its page."""
    return page_of_run(kept)


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures are blank."""
    monkeypatch.setattr(PANEL, lambda *_, **__: BLANK)


@pytest.fixture
def run(kept: Path, tmp_path: Path, undrawn: None) -> Path:
    """A copy to change."""
    return Path(shutil.copytree(kept, tmp_path / "run"))


def test_sections_stand_in_the_order_of_reading(page: Page) -> None:
    """Verdict, camera, accuracy, photos, views, models, files; a board has no table of faces."""
    titles = [one.title for one in page.sections]
    assert titles == ["Verdict", "Camera", "Accuracy", "Photos", "Views in 3D", "Models compared", "Files"]
    assert all(one.lead for one in page.sections[1:])
    assert page.made_by == "calib run board.target.json photos"


def test_numbers_are_those_of_metrics_json(kept: Path, page: Page) -> None:
    """What the table of errors says is what `metrics.json` of the same model holds, poses included."""
    model = table_of(page, "Parameters of model").title.rpartition(" ")[2]
    stored = json.loads((kept / model / "metrics.json").read_text())
    rows = {row[0].text: row for row in table_of(page, "Errors").rows}
    assert rows.keys() == stored["metrics"].keys()
    for name, metric in stored["metrics"].items():
        keys = ("count", "rmse", "mean", "median", "percentile_95", "largest")
        assert [cell.value for cell in rows[name][2:]] == pytest.approx([metric[key] for key in keys])
        assert rows[name][1].text == metric["unit"]
    for row, (name, value) in zip(table_of(page, "Parameters").rows, stored["parameters"].items(), strict=True):
        assert row[0].text == name
        assert row[1].value == value["value"]
        assert row[2].value == pytest.approx(value["sigma"])


def test_the_views_have_all_cameras(kept: Path, page: Page) -> None:
    """The scene has a pyramid for each photo, where the pose says, and the target in its middle."""
    view = next(block for block in blocks_of(page) if isinstance(block, View3d))
    cameras = next(layer for layer in view.scene.layers if layer.name == "cameras").shapes[0]
    run = read_run(kept)
    centre = centers_mm(run.best.calibration.cam_from_target)
    assert np.allclose(cameras.target_from_cam[:, :3, 3], centre)  # type: ignore[union-attr]
    assert view.scene.layers[0].name == "target"


def test_without_a_verdict_the_page_says_so(run: Path) -> None:
    """The headline is no praise, and names the remedy."""
    page = page_of_run(run)
    assert page.headline is not None
    assert page.headline.level == "note"
    assert "--criteria" in page.headline.sentence


def test_a_verdict_on_other_photos_is_not_believed(run: Path, tmp_path: Path) -> None:
    """One that an earlier run left in the folder: the page says so, and is not judged."""
    names = tuple(f"other_{number}.png" for number in range(8))
    write_run(tmp_path / "other", solved(names=names))
    judged = judge_again(tmp_path / "other", read_criteria("standard"))
    shutil.copy(tmp_path / "other/verdict.json", run / "verdict.json")
    page = page_of_run(run)
    assert page.headline is not None
    assert page.headline.level == "note"
    assert any("other photos" in row.text for row in findings_of(page))
    mine = judge_again(run, read_criteria("standard"))
    assert mine.halves != judged.halves
    again = page_of_run(run).headline
    assert again is not None
    assert again.level != "note"


@pytest.mark.parametrize("name", ["verdict.json", "next_views.json", "detections.records.json", "target.json"])
@pytest.mark.parametrize("content", [b"", b"{}", b"\xff\xfe", b'{"format": "ringsolid.verdict", "version": 99}'])
def test_a_damaged_file_is_named_and_the_rest_stands(run: Path, name: str, content: bytes) -> None:
    """One line on the page, without the folder's place; all sections that do not need it are there."""
    (run / name).write_bytes(content)
    page = page_of_run(run)
    said = [row.text for row in findings_of(page) if row.title == "Not on this page"]
    assert len(said) == 1
    assert said[0].startswith(name)
    assert str(run) not in said[0]
    assert {"Camera", "Accuracy", "Photos"} <= {one.title for one in page.sections}


def test_one_bad_model_leaves_the_others(run: Path) -> None:
    """Its fault is named; with one model left there is nothing to compare."""
    (run / "luhmann/observations.csv").unlink()
    page = page_of_run(run)
    assert "Models compared" not in {one.title for one in page.sections}
    assert any("luhmann/observations.csv" in row.text for row in findings_of(page))


def test_no_good_model_is_refused(run: Path) -> None:
    """There is nothing to build a page of; the file is named."""
    for path in run.glob("*/calibration.json"):
        path.write_text(path.read_text().replace('"version": 1', '"version": 2', 1))
    with pytest.raises(InputError, match=r"calibration\.json: version 2"):
        page_of_run(run)


def test_a_model_of_other_photos_is_not_compared(run: Path) -> None:
    """An earlier solution that lies in the folder is named and left out."""
    other = solved(("luhmann",), seed=9)
    shutil.rmtree(run / "luhmann")
    write_run(run, [*solved(("opencv",)), *other])
    page = page_of_run(run)
    assert any("solved from other observations" in row.text for row in findings_of(page))
    assert "Models compared" not in {one.title for one in page.sections}


def test_a_model_of_some_of_the_photos_is_compared(run: Path) -> None:
    """A learned map does not reach all sightings; that makes it no solution of something else."""
    from calib.core.types import keep_views
    from calib.solver.problem import SolveOptions
    from calib.solver.solve import solve

    seen = keep_views(read_run(run).best.calibration.observations, np.arange(8) != 3)
    shutil.rmtree(run / "luhmann")
    write_run(run, [solve(seen, "luhmann", SolveOptions()), *solved(("opencv",))])
    assert {one.model for one in read_run(run).solved} == {"luhmann", "opencv"}


def test_a_single_model_s_folder_has_a_page(run: Path) -> None:
    """As `calib run --model opencv` leaves it: the files lie in the folder itself, and links lead there."""
    page = page_of_run(run / "opencv")
    listed = next(block for block in blocks_of(page) if isinstance(block, FileList))
    assert "camera.json" in {row.path for row in listed.rows}
    assert "Models compared" not in {one.title for one in page.sections}


def test_faces_of_a_solid_have_a_table(tmp_path: Path, undrawn: None) -> None:
    """One row a face, with the photos that show it; their sightings are all of those that count."""
    every = solved(("opencv",), target=icosahedron())
    write_run(tmp_path, every)
    page = page_of_run(tmp_path)
    rows = table_of(page, "Faces").rows
    assert len(rows) == 20
    assert sum(row[2].value or 0 for row in rows) == (~every[0].is_outlier).sum()
    assert "20 faces" in section_of(page, "Faces").lead


def test_the_target_is_drawn_as_its_file_has_it(run: Path) -> None:
    """With its file the scene has the target's own layers; another target's file is not believed."""
    (run / "target.json").write_text(target_to_json(board()))
    mine = read_run(run)
    assert mine.target is not None
    view = camera_view(mine.best, mine.target, ())
    assert "axes" in {layer.name for layer in view.scene.layers}
    assert "axes" not in {layer.name for layer in camera_view(mine.best, None, ()).scene.layers}
    (run / "target.json").write_text(target_to_json(icosahedron()))
    other = read_run(run)
    assert other.target is None
    assert "not the target" in other.faults[0]


def test_held_out_errors_are_shown_as_such(run: Path) -> None:
    """`calib evaluate --held-out` leaves its numbers in the folder: they stand beside those of the solution."""
    place = run / "opencv/metrics.json"
    document = json.loads(place.read_text())
    document["parts"] = 5
    document["metrics"]["reprojection"]["rmse"] = 0.4321
    place.write_text(json.dumps(document))
    (run / "luhmann/calibration.json").unlink()
    page = page_of_run(run)
    assert table_of(page, "Errors by cross-validation").rows[0][3].value == 0.4321
    own = table_of(page, "Errors, of the photos").rows[0]
    assert own[3].value != 0.4321


def test_a_degenerate_camera_has_a_page(tmp_path: Path) -> None:
    """Nothing known, everything left out: a page with fewer figures, not a crash."""
    one = solved(("opencv",))[0]
    odd = replace(
        one, status="degenerate", scale=math.nan, param_covariance=np.full((9, 9), np.nan),
        is_outlier=np.ones(len(one.is_outlier), dtype=bool), remarks=("the photos do not determine the camera",),
    )  # fmt: skip
    write_run(tmp_path, [odd])
    page = page_of_run(tmp_path)
    assert any(row.text == "the photos do not determine the camera" for row in findings_of(page))


@pytest.mark.parametrize("target", [board(), icosahedron()])
def test_a_target_without_planes_is_drawn_by_its_points(target: object) -> None:
    """Points from elsewhere are marked where they are."""
    one = example(board(), np.random.default_rng(0))
    points = known_points(target)  # type: ignore[arg-type]
    seen = replace(
        one.observations,
        points=replace(points, face=np.full(len(points.face), -1), plane=np.zeros((0, 4))),
        point=one.observations.point % len(points.face),
    )
    from calib.judge.solutions import Solution
    from calib.solver.metrics.evaluation import evaluate

    solution = Solution("opencv", evaluate(replace(one, observations=seen)))
    view = camera_view(solution, None, ())
    assert view.scene.layers[0].name == "target"


def test_the_view_through_a_corner_is_that_of_its_pixel() -> None:
    """Without a lens the corners' rays are the pinhole's; they go round clockwise from the top left."""
    pinhole = Camera("pinhole", np.array([100.0, 200.0, 49.5, 39.5]), (100, 80))
    expected = [[-0.495, -0.1975, 1], [0.495, -0.1975, 1], [0.495, 0.1975, 1], [-0.495, 0.1975, 1]]
    assert np.allclose(view_of(pinhole), [expected])


def test_the_view_of_a_wide_lens_is_a_dome() -> None:
    """Its border has the angle off the axis that the lens has at the border of the image, or where its model ends."""
    plain = Camera("fisheye", np.array([250.0, 250.0, 399.5, 399.5, 0, 0, 0, 0]), (800, 800))
    dome = view_of(plain)
    off_axis = np.degrees(np.arccos(dome[-1, :, 2]))
    assert off_axis.min() == pytest.approx(np.degrees(399.5 / 250), abs=0.2)
    assert off_axis.max() == pytest.approx(np.degrees(399.5 * np.sqrt(2) / 250), abs=0.2)
    assert (np.diff(dome[:, :, 2], axis=0) < 0).all()
    assert dome[-1, 0, 0] < 0 > dome[-1, 0, 1]  # the first is the top left, the next is to its right
    assert dome[-1, 1, 0] > dome[-1, 0, 0]


def test_field_of_view_is_the_angle_between_the_sides() -> None:
    """Of a camera without a lens it is `2 atan(width / 2 f)`."""
    pinhole = Camera("pinhole", np.array([500.0, 500.0, 500.0, 500.0]), (1001, 1001))
    assert field_of_view_words(pinhole) == "90.0° x 90.0°"


def test_field_of_view_of_a_wide_lens_is_taken_by_way_of_its_axis() -> None:
    """`width / f` of an equidistant lens, also beyond half a turn; a model that ends inside the image says where."""
    plain = Camera("fisheye", np.array([250.0, 250.0, 500.0, 400.0, 0, 0, 0, 0]), (1001, 801))
    angles = [math.degrees(length / 250) for length in (1000, 800, math.hypot(1000, 800))]
    assert field_of_view_words(plain) == f"{angles[0]:.1f}° x {angles[1]:.1f}°, diagonal {angles[2]:.1f}°"
    folds = Camera("fisheye", np.array([250.0, 250.0, 500.0, 400.0, -0.1, 0, 0, 0]), (1001, 801))
    end = math.degrees(math.sqrt(1 / 0.3))  # where 1 - 3 k theta^2 is 0
    assert re.fullmatch(rf".*; the model ends {end:.1f}° off the axis, inside the image", field_of_view_words(folds))


@pytest.mark.parametrize(
    ("pixel", "expected"),
    [
        ((0.0, 0.0), "in the top left corner"),
        ((50.0, 79.0), "at the bottom edge"),
        ((99.0, 40.0), "at the right edge"),
        ((50.0, 40.0), "in the middle"),
    ],
)
def test_places_in_the_image_have_names(pixel: tuple[float, float], expected: str) -> None:
    """Thirds of width and height."""
    assert place_in_image(np.array(pixel), (100, 80)) == expected


def check(**changes: object) -> Check:
    """A check that is good."""
    return replace(
        Check("coverage", "Sensor coverage", "good", 81.0, "%", 70.0, 40.0, True, "the rings surround 81 %"),
        **changes,  # type: ignore[arg-type]
    )


def test_a_check_becomes_a_line_with_its_limits() -> None:
    """Grade, value and both limits as the verdict has them; what is not known is no praise."""
    row = finding_of(check())
    assert (row.level, row.measured, row.rule) == ("good", "81 %", "good ≥ 70, usable ≥ 40 %")
    assert row.text == "The rings surround 81 %."
    assert finding_of(check(grade="unknown", value=None)).level == "note"
    assert finding_of(check(grade="bad", is_at_least=False)).rule == "good ≤ 70, usable ≤ 40 %"


@pytest.mark.parametrize(
    ("grade", "word", "level"), [("good", "good", "good"), ("usable", "usable", "usable"), ("bad", "do not use", "bad")]
)
def test_the_headline_is_the_verdict(grade: str, word: str, level: str) -> None:
    """The grade's word stands beside its reason."""
    found = headline_by(Verdict(grade, "opencv", "all is well", (), ()))  # type: ignore[arg-type]
    assert (found.level, found.word, found.sentence) == (level, word, "All is well.")


def test_sentences_are_whole() -> None:
    """A capital and one full stop."""
    assert [as_sentence(text) for text in ("a b", "A.", "why?")] == ["A b.", "A.", "Why?"]


def test_paragraphs_name_models_that_are_the_same(kept: Path, page: Page) -> None:
    """Models that do not differ need no map; others have one."""
    compared = section_of(page, "Models compared")
    shown = [b for b in compared.blocks if isinstance(b, (Figure, Paragraph))]
    assert len(shown) == len(read_run(kept).solved) - 1
