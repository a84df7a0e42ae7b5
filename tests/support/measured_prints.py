"""A measured icosahedron that came out of a printer, judged by photos held out."""

from functools import cache
from pathlib import Path

import numpy as np

from calib.app.measured_print import MeasuredPrint
from calib.measure_target.cross_validation import cross_validate
from calib.measure_target.deviations import Compensation
from calib.measure_target.lengths import CaliperLength, length_in
from calib.measure_target.record import record_of
from calib.measure_target.solve import measure
from calib.measure_target.unknowns import AsBuiltOptions
from tests.support.as_built_scenes import photos, printed, random_shape, solid


@cache
def measured_print() -> MeasuredPrint:
    """Of one length, in two readings."""
    rng = np.random.default_rng(3)
    real = printed(solid(), random_shape(solid(), rng, ring_mm=(0.05, 0.02)))
    length = CaliperLength("edge", length_in(real, "edge"), 0.02)
    found = measure([photos(real, rng, 14)], solid(), "opencv", AsBuiltOptions(), [length, length])
    record = record_of(
        found, cross_validate(found, "opencv", AsBuiltOptions(), 2), Compensation(), bed_turn_rad=0.0, weighted=False,
        remarks=(), program="ringsolid 1.2.3", settings={"target": "ico.target.json", "model": "opencv", "fix": ""},
    )  # fmt: skip
    return MeasuredPrint(
        found=found, measured_against=None, use="calib solve seen.csv", file=Path("print.target.json"),
        remarks=record.remarks, record=record, ink_bleed=None,
    )  # fmt: skip
