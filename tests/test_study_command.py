"""`calib study`, run as a user runs it: bootstraps, the paper's study at a small scale, and their pictures again."""

import csv
import io
import json
import os
import re
import shlex
import signal
import sqlite3
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import FrameType

import numpy as np
import pytest
from numpy.typing import NDArray

from calib.camera_file import camera_to_json
from calib.inputs.dataset import write_detections
from calib.inputs.observations import known_points
from calib.render.job import RenderJob, truth_text
from calib.render.options import RenderOptions
from calib.results.truth import read_truth
from calib.sightings import keep_sightings
from calib.solver.problem import pack
from calib.studies import paper_sets, paper_study
from calib.studies.figures import SUFFIXES
from calib.studies.gradients import gradients_of
from calib.studies.paper_table import TARGETS, paper_value
from calib.studies.statistics import METRICS
from calib.types import Observations
from designer.layout import lay_out
from designer.spec import BoardSpec, IcoSpec
from designer.target import TargetGeometry
from tests.calibrations import board, camera, example
from tests.command_line import Answer, calib, detections_of, files_in, refused, write_inputs

ROOT = Path(__file__).parent.parent
BOARD = board()
TRUE = example(BOARD, np.random.default_rng(8), views=14, noise_px=0.05)
SEEN = TRUE.observations
TABLES = ("table.csv", "table.json", "table.md")
TAKEN = ("study", "bootstrap", "--target", "board.target.json", "--detections", "detections.csv")
COLUMN = {"reprojection": 4, "intersection": 5, "reconstruction": 6, "pose": 7}
PARAMS = 8
"""Places in a row of a study file."""


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder to work in, with a target, detections and their truth."""
    monkeypatch.chdir(tmp_path)
    write_inputs(SEEN, BOARD)
    Path("truth.json").write_text(truth_text(RenderJob(BOARD, TRUE.camera, TRUE.cam_from_target, RenderOptions(), 0)))
    return tmp_path


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pictures are named, but not drawn, which takes longer than all else."""
    monkeypatch.setattr("calib.studies.figures.files_of", named)


def named(place: Path, height_px: int, draw: object) -> dict[Path, bytes]:
    """The files of a picture without the picture."""
    return {place.with_name(f"{place.name}.{suffix}"): b"picture" for suffix in SUFFIXES}


def bootstrap(*options: object, out: str = "out", sizes: str = "6", samples: int = 8) -> Answer:
    """Run a bootstrap that must go well."""
    answer = calib(*TAKEN, "--sizes", sizes, "--samples", samples, "--jobs", 1, "-o", out, *options)
    assert (answer.code, answer.err) == (0, ""), answer
    return answer


def rows_of(path: str | Path = "out/study.sqlite") -> list[tuple[object, ...]]:
    """All samples of a study file, by case and number."""
    connection = sqlite3.connect(path)
    rows = connection.execute('SELECT * FROM sample ORDER BY "case", number').fetchall()
    connection.close()
    return rows


def edit(statement: str, *values: object, path: str = "out/study.sqlite") -> None:
    """Change a study file by hand."""
    connection = sqlite3.connect(path)
    connection.execute(statement, values)
    connection.commit()
    connection.close()


def contents(place: str | Path) -> dict[str, bytes]:
    """All files of a folder, but for the two that SQLite may keep beside its own."""
    return {
        name: Path(place, name).read_bytes()
        for name in sorted(files_in(Path(place)))
        if Path(place, name).is_file() and not name.endswith(("-wal", "-shm"))
    }  # fmt: skip


def tables(place: str = "out") -> dict[str, bytes]:
    """The tables of a study."""
    return {name: Path(place, name).read_bytes() for name in TABLES}


def table_lines(place: str = "out") -> list[dict[str, str]]:
    """The lines of the table for other programs."""
    return list(csv.DictReader(io.StringIO(Path(place, "table.csv").read_text())))


@contextmanager
def seconds_at_most(limit: int) -> Iterator[None]:
    """Fail where a program would wait for ever."""

    def stop(number: int, frame: FrameType | None) -> None:
        raise AssertionError("waits for ever")

    before = signal.signal(signal.SIGALRM, stop)
    signal.alarm(limit)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def start(*options: object) -> subprocess.Popen[str]:
    """A bootstrap in a program and process group of its own, as a terminal starts it."""
    command = [sys.executable, "-m", "calib.cli", *TAKEN, "--jobs", "1", "-o", "out", *map(str, options)]
    return subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )  # fmt: skip


