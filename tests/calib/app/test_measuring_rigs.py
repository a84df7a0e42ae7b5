"""`calib.measure` and `calib measure` from a rig: one answer from its folder and its value, and what is refused."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib.app.measure import measure
from calib.core.types import keep_frames
from calib.judge.folders import write_rig
from calib.observe.calibration_file import Provenance
from designer.base.errors import InputError
from designer.target import load_target, target_to_json
from tests.support.as_built_scenes import plate, rig_before_print, solid
from tests.support.command_line import calib


def test_a_rig_measures_a_print_in_python_and_on_the_command_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Frames that are held out show the gain; the command has the same target, and says how to solve the rig with it.

    The cameras keep their models, and the record says which.
    """
    monkeypatch.chdir(tmp_path)
    found, _ = rig_before_print()
    write_rig(Path("rig"), found, Provenance("test 1"))
    Path("ico.target.json").write_text(target_to_json(solid()))
    measured = measure(solid(), rig=found, held_out=0)
    answer = calib("measure", "ico.target.json", "--rig", "rig", "--held-out", "2", "-o", "built.target.json", "--json")
    assert answer.code == 0, answer.err
    built = load_target(Path("built.target.json"))
    assert built.center_mm == pytest.approx(measured.target.center_mm, abs=1e-6)
    assert json.loads(answer.out)["next"][0].startswith("calib rig built.target.json --table rig/sightings.csv")
    record = json.loads(Path("built.as_built.json").read_text())
    assert record["held_out"]["is_better"]
    assert record["settings"]["rig"] == "rig"
    assert record["settings"]["model"] == "opencv"


def test_what_does_not_fit_a_rig_is_refused(tmp_path: Path) -> None:
    """One line for what is given twice, another target, too few frames, a rig that is not determined, no rig at all."""
    found, _ = rig_before_print()
    with pytest.raises(InputError, match="--rig: the rig has its photos"):
        measure(solid(), "seen.csv", rig=found)
    with pytest.raises(InputError, match="--rig: the rig has its photos"):
        measure(solid(), rig=found, model="opencv")
    with pytest.raises(InputError, match="saw another target"):
        measure(plate(), rig=found)
    two = keep_frames(found.observations, np.arange(found.observations.frame_count) < 2)
    with pytest.raises(InputError, match="2 frames"):
        measure(solid(), rig=replace(found, observations=two))
    with pytest.raises(InputError, match="do not determine"):
        measure(solid(), rig=replace(found, status="degenerate", remarks=("one view of a plane",)))
    with pytest.raises(InputError, match="rig_calibration"):
        measure(solid(), rig=tmp_path)
