"""The answer of `calib measure`. Covariances and single rings are in NAME.as_built.json."""

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

from calib.commands.answers.cameras import camera_answer

if TYPE_CHECKING:
    from calib.as_built.result import AsBuilt
    from calib.as_built_report.deviations import Estimate
    from calib.as_built_report.files import MeasureReport
    from calib.as_built_report.held_out import Gain, HeldOut
    from designer.base.answer import Value


def measured_answer(report: "MeasureReport") -> "dict[str, Value]":
    """Stretch and skew of the whole print, its faces, lengths, cameras and what is gained on photos held out."""
    from calib.as_built_report.deviations import compensation_percent, next_skew_rad

    found, whole = report.found, report.whole
    size = whole.size
    return {
        "status": found.status,
        "layout_id": found.nominal.layout_id,
        "nominal_geometry_id": found.nominal.geometry_id,
        "measured_geometry_id": found.target.geometry_id,
        "photos": sum(one.view_count for one in found.observations),
        "sightings": sum(len(one.view) for one in found.observations),
        "sigma_px": None if report.weighted else found.scale,
        "sigma_of_stated": found.scale if report.weighted else None,
        "iterations": found.iterations,
        "seconds": found.seconds,
        "size": None if size is None else _estimate(size),
        "axes": {name: _estimate(one) for name, one in whole.axes},
        "skews_rad": {name: _estimate(one) for name, one in whole.skews},
        "is_in_shape": whole.is_in_shape,
        "strain": found.strain.tolist(),
        "next_shrink_compensation_percent": (
            None if size is None else compensation_percent(size.value, report.made_with_percent)
        ),
        "next_skew_compensation_rad": next_skew_rad(whole, report.made_with_skew_rad),
        "lengths": [
            {"name": asked.length.name, "value_mm": asked.length.value_mm, "sigma_mm": asked.length.sigma_mm,
             "left_over_sigma": left}
            for asked, (_, left) in zip(report.lengths, found.lengths, strict=True)
        ],
        "faces": list(_faces(report)),
        "cameras": list(_cameras(found)),
        "held_out": None if report.held_out is None else _held_out(report.held_out),
    }  # fmt: skip


def _estimate(one: "Estimate") -> "dict[str, Value]":
    return {"value": one.value, "sigma": one.sigma}


def _faces(report: "MeasureReport") -> "Iterator[dict[str, Value]]":
    """How each face lies; a single one has no place but its own."""
    from calib.as_built_report.deviations import FREE_PARAMETERS

    found, faces = report.found, report.faces
    units = ["mm" if name.startswith("shift") else "rad" for name in FREE_PARAMETERS]
    keys = [f"{name.replace(' ', '_')}_{unit}" for name, unit in zip(FREE_PARAMETERS, units, strict=True)]
    for face, views in enumerate(found.face_views.tolist()):
        lies: dict[str, Value] = {}
        if faces is not None:
            rows = zip(keys, faces.value[face].tolist(), faces.sigma[face].tolist(), strict=True)
            lies = {key: {"value": value, "sigma": sigma} for key, value, sigma in rows}
        yield {
            "face": face,
            "photos": views,
            "verdict": None if faces is None else faces.verdict[face],
            **lies,
            "bow_mm": found.bow_mm[face].tolist(),
        }


def _cameras(found: "AsBuilt") -> "Iterator[dict[str, Value]]":
    import numpy as np

    rows = zip(found.cameras, found.observations, found.residual_px, found.is_outlier, strict=True)
    for camera, seen, residual, is_outlier in rows:
        used = residual[~is_outlier]
        yield {
            **camera_answer(camera),
            "photos": seen.view_count,
            "sightings": len(seen.view),
            "outliers": int(is_outlier.sum()),
            "rms_px": float(np.sqrt((used**2).sum(axis=1).mean())) if len(used) else math.nan,
        }


def _held_out(held: "HeldOut") -> "dict[str, Value]":
    return {
        "parts": held.folds,
        "is_better": None if held.judged_by is None else held.judged_by.is_better,
        "gains": [_gain(one) for one in held.gains],
        "against_truth": [_gain(one) for one in held.against_truth],
        "remarks": held.remarks,
    }


def _gain(one: "Gain") -> "dict[str, Value]":
    return {
        "metric": one.metric,
        "count": one.count,
        f"nominal_{one.unit}": one.nominal,
        f"measured_{one.unit}": one.measured,
        "factor": one.factor,
        "least_factor": one.least_factor,
    }
