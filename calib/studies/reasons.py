"""Why findings of the paper do not hold here, as far as the study's own numbers say it."""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from calib.core.number_text import figure
from calib.studies.findings import HeldClaim
from calib.studies.paper_table import BOARD, ICOSAHEDRON
from calib.studies.statistics import SMALL_SKEWNESS, Array, CaseSummary
from calib.studies.table import setting_in_words

Setting = tuple[str, str]
"""A way of sampling and of counting sightings."""

FOCAL = 0
"""Place of the focal length among the parameters of every model."""


def reasons(
    found: Sequence[HeldClaim], summaries: Sequence[CaseSummary], covariance: Mapping[tuple[str, str, str], Array]
) -> tuple[str, ...]:
    """A line for each kind of reason and way of sampling.

    Args:
        found: what holds, and what does not.
        summaries: of all cases.
        covariance: (P, P) of the parameters in the solution of all views of a pool, by target, sampling and sightings.
    """
    lines = []
    for setting in dict.fromkeys((one.sampling, one.sightings) for one in found):
        failing = [one.claim for one in found if (one.sampling, one.sightings) == setting and one.verdict != "holds"]
        if any(claim.startswith("pose error") for claim in failing):
            lines.append(_of_pose(setting, covariance))
        lines += _of_skewness(setting, [one for one in summaries if (one.case.sampling, one.case.sightings) == setting])
    return tuple(line for line in lines if line)


def _of_pose(setting: Setting, covariance: Mapping[tuple[str, str, str], Array]) -> str:
    """A camera's centre is known along its axis as well as its focal length is."""
    sigma = {}
    for target in (ICOSAHEDRON, BOARD):
        matrix = covariance.get((target, *setting))
        if matrix is None or not len(matrix) or not matrix[FOCAL, FOCAL] > 0:
            return ""
        sigma[target] = math.sqrt(float(matrix[FOCAL, FOCAL]))
    ratio = sigma[ICOSAHEDRON] / sigma[BOARD]
    if not ratio > 1:
        return ""
    return (
        f"{setting_in_words(*setting)}: a pose is as sure as the focal length, and all views together state that to "
        f"{figure(sigma[ICOSAHEDRON], 2)} px for the icosahedron and {figure(sigma[BOARD], 2)} px for the board "
        f"({figure(ratio, 2)} times): where the centres of both are measured as well, a target that fills the image is "
        "at an advantage"
    )


def _of_skewness(setting: Setting, summaries: Sequence[CaseSummary]) -> list[str]:
    """A sigma that few wild samples make does not fall with the root of the number of views."""
    lines = []
    for target in dict.fromkeys(one.case.target for one in summaries):
        skewness = [one.of("reconstruction").skewness for one in summaries if one.case.target == target]
        known = [value for value in skewness if math.isfinite(value)]
        if known and float(np.max(known)) > 4 * SMALL_SKEWNESS:
            lines.append(
                f"{setting_in_words(*setting)}: the {target}'s reconstruction error is skewed to the right (up to "
                f"{max(known):.1f}): rings that few views of a sample see make it, so its sigma is not one of 1/sqrt(N)"
            )
    return lines
