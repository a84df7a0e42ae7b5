"""What errors of a target cost a rig: what must come out, drawn prints beside the prediction, and the command."""

from dataclasses import replace
from functools import cache, partial
from pathlib import Path

import numpy as np
import pytest

from calib.app.tolerance import RigTolerance, rig_tolerance
from calib.renderer.rig_template import HeldTarget, SimulatedRig
from calib.studies.tolerance.rig_costs import cost_of
from designer.base.errors import InputError
from designer.target import target_to_json
from tests.support.as_built_scenes import rig_before_print, solid
from tests.support.command_line import design

FEW = ("scale=0.1%", "skew=0.02deg", "face_tilt=0.05deg")


@cache
def _simulated() -> SimulatedRig:
    return SimulatedRig("pair", "two cameras", "", rig_before_print()[0].rig, HeldTarget((450.0, 700.0)))


def _found(draws: int = 0, seed: int = 1) -> RigTolerance:
    return rig_tolerance(solid(), "fdm-dual-calibrated", _simulated(), changes=FEW, frames=8, draws=draws, seed=seed)


def test_a_scale_costs_lengths_and_baselines_their_share_and_turns_nothing() -> None:
    """It is the same share of each, so of any rig that is known from the true truth; parts add up in squares."""
    study = _found()
    scale = next(one for one in study.costs if one.name == "scale")
    rig = _simulated().rig
    away = [np.linalg.norm(rig.center_mm[a] - rig.center_mm[b]) for b in range(3) for a in range(b)]
    assert scale.baseline_mm == pytest.approx(1e-3 * np.sqrt(np.mean(np.square(away))), rel=0.02)
    assert scale.length_mm == pytest.approx(1e-3 * study.length_mm, rel=1e-3)
    assert scale.turn_rad == 0
    for name in ("baseline_mm", "turn_rad", "point_mm", "length_mm"):
        parts = [getattr(one, name) ** 2 for one in study.costs]
        assert getattr(study.together, name) ** 2 == pytest.approx(sum(parts), rel=1e-3)
    assert [one.point_mm for one in study.costs] == sorted((one.point_mm for one in study.costs), reverse=True)
    assert study.noise.baseline_mm < 0.1 * study.together.baseline_mm


def test_drawn_prints_bear_the_prediction_out() -> None:
    """Simulated and solved from one end to the other, they are off as much as was predicted."""
    study = _found(draws=7)
    assert study.drawn is not None
    for name in ("baseline_mm", "turn_rad", "point_mm", "length_mm"):
        told = np.hypot(getattr(study.together, name), getattr(study.noise, name))
        assert 0.5 < getattr(study.drawn, name) / told < 1.6


def test_drawn_prints_are_kept_and_gone_on_with(tmp_path: Path) -> None:
    """Whatever the jobs and however often it was stopped; where none are drawn there is nothing to go on with."""
    draw = partial(rig_tolerance, solid(), "fdm-dual-calibrated", _simulated(), changes=FEW, frames=8, out=tmp_path)
    draw(draws=1, jobs=1)
    more = draw(draws=2, resume=True).drawn
    at_once = _found(draws=2).drawn
    assert more is not None
    assert at_once is not None
    assert replace(more, size=0.0) == replace(at_once, size=0.0)
    with pytest.raises(InputError, match="--resume: no prints are drawn"):
        draw(linear=True, resume=True)


def test_what_is_not_known_is_nan_and_nothing_is_zero() -> None:
    """A rig of no error costs nothing; one whose covariance is not known is not told of."""
    found, _ = rig_before_print()
    none = cost_of(replace(found, covariance=np.zeros_like(found.covariance)), "nothing")
    assert (none.baseline_mm, none.turn_rad, none.point_mm, none.length_mm) == (0, 0, 0, 0)


def test_what_is_of_studies_of_one_camera_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """And a rig without a distance."""
    monkeypatch.chdir(tmp_path)
    Path("ico.target.json").write_text(target_to_json(solid()))
    _simulated().rig.save("rig.json")
    words = ("tolerance", "ico.target.json", "--errors", "fdm-dual", "--rig", "rig.json", "--frames", "8", "-o", "out")
    assert design(*words).code == 2
    refused = design(*words, "--distance", "450mm..700mm", "--require", "pose=1mm")
    assert refused.code == 2
    assert "--require: does not go with --rig" in refused.err
    assert design(*words, "--distance", "450mm..700mm", "--draws", "-1").code == 2


def test_a_rig_that_never_sees_the_target_is_refused() -> None:
    """In a line that says which camera; so is one camera."""
    blind = replace(_simulated(), held=HeldTarget((5000.0, 6000.0)))
    with pytest.raises(InputError, match="sees the target in no frame"):
        rig_tolerance(solid(), "fdm-dual", blind, frames=4)
    rig = _simulated().rig
    alone = replace(
        rig, names=("a",), cameras=rig.cameras[:1], cam_from_rig=np.eye(4)[None], covariance=None, noise_px=None
    )
    one = replace(_simulated(), rig=alone)
    with pytest.raises(InputError, match="one camera is no rig"):
        rig_tolerance(solid(), "fdm-dual", one)
