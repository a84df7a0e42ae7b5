"""Metrics of a calibration: a file each, which holds it as `METRIC`, and a line here."""

from collections.abc import Mapping
from types import MappingProxyType

from calib.solver.metrics import intersection, pose, reconstruction, reprojection, rotation, weighted
from calib.solver.metrics.errors import ErrorMetric

METRICS: Mapping[str, ErrorMetric] = MappingProxyType(
    {file.METRIC.name: file.METRIC for file in (reprojection, weighted, intersection, reconstruction, pose, rotation)}
)
OF_TRUTH = tuple(name for name, metric in METRICS.items() if metric.needs_truth)
