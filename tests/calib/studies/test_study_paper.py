"""The paper's study at a small scale, run as a user runs it; what `calib study` refuses and leaves alone."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib.cameras.camera import camera_to_json
from calib.core.types import Observations, keep_sightings
from calib.observe.dataset import write_detections
from calib.observe.observations import known_points
from calib.renderer.truth import TRUTH
from calib.studies import bootstrap as pool
from calib.studies import paper_study
from calib.studies.statistics import TARGETS, paper_value
from designer.base.arrays import Array
from designer.kinds.board import BoardSpec
from designer.kinds.ico import IcoSpec
from designer.kinds.layout import lay_out
from designer.target import TargetGeometry
from tests.support.calibrations import board, camera
from tests.support.command_line import calib, detections_of, instead, refused, write_inputs
from tests.support.study_commands import (
    BOARD,
    SEEN,
    TAKEN,
    TRUE,
    bootstrap,
    contents,
    edit,
    rows_of,
    table_lines,
    tables,
    without_pictures,
    work_in,
)


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder to work in, with a target, detections and their truth; without pictures."""
    without_pictures(monkeypatch)
    return work_in(tmp_path, monkeypatch)


def small_targets() -> dict[str, TargetGeometry]:
    """The paper's two kinds of target with few and large rings."""
    plane = BoardSpec(
        size_mm=(88, 64), thickness_mm=5, columns=7, rows=5, lattice="square", ring_diameter_mm=8.4, ring_ratio=0.45,
        pitch_mm=12, border_mm=0, margin_mm=1, dots=True,
    )  # fmt: skip
    solid = IcoSpec(
        edge_mm=50, rings_per_side=5, ring_diameter_mm=5.6, ring_ratio=0.45, pitch_mm=8, border_mm=1, margin_mm=0.5
    )
    return {"board": lay_out(plane), "icosahedron": lay_out(solid)}


@pytest.fixture
def small_paper(monkeypatch: pytest.MonkeyPatch) -> None:
    """The paper's study with a small camera, near and small targets, and few photos and samples."""
    Path("camera.json").write_text(camera_to_json(camera("opencv", (448, 336), 480.0)))
    monkeypatch.setattr(paper_study, "CAMERA", "camera.json")
    monkeypatch.setattr(paper_study, "DISTANCE_MM", 150.0)
    monkeypatch.setattr(paper_study, "paper_targets", small_targets)
    monkeypatch.setattr(paper_study, "SIZES", (8, 20))
    monkeypatch.setattr(paper_study, "quick_study", lambda out, seed: paper_study.PaperStudy(out, 10, 6, seed))


def times(place: str) -> dict[Path, int]:
    """When the files of a folder were written."""
    return {path: path.stat().st_mtime_ns for path in Path(place).rglob("*") if path.is_file()}


def stopped(*arguments: object, **options: object) -> None:
    raise KeyboardInterrupt


