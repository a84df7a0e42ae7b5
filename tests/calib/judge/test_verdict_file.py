"""`verdict.json`: written and read back, and safe against files that were tampered with."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from calib.draw.run_tables import check_findings
from calib.judge.coverage import coverage_of
from calib.judge.halves import Halves, NoHalves, halves_apart
from calib.judge.judge import VERDICT, VERDICT_FILE, Judged
from calib.judge.verdict import Check
from calib.solver.calibration import Calibration
from designer.base.errors import InputError
from designer.page.terminal import say_findings
from tests.support.verdict_cases import judge_run, judged, sightings, solved


@pytest.fixture(scope="module")
def run() -> Judged:
    """A verdict with half solutions."""
    return judged(sightings(views=6), models=("opencv", "luhmann"))


@pytest.fixture(scope="module")
def calibrations() -> list[Calibration]:
    """What it is about."""
    return solved(sightings(views=6), ("opencv", "luhmann"))


def _put(folder: Path, document: object) -> Path:
    (folder / VERDICT_FILE).write_text(document if isinstance(document, str) else json.dumps(document))
    return folder


def test_it_reads_back_bit_for_bit(run: Judged, tmp_path: Path) -> None:
    """What is read is what was written: verdict, limits, and cameras with their covariances."""
    (tmp_path / VERDICT_FILE).write_bytes(VERDICT.text(run))
    again = VERDICT.read(tmp_path / VERDICT_FILE)
    assert (again.verdict, again.criteria) == (run.verdict, run.criteria)
    assert VERDICT.text(again) == VERDICT.text(run)
    assert isinstance(again.halves, Halves)
    assert isinstance(run.halves, Halves)
    for one, other in zip(again.halves.pairs, run.halves.pairs, strict=True):
        assert np.array_equal(one[0].known.camera.params, other[0].known.camera.params)
        assert np.array_equal(one[1].known.param_covariance, other[1].known.param_covariance)


def test_it_suffices_to_judge_again(run: Judged, calibrations: list[Calibration], tmp_path: Path) -> None:
    """With the calibrations beside it the same verdict comes out without solving, and the map of the halves."""
    (tmp_path / VERDICT_FILE).write_bytes(VERDICT.text(run))
    stored = VERDICT.read(tmp_path / VERDICT_FILE)
    again = judge_run(calibrations, 0, stored.halves, stored.criteria)
    assert [(one.name, one.grade) for one in again.verdict.checks] == [
        (one.name, one.grade) for one in run.verdict.checks
    ]
    assert isinstance(stored.halves, Halves)
    shown = halves_apart(stored.halves, coverage_of(calibrations[0]))
    assert shown is not None
    assert np.isfinite(shown.length_px).any()


def test_a_verdict_without_halves_keeps_the_reason(run: Judged, tmp_path: Path) -> None:
    """Why there are no halves is stored too."""
    (tmp_path / VERDICT_FILE).write_bytes(VERDICT.text(replace(run, pairs=None, no_halves="3 photos cannot be halved")))
    assert VERDICT.read(tmp_path / VERDICT_FILE).halves == NoHalves("3 photos cannot be halved")


_NUMBER = st.sampled_from([0.0, 1e-300, 1e-9, 1.0, 1e5, 1e9, 1e29, 1e300, -1.0, -1e9])


@settings(max_examples=20, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data(), numbers=st.lists(_NUMBER, min_size=1, max_size=3))
def test_cameras_that_were_tampered_with_are_judged_or_refused(
    run: Judged, calibrations: list[Calibration], tmp_path: Path, data: st.DataObject, numbers: list[float]
) -> None:
    """Half solutions of any numbers that read give a verdict that can be written: no crash, no number without end."""
    document = json.loads(VERDICT.text(run))
    half = document["halves"][data.draw(st.integers(0, len(document["halves"]) - 1))][data.draw(st.integers(0, 1))]
    for number in numbers:
        one, other = (data.draw(st.integers(0, 8)) for _ in range(2))
        if data.draw(st.booleans()):
            half["camera"]["parameters"][list(half["camera"]["parameters"])[one]] = number
        else:
            half["param_covariance"][one][other] = half["param_covariance"][other][one] = number
    if _fault(_put(tmp_path, document)) is None:
        stored = VERDICT.read(tmp_path / VERDICT_FILE)
        VERDICT.text(judge_run(calibrations, 0, stored.halves, stored.criteria))


def _fault(folder: Path) -> str | None:
    """What is said of the verdict in a folder; None if it reads."""
    try:
        VERDICT.read(folder / VERDICT_FILE)
    except InputError as error:
        return str(error)
    return None


def test_a_folder_without_a_verdict_says_so(tmp_path: Path) -> None:
    """A missing file is an input error, not a crash."""
    with pytest.raises(InputError, match=VERDICT_FILE):
        VERDICT.read(tmp_path / VERDICT_FILE)


def test_texts_are_no_markup(run: Judged, capsys: pytest.CaptureFixture[str]) -> None:
    """A sentence from a file is shown as it is: no colours, no escape sequences."""
    evil = Check("x", "[red]title[/red]", "bad", None, "", 0.0, 0.0, False, "[link=file:///]\x1b[31m\x07sentence")
    verdict = replace(run.verdict, checks=(evil,))
    say_findings(check_findings(verdict))
    text = capsys.readouterr().out
    assert text.count("[red]title[/red]") == 1
    assert "[link=file:///]" in text
    assert "\x1b" not in text
