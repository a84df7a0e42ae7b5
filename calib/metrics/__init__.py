"""Metrics of a calibration, each one file and one line here."""

from collections.abc import Callable, Mapping
from types import MappingProxyType

from calib.metrics import intersection, pose, reconstruction, reprojection, rotation
from calib.metrics.errors import Errors, Prediction

Metric = Callable[[Prediction], Errors | None]
"""The errors of a metric; None if what it compares with is not known."""

METRICS: Mapping[str, Metric] = MappingProxyType(
    {
        reprojection.NAME: reprojection.reprojection,
        intersection.NAME: intersection.intersection,
        reconstruction.NAME: reconstruction.reconstruction,
        pose.NAME: pose.pose,
        rotation.NAME: rotation.rotation,
    }
)

OF_TRUTH = (pose.NAME, rotation.NAME)
"""Metrics that compare with a truth, which is known of rendered photos only."""