def test_the_papers_study_from_nothing_and_again(small_paper: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """Targets, photos, detections, samples and tables from nothing; what is there is kept, and only gone on with."""
    command = ("study", "paper", "--quick", "--jobs", "1", "-o", "out")
    with monkeypatch.context() as patch:
        patch.setattr(paper_study, "make_detections", stopped)
        answer = calib(*command)
    assert (answer.code, answer.out) == (130, "")
    assert "--resume" in answer.err
    photos = times("out/photos")
    assert len(photos) == 2 * 2 * (10 + 1)

    answer = calib(*command)
    assert (answer.code, answer.err) == (0, "")
    assert times("out/photos") == photos
    lines = table_lines()
    wanted = {
        (target, sampling, sightings, size)
        for target in TARGETS for sampling in ("binary", "area") for sightings in ("all", "<= 75 deg")
        for size in ("8", "20")
    }  # fmt: skip
    assert {(line["target"], line["sampling"], line["sightings"], line["size"]) for line in lines} == wanted
    assert {line["samples"] for line in lines} == {"6"}
    for line in lines:
        value = paper_value(line["target"], line["metric"], int(line["size"]))
        assert (line["paper_mu"] == "") == (value is None)
        assert line["mu"] != ""
    views = {(line["sampling"], line["sightings"], line["target"]): int(line["pool"]) for line in lines}
    assert all(views[sampling, "<= 75 deg", target] <= views[sampling, "all", target] for sampling, _, target in views)
    mean = {tuple(line[key] for key in ("sampling", "sightings", "target", "size", "metric", "over")):
            float(line["mu"]) for line in lines}  # fmt: skip
    for sightings in ("all", "<= 75 deg"):
        for target in TARGETS:
            # One ray a pixel is worth less than the light of the whole pixel.
            case = (sightings, target, "20", "reprojection", "all")
            assert mean["area", *case] < 0.6 * mean["binary", *case]
    for target in TARGETS:
        # Rings seen flat are measured worse.
        rest = (target, "20", "reprojection", "all")
        assert mean["area", "<= 75 deg", *rest] < 0.95 * mean["area", "all", *rest]
    assert "intersection error is lower for the icosahedron" in answer.out
    assert Path("out/figures/histograms_binary_75_deg.png").exists()

    next(path for path in photos if path.suffix == ".png").unlink()  # it has been searched
    photos = times("out/photos")
    before, rows, files = contents("out"), rows_of(), (photos, times("out/detections"), tables())
    assert "there is a study already" in refused(*command)
    assert "--seed 1" in refused(*command, "--resume", "--seed", "2")
    assert "views" in refused("study", "paper", "--resume", "-o", "out")
    assert contents("out") == before
    answer = calib(*command, "--resume")
    assert (answer.code, answer.err) == (0, "")
    assert (times("out/photos"), times("out/detections"), tables()) == files
    assert rows_of() == rows
    assert "samples in" not in answer.out
    changed = next(Path("out/detections").glob("*.csv"))
    changed.write_text(changed.read_text() + "\n")
    assert "has changed" in refused(*command, "--resume")


def test_a_persons_own_files_are_no_study_of_the_paper(small_paper: None) -> None:
    """A target of another kind where the paper's would be written stays as it is."""
    own = Path("out/targets/board.target.json")
    own.parent.mkdir(parents=True)
    own.write_text(Path("board.target.json").read_text())
    assert "board.target.json" in refused("study", "paper", "--quick", "-o", "out")
    assert contents("out") == {"targets/board.target.json": Path("board.target.json").read_bytes()}


def test_the_whole_study_is_the_papers() -> None:
    """200 photos of each target, 10,000 samples of each case; the quick one has 60 and 300."""
    full, small = paper_study.full_study(Path("x"), 3), paper_study.quick_study(Path("x"), 3)
    assert (full.views, full.samples, full.photo_count) == (200, 10_000, 800)
    assert (small.views, small.samples) == (60, 300)
    assert len({study.photo_folder(one) for study in (full, small) for one in study.sets}) == 8


def test_incidence_is_the_angle_at_the_ring() -> None:
    """Of a camera that stands `h` above the plane, `r` beside the ring's normal, it is the arc tangent of r / h."""
    points = known_points(BOARD)
    seen = replace(SEEN, points=points)
    truth = TRUTH.read(Path("truth.json"))
    pose = TRUE.cam_from_target[seen.view]
    eye = np.array([np.linalg.solve(one, [0, 0, 0, 1])[:3] for one in pose])
    beside: Array = np.linalg.norm((eye - points.position_mm[seen.point])[:, :2], axis=1)
    height = eye[:, 2] - points.position_mm[seen.point][:, 2]
    np.testing.assert_allclose(paper_study.incidence_deg(seen, truth), np.degrees(np.arctan2(beside, height)))


def test_views_that_keep_few_sightings_go() -> None:
    """A view with nine sightings left is not in the pool; one with ten is."""
    rank = np.concatenate([np.arange(count) for count in np.bincount(SEEN.view)])
    kept = paper_study.only(SEEN, rank < np.where(SEEN.view == 3, 9, np.where(SEEN.view == 5, 10, 20)))
    names = set(SEEN.view_names)
    assert names - set(kept.view_names) == {SEEN.view_names[3]}
    assert (np.bincount(kept.view) >= 10).all()


@pytest.mark.parametrize("sizes", ["0", "-1", "many", "", "20,,50", "1e3", "２０", "9" * 5000])
def test_sizes_are_whole_numbers_each_once(sizes: str) -> None:
    """Of views, from 1 to 100000; the value is named."""
    assert (sizes[:9] or "''") in refused(*TAKEN, "-o", "out", f"--sizes={sizes}")


def some(views: int) -> Observations:
    """What the first few views see."""
    return keep_sightings(SEEN, SEEN.view < views)


def other_target() -> None:
    Path("board.target.json").unlink()
    write_inputs(SEEN, board(11, 9))
    write_detections(Path("detections.csv"), detections_of(SEEN, BOARD), BOARD)


def other_photos() -> None:
    text = Path("truth.json").read_text()
    Path("truth.json").write_text(text.replace('"view_', '"photo_'))


def one_view() -> None:
    write_inputs(some(1), BOARD)


def few_points() -> None:
    """Seven rings a view: eight equations beside those for its pose, and the camera has nine parameters."""
    rng = np.random.default_rng(0)
    rows = np.concatenate([rng.choice(np.flatnonzero(SEEN.view == view), 7, replace=False) for view in range(14)])
    write_inputs(keep_sightings(SEEN, np.isin(np.arange(len(SEEN.view)), rows)), BOARD)


@pytest.mark.parametrize(
    ("spoil", "says"),
    [(other_target, "layout"), (other_photos, "photo_0000.png"), (one_view, "more photos"), (few_points,
     "size 1: so few views give at most 8 equations for 9 parameters of the camera; draw 2 or more")],
)  # fmt: skip
def test_inputs_that_do_not_fit_are_refused(spoil: Callable[[], None], says: str) -> None:
    """Detections of another target, the truth of other photos, too few views or points: one line, no study."""
    spoil()
    assert says in refused(*TAKEN, "--truth", "truth.json", "--sizes", "1", "-o", "out")
    assert not Path("out").exists()


def test_a_study_is_not_changed_by_another(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without --resume, or with another seed, option or input, a study stays as it is; a line says why, at once."""
    truth = ("--truth", "truth.json")
    bootstrap(*truth, samples=3)
    before = contents("out")
    with monkeypatch.context() as patch:
        patch.setattr(pool, "make_pool", lambda *_: pytest.fail("nothing is to be solved"))
        for options, says in (
            (truth, "--resume"),
            ((*truth, "--resume", "--seed", "2"), "seed 1, not 2"),
            ((*truth, "--resume", "--model", "opencv"), "'opencv'"),
            ((*truth, "--resume", "--unweighted"), "weighted"),
            ((*truth, "--resume", "--fix", "k3=0"), "k3=0"),
        ):
            assert says in refused(*TAKEN, *options, "--sizes", "6", "-o", "out")
    assert "truth" in refused(*TAKEN, "--resume", "--sizes", "6", "-o", "out")
    for name in ("detections.csv", "board.target.json", "truth.json"):
        Path(name).write_text(Path(name).read_text() + "\n")
        assert "has changed" in refused(*TAKEN, *truth, "--resume", "--sizes", "6", "-o", "out")
        Path(name).write_text(Path(name).read_text()[:-1])
    assert contents("out") == before


def test_a_target_of_another_name_is_another_study() -> None:
    """The name decides what is drawn, so a study that is gone on with keeps it: no second set of samples beside."""
    bootstrap(samples=3)
    Path("board.target.json").rename("plate.target.json")
    options = ("--target", "plate.target.json", "--sizes", "6", "--samples", "3", "--resume", "-o", "out")
    assert "plate" in refused(*instead(TAKEN, options))
    assert len(rows_of()) == 3


@pytest.mark.parametrize(
    ("statement", "says"), [("DELETE FROM sample", "no samples"), ("UPDATE cases SET model = 'periscope'", "periscope")]
)
def test_a_study_that_tells_nothing_is_not_drawn(statement: str, says: str) -> None:
    """Its tables stay as they were."""
    bootstrap(samples=3)
    edit(statement)
    before = contents("out")
    assert says in refused("study", "plot", "out")
    assert contents("out") == before
