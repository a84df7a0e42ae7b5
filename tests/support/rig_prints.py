"""Prints that differ from their design, before cameras that are held together."""

from dataclasses import replace
from functools import cache

import numpy as np

from calib.measure_target.unknowns import TargetUnknowns
from calib.observe.observations import known_points
from calib.rigs.problem import CameraChoice
from calib.rigs.result import RigCalibration
from calib.rigs.solve import solve_rig
from tests.support.as_built_scenes import printed, random_shape, solid
from tests.support.rig_views import ring


@cache
def rig_before_print(seed: int = 0, *, cameras: int = 3, frames: int = 8) -> tuple[RigCalibration, TargetUnknowns]:
    """A rig that was solved with an icosahedron as designed, and how the print differs from that."""
    shape = random_shape(solid(), np.random.default_rng(seed), ring_mm=(0.03, 0.015))
    made, drawn = known_points(printed(solid(), shape)), known_points(solid())
    seen = ring(made, count=cameras, frames=frames, noise_px=0.05, seed=seed).observations
    seen = replace(seen, sightings=tuple(replace(one, points=drawn) for one in seen.sightings))
    return solve_rig(seen, [CameraChoice("opencv")] * cameras), shape
