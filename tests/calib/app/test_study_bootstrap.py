"""`calib study bootstrap` and `plot`, run as a user runs them."""

import json
import os
import re
import signal
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from calib.app.study_bootstrap import bootstrap as bootstrap_from_python
from calib.draw.style import SUFFIXES
from calib.solver.problem import pack
from calib.studies.gradients import gradients_of
from calib.studies.statistics import METRICS, TARGETS
from designer.base.errors import InputError
from tests.support.command_line import calib, detections_of, files_in, instead
from tests.support.study_commands import (
    BOARD,
    COLUMN,
    PARAMS,
    SEEN,
    TABLES,
    TAKEN,
    TRUE,
    bootstrap,
    contents,
    nothing_drawn,
    rows_of,
    start,
    table_lines,
    tables,
    wait_for_samples,
    without_pictures,
    work_in,
)
from tests.support.waiting import WITHIN_S

PAGE = {"index.html", "page.json"}


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder to work in, with a target, detections and their truth."""
    return work_in(tmp_path, monkeypatch)


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without pictures."""
    without_pictures(monkeypatch)


def test_the_table_says_what_the_samples_are(quick: None, folder: Path) -> None:
    """All errors of all sizes, one larger than the pool too: mean, sigma and percentiles are those of the rows kept."""
    answer = bootstrap("--truth", "truth.json", sizes="6,40", samples=25)
    assert files_in(folder / "out") == {*TABLES, *PAGE, "study.sqlite"} | {
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
    document = json.loads(Path("out/bootstrap.json").read_text())
    assert [case["size"] for case in document["cases"]] == [6, 40]
    assert "Ours over the paper" not in Path("out/table.md").read_text()
    for path in TABLES:
        assert str(folder) not in Path("out", path).read_text()
    assert re.search(r"^computed +50 samples in [0-9.]+ s$", answer.out, re.MULTILINE)
    assert max(abs(float(line["mu"])) for line in lines if line["metric"] == "pose") < 5.0  # mm, of about 300


def test_python_takes_values_or_files_and_keeps_samples_where_it_is_told(quick: None, folder: Path) -> None:
    """The same samples of both; nothing is written until they are saved, and over no other study."""
    bootstrap(samples=8)
    before = files_in(folder)
    found = bootstrap_from_python("detections.csv", "board.target.json", sizes=[6], samples=8, jobs=1)
    of_values = bootstrap_from_python(detections_of(SEEN, BOARD), BOARD, sizes=[6], samples=8, jobs=1)
    assert files_in(folder) == before
    assert of_values.summaries[0].case.name.split("/")[1:] == found.summaries[0].case.name.split("/")[1:]
    with pytest.raises(InputError, match="there is another study"):
        of_values.save("out")


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
    assert next((line["samples"], line["converged"]) for line in table_lines()) == ("8", "8")
    assert "pose" not in answer.out


def test_killed_and_gone_on_with_is_as_if_undisturbed(quick: None) -> None:
    """After SIGKILL the study can be looked at as it is, and ends in the same files as one that nothing disturbed."""
    options = ("--truth", "truth.json", "--sizes", "6,9", "--samples", 150)
    process = start(*options)
    wait_for_samples(process, 20)
    process.kill()
    process.communicate()
    kept = len(rows_of())
    assert 20 <= kept < 300
    assert calib("study", "plot", "out").code == 0
    assert sum({line["size"]: int(line["samples"]) for line in table_lines()}.values()) == kept
    answer = bootstrap("--truth", "truth.json", "--resume", sizes="6,9", samples=150)
    assert f", {kept} were there" in answer.out
    bootstrap("--truth", "truth.json", out="once", sizes="6,9", samples=150)
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
    said, complained = process.communicate(timeout=WITHIN_S)
    assert process.returncode == 130
    *progress, last = complained.splitlines()
    assert all(line.startswith("sampling: ") for line in progress)  # of which a fast machine shows none
    assert re.fullmatch(r"stopped after \d+ of 10000 samples, which are kept; go on with --resume", last)
    assert said == ""
    assert set(contents("out")) == {"study.sqlite"}
    assert len(rows_of()) == int(last.split()[2])


def test_plot_draws_the_same_again(quick: None) -> None:
    """Tables from the file alone are those of the run, byte for byte, and anywhere, and so are the pictures' names."""
    bootstrap("--truth", "truth.json", samples=20)
    first = contents("out")
    answer = calib("study", "plot", "out/study.sqlite", "-o", "new/place")
    assert (answer.code, answer.err) == (0, "")
    beside = {"study.sqlite", *PAGE}  # the page says what command made the folder
    assert {name: one for name, one in contents("new/place").items() if name not in PAGE} == {
        name: content for name, content in first.items() if name not in beside
    }
    assert contents("out") == first


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
    if "日" not in name:  # which is drawn, too: the font lacks it
        monkeypatch.setattr("calib.draw.style.sheet_files", nothing_drawn)
    Path("board.target.json").rename(name)
    options = ("--target", name, "--sizes", "20", "--samples", "3", "--jobs", "1", "-o", "out")
    answer = calib(*instead(TAKEN, options))
    assert (answer.code, answer.err) == (0, ""), answer
    assert not {line["target"] for line in table_lines()} & {*TARGETS, ""}
    assert {line["paper_mu"] for line in table_lines()} == {""}
    assert "\x1b" not in answer.out + Path("out/table.md").read_text()
