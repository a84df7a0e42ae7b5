"""The limits, as templates and as a person's own file; and what `verdict.json` is good for."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calib.draw.run_tables import check_findings
from calib.judge.checks import read_criteria
from calib.judge.coverage import coverage_of
from calib.judge.halves import Halves, halves_apart
from calib.judge.judge import VERDICT, VERDICT_FILE, Judged
from calib.judge.verdict import Check, Criteria, Limits
from calib.solver.calibration import Calibration
from designer.base.errors import InputError
from designer.kinds.presets import preset_names
from designer.page.terminal import say_findings
from tests.support.verdict_cases import judge_run, judged, sightings, solved


def _limits(criteria: Criteria) -> dict[str, Limits]:
    return dict(criteria.limits)


def test_templates_have_a_reason_for_each_number() -> None:
    """All templates read, and each limit says where it comes from."""
    assert preset_names("criteria") == ["metrology", "robotics", "standard"]
    for name in preset_names("criteria"):
        criteria = read_criteria(name)
        assert criteria.name == name
        assert all(len(limits.source) > 10 for limits in _limits(criteria).values())


def test_the_standard_limits_are_those_promised() -> None:
    """95 % of the image to 0.1 px by two standard deviations, 70 % covered, halves within 2 sigma."""
    criteria = read_criteria()
    assert 2 * criteria["uncertainty"].good == 0.1
    assert criteria["coverage"].good == 70
    assert criteria["halves"].good == 2


def test_metrology_is_stricter_and_robotics_is_not() -> None:
    """No limit of metrology is wider than that of standard, none of robotics narrower."""
    strict, standard, wide = (_limits(read_criteria(name)) for name in ("metrology", "standard", "robotics"))
    for name, middle in standard.items():
        sign = -1 if name == "coverage" else 1
        for one in ("good", "usable"):
            low, mid, high = (sign * getattr(limits, one) for limits in (strict[name], middle, wide[name]))
            assert low <= mid <= high, (name, one)


def _own(folder: Path, text: str) -> str:
    path = folder / "own.toml"
    path.write_text(text)
    return str(path)


def test_an_own_file_holds_what_differs(tmp_path: Path) -> None:
    """What a person's file leaves out is as in the standard; units may be written or left out."""
    text = 'title = "ours"\n[coverage]\ngood = 80\nusable = "60 %"\n[halves]\ngood = "1.5 sigma"\nusable = "3sigma"\n'
    own, standard = read_criteria(_own(tmp_path, text)), read_criteria()
    assert (own.title, own.name) == ("ours", "own")
    assert own["coverage"] == Limits(80, 60, "")
    assert own["halves"] == Limits(1.5, 3, "")
    assert own["uncertainty"] == standard["uncertainty"]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[coverag]\ngood = 1\nusable = 0\n", "did you mean"),
        ("[coverage]\ngood = 80\n", "coverage.usable is missing"),
        ("[coverage]\ngood = 40\nusable = 60\n", "must not be less than usable"),
        ("[uncertainty]\ngood = 0.4\nusable = 0.3\n", "must not be more than usable"),
        ('[uncertainty]\ngood = "0.1%"\nusable = "0.3px"\n', "must be a number of px"),
        ("[uncertainty]\ngood = -1\nusable = 1\n", "must be from 0 to 1000px"),
        ("[uncertainty]\ngood = true\nusable = 1\n", "must be from 0"),
        ("[outliers]\ngood = 1\nusable = 101\n", "must be from 0 to 100%"),
        ('title = ""\n', "title"),
    ],
)
def test_faults_are_one_line(tmp_path: Path, text: str, said: str) -> None:
    """A fault in a file is told in one line with the file, the key and the rule."""
    with pytest.raises(InputError) as caught:
        read_criteria(_own(tmp_path, text))
    message = str(caught.value)
    assert "own.toml" in message
    assert said in message
    assert "\n" not in message


def test_an_unknown_template_names_the_nearest() -> None:
    """A misspelt template is answered with the right one."""
    with pytest.raises(InputError, match="metrology"):
        read_criteria("metrolgy")
    with pytest.raises(InputError, match="no such file"):
        read_criteria("nowhere.toml")


@pytest.fixture(scope="module")
def run() -> Judged:
    """A verdict with half solutions."""
    return judged(sightings(views=6), models=("opencv", "luhmann"))


@pytest.fixture(scope="module")
def calibrations() -> list[Calibration]:
    """What it is about."""
    return solved(sightings(views=6), ("opencv", "luhmann"))


def test_it_suffices_to_judge_again(run: Judged, calibrations: list[Calibration]) -> None:
    """With the calibrations beside it the same verdict comes out without solving, and the map of the halves."""
    stored = VERDICT.of(json.loads(VERDICT.text(run)), VERDICT_FILE)
    again = judge_run(calibrations, 0, stored.halves, stored.criteria)
    grades = [[(one.name, one.grade) for one in judged.verdict.checks] for judged in (again, run)]
    assert grades[0] == grades[1]
    assert isinstance(stored.halves, Halves)
    shown = halves_apart(stored.halves, coverage_of(calibrations[0]))
    assert np.isfinite(shown.length_px).any()


_NUMBER = st.sampled_from([0.0, 1e-300, 1e-9, 1.0, 1e5, 1e9, 1e29, 1e300, -1.0, -1e9])


@settings(max_examples=20, deadline=None)
@given(data=st.data(), numbers=st.lists(_NUMBER, min_size=1, max_size=3))
def test_cameras_that_were_tampered_with_are_judged_or_refused(
    run: Judged, calibrations: list[Calibration], data: st.DataObject, numbers: list[float]
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
    try:
        stored = VERDICT.of(document, VERDICT_FILE)
    except InputError:
        return
    VERDICT.text(judge_run(calibrations, 0, stored.halves, stored.criteria))


def test_texts_are_no_markup(run: Judged, capsys: pytest.CaptureFixture[str]) -> None:
    """A sentence from a file is shown as it is: no colours, no escape sequences."""
    evil = Check("x", "[red]title[/red]", "bad", None, "", 0.0, 0.0, False, "[link=file:///]\x1b[31m\x07sentence")
    verdict = replace(run.verdict, checks=(evil,))
    say_findings(check_findings(verdict))
    text = capsys.readouterr().out
    assert text.count("[red]title[/red]") == 1
    assert "[link=file:///]" in text
    assert "\x1b" not in text