def wait_for_samples(process: subprocess.Popen[str], least: int) -> None:
    """Wait until a running study has kept some samples."""
    end = time.monotonic() + 60
    while time.monotonic() < end and process.poll() is None:
        try:
            connection = sqlite3.connect("file:out/study.sqlite?mode=ro", uri=True)
            (count,) = connection.execute("SELECT count(*) FROM sample").fetchone()
            connection.close()
        except sqlite3.Error:
            count = 0
        if count >= least:
            return
        time.sleep(0.01)
    process.kill()
    raise AssertionError(process.communicate())


def test_the_table_says_what_the_samples_are(quick: None, folder: Path) -> None:
    """All errors of all sizes, one larger than the pool too: mean, sigma and percentiles are those of the rows kept."""
    answer = bootstrap("--truth", "truth.json", sizes="6,40", samples=25)
    assert files_in(folder / "out") == {*TABLES, "study.sqlite"} | {
        f"figures/{name}.{suffix}" for name in ("histograms", "correlations", "sigma") for suffix in SUFFIXES
    }
    lines = table_lines()
    assert [(line["size"], line["metric"], line["over"]) for line in lines] == [
        (size, metric.name, over) for size in ("6", "40") for over in ("all", "converged") for metric in METRICS
    ]
    for line in lines:
        of_size = [row for row in rows_of() if str(row[0]).endswith(f"/{line['size']}")]
        values = np.array([row[COLUMN[line["metric"]]] for row in of_size], dtype=float)
        assert (line["pool"], line["samples"], line["converged"], line["count"]) == ("14", "25", "25", "25")
        found = [float(line[name]) for name in ("mu", "sigma", "percentile_low", "percentile_high")]
        np.testing.assert_allclose(found, [values.mean(), values.std(ddof=1), *np.percentile(values, [2.5, 97.5])])
    document = json.loads(Path("out/table.json").read_text())
    assert [case["size"] for case in document["cases"]] == [6, 40]
    assert "Ours over the paper" not in Path("out/table.md").read_text()
    for path in TABLES:
        assert str(folder) not in Path("out", path).read_text()
    assert re.search(r"^50 samples in .* by 1 process$", answer.out, re.MULTILINE)
    assert max(abs(float(line["mu"])) for line in lines if line["metric"] == "pose") < 5.0  # mm, of about 300


@pytest.mark.parametrize(
    ("options", "params", "constant"),
    [(("--fix", "k2=0.05"), 9, {5: 0.05}), (("--model", "pinhole"), 4, {}), (("--model", "opencv", "--fix", "k3=0"), 9,
     {8: 0.0})],
)  # fmt: skip
def test_options_reach_every_sample(
    quick: None, options: Sequence[str], params: int, constant: dict[int, float]
) -> None:
    """Each sample is solved with the model and the fixed parameters asked for; without a truth no pose is wrong."""
    answer = bootstrap(*options)
    for row in rows_of():
        kept = row[PARAMS]
        assert isinstance(kept, bytes)
        values = np.frombuffer(kept, dtype="<f8")
        assert len(values) == params
        assert {place: values[place] for place in constant} == pytest.approx(constant)
        assert row[COLUMN["pose"]] is None
    assert next(line["mu"] for line in table_lines() if line["metric"] == "pose") == ""
    assert re.search(r"^6 +ours +.* - +- +8 *$", answer.out, re.MULTILINE)


def test_weights_count(quick: None) -> None:
    """Weighted by their covariances, observations give other cameras than all alike."""
    detections = detections_of(SEEN, BOARD)
    uneven = [replace(one, cov_px2=one.cov_px2 * (1 + 50 * (n % 2))) for n, one in enumerate(detections)]
    write_detections(Path("detections.csv"), uneven, BOARD, detector="test")
    bootstrap(samples=2)
    bootstrap("--weighted", out="weighted", samples=2)
    assert all(a[PARAMS] != b[PARAMS] for a, b in zip(rows_of(), rows_of("weighted/study.sqlite"), strict=True))


