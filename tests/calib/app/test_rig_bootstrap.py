"""Samples of a rig's frames: what is drawn, honest sigmas and others, and the command."""

import json
import math
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from calib.app.study_bootstrap import rig_bootstrap
from calib.judge.folders import write_rig
from calib.observe.calibration_file import Provenance
from calib.rigs.problem import CameraChoice
from calib.rigs.result import RigCalibration
from calib.rigs.solve import solve_rig
from calib.rigs.target_error import with_target_error
from calib.solver.calibration import plane_bend
from calib.solver.priors import ParameterPrior
from calib.solver.problem import SolveOptions
from calib.studies.rig_bootstrap import drawn_frames, frame_pool, identity
from designer.base.errors import InputError
from designer.tolerance.made import how_made
from tests.support.as_built_scenes import rig_before_print, solid
from tests.support.command_line import calib, files_in
from tests.support.rig_views import stereo_pair


@cache
def _found() -> RigCalibration:
    """A pair before a target as drawn."""
    return solve_rig(stereo_pair(frames=12).observations, [CameraChoice("opencv")] * 2)


def test_a_frame_that_is_drawn_twice_is_two_frames() -> None:
    """With the sightings of each camera that saw it; those that are not drawn are gone."""
    seen = rig_before_print()[0].observations
    drawn = drawn_frames(seen, np.array([2, 2, 5]))
    assert drawn.frame_count == 3
    for camera, (own, rows) in enumerate(zip(drawn.sightings, drawn.frame, strict=True)):
        whole, frames = seen.sightings[camera], seen.frame[camera]
        assert rows.tolist() == [number for number, frame in enumerate((2, 2, 5)) if frame in frames]
        for view, number in enumerate(rows.tolist()):
            place = int(np.flatnonzero(frames == (2, 2, 5)[number])[0])
            assert np.array_equal(own.center_px[own.view == view], whole.center_px[whole.view == place])


def test_samples_scatter_as_honest_sigmas_say_and_show_those_that_are_not() -> None:
    """With a target as drawn about as stated; of a print solved by its drawing far more than its noise."""
    honest = rig_bootstrap(_found(), samples=10)
    assert 0.6 < honest.ratio < 1.5
    assert honest.failed == 0
    assert honest.pairs[0].baseline_spread_mm == pytest.approx(honest.pairs[0].baseline_sigma_mm, rel=0.6)
    few, again = (rig_bootstrap(_found(), samples=2, seed=3) for _ in range(2))
    assert again.pairs == few.pairs
    doubted = rig_bootstrap(replace(_found(), capture_covariance=_found().covariance), samples=2, seed=3)
    assert doubted.pairs[0].place_sigma_mm == pytest.approx(few.pairs[0].place_sigma_mm, rel=1e-6)
    printed, _ = rig_before_print()
    by_drawing = rig_bootstrap(with_target_error(printed, how_made(solid(), "fdm-dual")), samples=5)
    assert by_drawing.ratio > 2
    assert by_drawing.ratio_of_all < 0.5 * by_drawing.ratio
    assert math.isnan(honest.ratio_of_all)


def test_samples_are_kept_and_gone_on_with(tmp_path: Path) -> None:
    """More samples of the same rig are as if drawn at once; those of another rig or seed do not come into the file."""
    rig_bootstrap(_found(), samples=2, out=tmp_path)
    more = rig_bootstrap(_found(), samples=4, out=tmp_path, resume=True, jobs=1)
    assert more.pairs == rig_bootstrap(_found(), samples=4).pairs
    with pytest.raises(InputError, match="--resume"):
        rig_bootstrap(_found(), samples=2, out=tmp_path)
    with pytest.raises(InputError, match="seed"):
        rig_bootstrap(_found(), samples=2, seed=2, out=tmp_path, resume=True)
    with pytest.raises(InputError, match=r"camera .* give the same files|camera left has changed"):
        rig_bootstrap(rig_before_print()[0], samples=2, out=tmp_path, resume=True)


def test_samples_are_solved_as_the_rig_was() -> None:
    """With its board's bend and what was believed of it; what is known of lenses makes it another study."""
    found = _found()
    bend = plane_bend(found.observations.points)
    bent = replace(found, target_bend=bend.told(np.zeros(5), np.eye(5), np.arange(1.0, 6.0)))
    options = frame_pool(bent, SolveOptions()).options
    assert (options.free_bend, options.bend_sigma_mm) == (True, (1.0, 2.0, 3.0, 4.0, 5.0))
    old = frame_pool(replace(found, target_bend=bend), SolveOptions()).options
    assert (old.free_bend, old.bend_sigma_mm) == (True, None)
    known = replace(found, priors=((ParameterPrior("fx_px", 1250.0, 10.0),), ()))
    one, other, third = (identity(frame_pool(rig, SolveOptions()), 1) for rig in (found, bent, known))
    assert one != other
    assert one != third


def test_the_command_tells_the_spread_of_a_rig(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A folder with its page; options of studies of one camera are refused, as are rigs that give no samples."""
    monkeypatch.chdir(tmp_path)
    write_rig(Path("rig"), _found(), Provenance("test 1"))
    words = ("study", "bootstrap", "--rig", "rig", "--samples", "2", "-o", "out")
    answer = calib(*words, "--json")
    assert answer.code == 0, answer.err
    told = json.loads(answer.out)["answer"]
    assert told["samples"] == 2
    assert told["pairs"][0]["names"] == ["left", "right"]
    assert files_in(Path("out")) == {"rig_bootstrap.json", "page.json", "index.html", "study.sqlite"}
    assert calib(*words, "--detections", "seen.csv").code == 2
    assert calib("study", "bootstrap", "-o", "out").code == 2
    with pytest.raises(InputError, match="do not determine"):
        rig_bootstrap(replace(_found(), status="degenerate", remarks=("a plane",)))
    with pytest.raises(InputError, match="time offsets"):
        rig_bootstrap(replace(_found(), delay_s=np.zeros(2)))
