import numpy as np

from calib.studies.tolerance.draw import run_draws
from calib.studies.tolerance.quantities import NAMES
from calib.studies.tolerance.seen import aimed_at
from calib.studies.tolerance.setting import make_setting
from calib.studies.tolerance.stored import run_full_draws
from tests.support.perturbed_targets import ico
from tests.support.solver_scenes import CAMERAS
from tests.support.tolerance_settings import DISTANCE_MM, errors

TOLD = ("reprojection", "intersection", "reconstruction", "intersection_true", "pose", "focal_length")
"""Quantities that errors of a tenth of a millimetre set, not noise."""


def test_images_say_what_simulated_sightings_say() -> None:
    """Rendered, detected and calibrated, the same errors cost what they cost without images, and noise stays small."""
    setting = make_setting(
        ico(), CAMERAS["opencv"], views=6, photos=aimed_at(ico(), DISTANCE_MM), model="opencv", seed=1
    )
    model = errors("fdm-dual").only("face_offset")
    (full,), (simulated,) = (run(setting, model, 7, range(1)) for run in (run_full_draws, run_draws))
    assert full.shape == simulated.shape == (3, len(NAMES))
    assert full[0, NAMES.index("reprojection")] < 3 * simulated[0, NAMES.index("reprojection")]
    for name in TOLD:
        k = NAMES.index(name)
        assert abs(full[1, k] / simulated[1, k] - 1) < 0.1, (name, full[1, k], simulated[1, k])
    np.testing.assert_array_equal(full[1], full[2])
