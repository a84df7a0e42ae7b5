"""One bootstrap sample: draw views with replacement, solve, evaluate."""

import math

import numpy as np
from numpy.typing import NDArray

from calib.core.threads import one_thread
from calib.solver.accuracy import NO_FIT
from calib.studies.from_scratch import solve_from_scratch
from calib.studies.near import find_near
from calib.studies.pool import Pool
from calib.studies.sample import SampleResult, draw_counts
from calib.studies.sample_metrics import Sample, sample_errors


def run_sample(pool: Pool, counts: NDArray[np.int64], number: int) -> SampleResult:
    """The camera and the errors of a sample; whatever becomes of it, there is a result.

    Args:
        pool: the views.
        counts: (V,) how often each is drawn.
        number: of the sample, for the record.
    """
    views = np.flatnonzero(counts)
    weight = counts[views]
    found = find_near(pool, views, weight)
    if found is None:
        return solve_from_scratch(pool, counts, number)
    is_plain = not pool.calibration.weighted
    errors = sample_errors(
        Sample(pool.observations, pool.problem, views, weight, found.camera, found.cam_from_target),
        pool.true_center_mm,
        found.cost if is_plain else None,
    )
    # Half of all residuals are at most sqrt(2) times their root mean square.
    if not math.sqrt(2) * errors.reprojection_px < NO_FIT * max(pool.observations.image_size):
        return solve_from_scratch(pool, counts, number)
    return SampleResult(
        number, "converged", len(views), errors.reprojection_px, errors.intersection_mm, errors.reconstruction_mm,
        errors.pose_mm, tuple(found.camera.params.tolist()), found.looks,
    )  # fmt: skip


@one_thread
def run_chunk(pool: Pool, case: str, size: int, seed: int, numbers: range) -> list[SampleResult]:
    """The samples of some numbers, each a function of seed, case and number alone.

    Args:
        pool: the views.
        case: the name of what is sampled.
        size: how many views to draw.
        seed: of the study.
        numbers: of the samples.
    """
    return [run_sample(pool, draw_counts(seed, case, n, size, pool.view_count), n) for n in numbers]
