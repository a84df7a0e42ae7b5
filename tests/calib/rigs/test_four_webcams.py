"""Four webcams of others, whose own photos hardly tell their lenses: solved as well as can be, in any order."""

from dataclasses import replace

import numpy as np
import pytest

from calib.core.types import Observations
from calib.rigs.problem import CameraChoice, RigOptions
from calib.rigs.solve import solve_rig
from calib.solver.calibration import Calibration
from calib.solver.problem import SolveOptions
from calib.solver.solve import solve
from tests.benchmarks.bench_rig_real import FOLDER, length_errors, observed, read_corners, shuffled
from tests.support.rig_views import stereo_pair


@pytest.mark.skipif(not FOLDER.is_dir(), reason="the measurements are not beside the project, in ../shared/real")
def test_corners_of_other_frames_are_placed_in_any_order() -> None:
    """Distances between them are off by .95 mm at most (others: 1.217 and .991); no slack is left to single photos."""
    corners = read_corners(FOLDER / "xy.csv")
    is_first = np.isin(corners.frame, np.unique(corners.frame)[::2])
    seen = replace(observed(corners.of(is_first)), time_s=None)
    choices = [CameraChoice("opencv")] * seen.camera_count
    found = solve_rig(seen, choices)
    assert found.slack is None
    assert length_errors(found.rig, corners.of(~is_first))[0] <= 0.95
    for seed in range(6):  # in some orders a camera alone ends in a lens from which the rig has no way to the minimum
        rng = np.random.default_rng(seed)
        mixed = shuffled(seen, rng)
        rounded = [
            replace(one, center_px=one.center_px + rng.normal(0, 1e-9, one.center_px.shape)) for one in mixed.sightings
        ]
        again = solve_rig(
            replace(mixed, sightings=tuple(rounded)), choices, RigOptions(reference=mixed.camera_names.index("cam0"))
        )
        assert again.status == "converged"
        rows = [again.rig.row(name) for name in found.rig.names]
        np.testing.assert_allclose(again.rig.center_mm[rows], found.rig.center_mm, atol=0.05)


def test_photos_that_tell_their_lens_may_have_slack_and_others_none(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of frames of a moving target that two good cameras took one after the other; of frames that fit, none.

    Each camera is solved alone once, however often the rig is.
    """
    solved: list[str] = []

    def counted(seen: Observations, model: str, options: SolveOptions) -> Calibration:
        solved.append(model)
        return solve(seen, model, options)

    for module in ("start", "solve"):
        monkeypatch.setattr(f"calib.rigs.{module}.solve", counted)
    pair = stereo_pair(frames=10).observations
    choices = [CameraChoice("opencv")] * 2
    assert solve_rig(pair, choices).slack is None
    right = pair.sightings[1]
    shift_px = np.random.default_rng(0).normal(0, 3.0, (right.view_count, 2))
    late = replace(right, center_px=right.center_px + shift_px[right.view])
    solved.clear()
    assert solve_rig(replace(pair, sightings=(pair.sightings[0], late)), choices).slack is not None
    assert len(solved) == 2