def test_gone_on_with_is_as_if_done_at_once(quick: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """More samples and more sizes are added to what is there, which is not computed again; the tables are the same."""
    bootstrap("--truth", "truth.json", out="once", sizes="6,9", samples=11)
    bootstrap("--truth", "truth.json", sizes="6", samples=5)
    first = rows_of()
    answer = bootstrap("--truth", "truth.json", "--resume", sizes="6,9", samples=11)
    assert re.search(r"^17 samples in .*, 5 were there$", answer.out, re.MULTILINE)
    assert [row for row in rows_of() if row in first] == first
    assert rows_of() == rows_of("once/study.sqlite")
    assert tables() == tables("once")
    monkeypatch.setattr("calib.studies.runner._workers", lambda *_: pytest.fail("there is nothing to compute"))
    answer = bootstrap("--truth", "truth.json", "--resume", sizes="6,9", samples=11)
    assert "samples in" not in answer.out
    assert tables() == tables("once")


def test_another_seed_draws_other_samples(quick: None) -> None:
    """The seed decides the samples; the same seed gives the same ones."""
    for out, seed in (("a", 1), ("b", 1), ("c", 2)):
        bootstrap("--seed", seed, out=out, samples=3)
    assert rows_of("a/study.sqlite") == rows_of("b/study.sqlite")
    assert not set(rows_of("a/study.sqlite")) & set(rows_of("c/study.sqlite"))


def test_killed_and_gone_on_with_is_as_if_undisturbed(quick: None) -> None:
    """After SIGKILL the study can be looked at as it is, and ends in the same files as one that nothing disturbed."""
    options = ("--truth", "truth.json", "--sizes", "6,9", "--samples", 400)
    process = start(*options)
    wait_for_samples(process, 20)
    process.kill()
    process.communicate()
    kept = len(rows_of())
    assert 20 <= kept < 800
    assert calib("study", "plot", "out").code == 0
    assert sum({line["size"]: int(line["samples"]) for line in table_lines()}.values()) == kept
    answer = bootstrap("--truth", "truth.json", "--resume", sizes="6,9", samples=400)
    assert f", {kept} were there" in answer.out
    bootstrap("--truth", "truth.json", out="once", sizes="6,9", samples=400)
    assert tables() == tables("once")
    assert rows_of() == rows_of("once/study.sqlite")


def test_a_sum_does_not_depend_on_where_its_numbers_lie() -> None:
    """Costs and gradients of the same views are the same to the last bit in any state of the memory."""
    problem = pack(SEEN, weighted=False)
    poses = np.array(TRUE.cam_from_target)
    poses[:, :3, 3] += poses[:, :3, :3] @ problem.origin_mm
    rng, found, between = np.random.default_rng(0), set(), []
    for views in 20 * [np.arange(14), np.arange(0, 14, 2), np.array([3, 4, 9])]:
        between.append(np.empty(rng.integers(1, 5000)))
        there = gradients_of(problem, views, TRUE.camera, poses[views])
        found.add((len(views), there.cost.tobytes(), there.gradient.tobytes()))
    assert len(found) == 3


def test_ctrl_c_leaves_a_study_to_go_on_with() -> None:
    """A bootstrap stopped from the terminal ends with one line that says how to go on, and no half tables."""
    process = start("--sizes", "6,9", "--samples", 5000)
    wait_for_samples(process, 20)
    os.killpg(process.pid, signal.SIGINT)
    said, complained = process.communicate(timeout=30)
    assert process.returncode == 130
    assert re.fullmatch(r"stopped after \d+ of 10000 samples, which are kept; go on with --resume\n", complained)
    assert said == ""
    assert set(contents("out")) == {"study.sqlite"}
    assert len(rows_of()) == int(complained.split()[2])


def test_plot_draws_the_same_again(folder: Path) -> None:
    """Tables and pictures from the file alone are those of the run, byte for byte, and anywhere."""
    bootstrap("--truth", "truth.json", samples=20)
    first = contents("out")
    answer = calib("study", "plot", "out/study.sqlite", "-o", "new/place")
    assert (answer.code, answer.err) == (0, "")
    assert contents("new/place") == {name: content for name, content in first.items() if name != "study.sqlite"}
    assert contents("out") == first
    assert first["figures/histograms.png"].startswith(b"\x89PNG")


def test_what_is_advised_next_works(quick: None) -> None:
    """The command after "next" runs as it stands: in a folder that a shell takes apart, and where plots went too."""
    for answer in (bootstrap(out="my $out"), calib("study", "plot", "my $out", "-o", "elsewhere")):
        (command,) = re.findall(r"calib study plot .*(?= draws)", answer.out)
        assert calib(*shlex.split(command)[1:]).code == 0, command


BAD = {
    "sizes 0": (("--sizes", "0"), "0"),
    "negative": (("--sizes=-1",), "-1"),
    "a word": (("--sizes", "many"), "many"),
    "none": (("--sizes", ""), "''"),
    "a gap": (("--sizes", "20,,50"), "''"),
    "twice": (("--sizes", "20,50,020"), "twice"),
    "no digits": (("--sizes", "1e3"), "1e3"),
    "other digits": (("--sizes", "２０"), "２０"),
    "huge": (("--sizes", "9" * 5000), "100000"),
    "samples": (("--samples", "0"), "samples"),
    "fewer": (("--samples", "-1"), "samples"),
    "jobs": (("--jobs", "0"), "jobs"),
    "seed": (("--seed", "-1"), "seed"),
    "all models": (("--model", "all"), "one model"),
    "no model": (("--model", "fisheye"), "fisheye"),
    "no parameter": (("--fix", "k9=0"), "k9"),
    "no target": (("--target", "nowhere.json"), "nowhere.json"),
    "no detections": (("--detections", "nowhere.csv"), "nowhere.csv"),
    "a folder": (("--detections", "."), "folder"),
    "no truth": (("--truth", "nowhere.json"), "nowhere.json"),
    "no such truth": (("--truth", "board.target.json"), "ringforge.truth"),
    "a file": (("-o", "truth.json"), "truth.json"),
    "no folder": (("-o", "truth.json/x"), "truth.json/x"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_bad_options_are_refused(folder: Path, case: str) -> None:
    """One line that names what is wrong, and nothing is written."""
    before = contents(folder)
    options, says = BAD[case]
    assert says in refused(*TAKEN, "-o", "out", *options)
    assert contents(folder) == before
    assert not Path("out").exists()


def some(views: int) -> Observations:
    """What the first few views see."""
    return keep_sightings(SEEN, SEEN.view < views)


def other_target() -> None:
    Path("board.target.json").unlink()
    write_inputs(SEEN, board(11, 9))
    write_detections(Path("detections.csv"), detections_of(SEEN, BOARD), BOARD, detector="test")


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


def test_points_without_an_image_size_need_one() -> None:
    """A CSV of points says no image size; the one line says how to give it."""
    lines = [
        f"{SEEN.view_names[view]},{u},{v},{x},{y},{z}"
        for view, (u, v), (x, y, z) in zip(SEEN.view, SEEN.center_px, SEEN.points.position_mm[SEEN.point], strict=True)
    ]
    Path("points.csv").write_text("\n".join(["image,u,v,X,Y,Z", *lines]) + "\n")
    assert "--image-size" in refused("study", "bootstrap", "--detections", "points.csv", "-o", "out")
    assert not Path("out").exists()


def test_a_truth_without_end_is_refused() -> None:
    """A pipe that nobody writes to is no truth; it is not waited for."""
    os.mkfifo("pipe")
    with seconds_at_most(10):
        assert "pipe" in refused(*TAKEN, "--truth", "pipe", "-o", "out")


def test_a_scheduler_that_is_not_there_is_refused() -> None:
    """An address that is none ends in one line before anything is computed."""
    pytest.importorskip("distributed")
    assert "nonsense" in refused(*TAKEN, "--sizes", "6", "--dask", "nonsense", "-o", "out")
    assert not Path("out").exists()


def test_a_study_is_not_changed_by_another(quick: None) -> None:
    """Without --resume, or with another seed, option or input, a study stays as it is, and a line says why."""
    bootstrap("--truth", "truth.json", samples=3)
    before = contents("out")
    truth = ("--truth", "truth.json")
    for options, says in (
        (truth, "--resume"),
        ((*truth, "--resume", "--seed", "2"), "seed 1, not 2"),
        ((*truth, "--resume", "--model", "opencv"), "'opencv'"),
        ((*truth, "--resume", "--weighted"), "weighted"),
        ((*truth, "--resume", "--fix", "k3=0"), "k3=0"),
        (("--resume",), "truth"),
    ):
        assert says in refused(*TAKEN, *options, "--sizes", "6", "-o", "out")
    for name in ("detections.csv", "board.target.json", "truth.json"):
        Path(name).write_text(Path(name).read_text() + "\n")
        assert "has changed" in refused(*TAKEN, *truth, "--resume", "--sizes", "6", "-o", "out")
        Path(name).write_text(Path(name).read_text()[:-1])
    refused("study", "paper", "-o", "out")
    refused("study", "paper", "--resume", "-o", "out")
    assert contents("out") == before
    bootstrap(*truth, "--resume", samples=3)


def test_a_target_of_another_name_is_another_study(quick: None) -> None:
    """The name decides what is drawn, so a study that is gone on with keeps it: no second set of samples beside."""
    bootstrap(samples=3)
    Path("board.target.json").rename("plate.target.json")
    options = ("--target", "plate.target.json", "--sizes", "6", "--samples", "3", "--resume", "-o", "out")
    assert "plate" in refused(*TAKEN, *options)
    assert len(rows_of()) == 3


def text(path: Path) -> None:
    path.write_text("no database\n" * 100)


def half(path: Path) -> None:
    path.write_bytes(Path("out/study.sqlite").read_bytes()[:5000])


def other_database(path: Path) -> None:
    edit("CREATE TABLE t (a)", path=str(path))


def with_trigger(path: Path) -> None:
    path.write_bytes(Path("out/study.sqlite").read_bytes())
    edit("CREATE TRIGGER t AFTER INSERT ON sample BEGIN DELETE FROM sample; END", path=str(path))


def a_folder(path: Path) -> None:
    path.mkdir()


@pytest.mark.parametrize("make", [text, half, other_database, with_trigger, a_folder])
def test_what_is_no_study_is_left_alone(quick: None, make: Callable[[Path], None]) -> None:
    """Anything else by the name of a study is neither gone on with, nor drawn, nor written over."""
    bootstrap(samples=2)
    Path("bad").mkdir()
    make(Path("bad/study.sqlite"))
    before = contents("bad")
    for command in ((*TAKEN, "--resume", "-o", "bad"), (*TAKEN, "-o", "bad"), ("study", "plot", "bad")):
        assert "study.sqlite" in refused(*command)
    assert contents("bad") == before


@pytest.mark.parametrize(
    ("statement", "says"),
    [
        ("DELETE FROM sample", "no samples"),
        ("UPDATE sample SET intersection_mm = 'x' WHERE number = 1", "damaged"),
        ("UPDATE sample SET status = '[bold]' WHERE number = 1", "damaged"),
        ("UPDATE sample SET params = x'00' WHERE number = 1", "damaged"),
        ("UPDATE cases SET model = 'fisheye'", "fisheye"),
        ("UPDATE cases SET size = -6", "damaged"),
        ("DELETE FROM identity", "does not say"),
    ],
)
def test_rows_that_no_study_has_written_are_refused(quick: None, statement: str, says: str) -> None:
    """A study that was changed by hand is refused in one line, and its tables stay as they were."""
    bootstrap(samples=3)
    edit(statement)
    before = contents("out")
    assert says in refused("study", "plot", "out")
    assert contents("out") == before


def test_plot_needs_a_study_and_a_place(quick: None) -> None:
    """A folder without a study, another file, and a place that takes no files are refused."""
    bootstrap(samples=2)
    Path("empty").mkdir()
    for arguments in (("empty",), ("nowhere",), ("truth.json",), ("out", "-o", "truth.json")):
        refused("study", "plot", *arguments)
    assert files_in(Path("empty")) == {"."} or not list(Path("empty").iterdir())


@pytest.mark.parametrize(
    "statement",
    [
        "UPDATE sample SET reprojection_px = 1e999, intersection_mm = 1.7e308 * (number % 2), reconstruction_mm = NULL",
        "UPDATE sample SET status = 'failed', params = zeroblob(72)",
    ],
)
@pytest.mark.filterwarnings("error")
def test_samples_may_have_any_errors(statement: str) -> None:
    """Lost samples, with errors beyond all bounds or without any, are counted, and all is drawn."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("calib.studies.figures.files_of", named)
        bootstrap(samples=4)
    edit(statement)
    answer = calib("study", "plot", "out")
    assert (answer.code, answer.err) == (0, ""), answer
    assert {line["samples"] for line in table_lines()} == {"4"}
    json.loads(Path("out/table.json").read_text())


@pytest.mark.filterwarnings("error")
def test_one_sample_of_one_view_is_a_study() -> None:
    """The smallest study has its table and pictures: without a sigma there is nothing said of one."""
    answer = bootstrap("--truth", "truth.json", sizes="1", samples=1)
    assert {line["sigma"] for line in table_lines()} == {""}
    assert "at most - %" not in answer.out
    assert "sigma.png" not in answer.out


NAMES = (
    "board.target.json", "icosahedron.json", "board", "a\nb\x1b[31m.json", "[bold]x.json", "日本語.target.json",
    ".json", os.fsdecode(b"caf\xe9.json"),
)  # fmt: skip


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.filterwarnings("error")
def test_a_target_may_be_called_anything(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A person's own target is told from the paper's, whatever its file is called, and no name steers a terminal."""
    if name.isascii():  # others are drawn too: the font may lack them
        monkeypatch.setattr("calib.studies.figures.files_of", named)
    Path("board.target.json").rename(name)
    options = ("--target", name, "--sizes", "20", "--samples", "3", "--jobs", "1", "-o", "out")
    answer = calib(*TAKEN, *options)
    assert (answer.code, answer.err) == (0, ""), answer
    assert not {line["target"] for line in table_lines()} & {*TARGETS, ""}
    assert {line["paper_mu"] for line in table_lines()} == {""}
    assert "\x1b" not in answer.out + Path("out/table.md").read_text()


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
def small_paper(monkeypatch: pytest.MonkeyPatch, quick: None) -> None:
    """The paper's study with a small camera, near and small targets, and few photos and samples."""
    Path("camera.json").write_text(camera_to_json(camera("opencv", (448, 336), 480.0)))
    monkeypatch.setattr(paper_sets, "CAMERA", "camera.json")
    monkeypatch.setattr(paper_sets, "DISTANCE_MM", 150.0)
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
    pool = {(line["sampling"], line["sightings"], line["target"]): int(line["pool"]) for line in lines}
    assert all(pool[sampling, "<= 75 deg", target] <= pool[sampling, "all", target] for sampling, _, target in pool)
    mean = {tuple(line[key] for key in ("sampling", "sightings", "target", "size", "metric", "over")):
            float(line["mu"]) for line in lines}  # fmt: skip
    for sightings in ("all", "<= 75 deg"):
        for target in TARGETS:
            # One ray a pixel is worth less than the light of the whole pixel.
            case = (sightings, target, "20", "reprojection", "all")
            assert mean["area", *case] < 0.6 * mean["binary", *case]
    assert "intersection error is lower for the icosahedron" in answer.out
    assert "histograms_binary_75_deg.png" in answer.out

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
    truth = read_truth(Path("truth.json"))
    pose = TRUE.cam_from_target[seen.view]
    eye = np.array([np.linalg.solve(one, [0, 0, 0, 1])[:3] for one in pose])
    beside: NDArray[np.float64] = np.linalg.norm((eye - points.position_mm[seen.point])[:, :2], axis=1)
    height = eye[:, 2] - points.position_mm[seen.point][:, 2]
    np.testing.assert_allclose(paper_sets.incidence_deg(seen, truth), np.degrees(np.arctan2(beside, height)))


def test_views_that_keep_few_sightings_go() -> None:
    """A view with nine sightings left is not in the pool; one with ten is."""
    rank = np.concatenate([np.arange(count) for count in np.bincount(SEEN.view)])
    kept = paper_sets.only(SEEN, rank < np.where(SEEN.view == 3, 9, np.where(SEEN.view == 5, 10, 20)))
    names = set(SEEN.view_names)
    assert names - set(kept.view_names) == {SEEN.view_names[3]}
    assert (np.bincount(kept.view) >= 10).all()
