"""How the parameters of a camera scatter in the samples of a study, from its file."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calib.cameras import MODELS
from calib.studies.outputs import STUDY_FILE
from calib.studies.statistics import Case, Correlations, correlations
from calib.studies.store import Study, read_study
from calib.studies.stored_samples import StoredCase
from designer.base.errors import InputError

Array = NDArray[np.float64]

MAX_STUDY_BYTES = 2**28
"""Of a study file whose samples are read for a page."""
FEWEST = 3
"""Converged samples that have a spread."""


@dataclass(frozen=True, eq=False)
class Spread:
    """The parameters of a case in its converged samples."""

    case: Case
    names: tuple[str, ...]  # (P,)
    units: tuple[str, ...]  # (P,) "" for numbers without one
    count: int  # converged samples
    mean: Array  # (P,)
    sigma: Array  # (P,)
    stated: Array | None  # (P,) standard deviations that the solution of all views states; None: not kept
    together: Correlations


def spreads(folder: Path) -> tuple[Spread, ...]:
    """The spread of each case; nothing if the study file is missing, damaged, too large, or of other values."""
    path = folder / STUDY_FILE
    try:
        if path.stat().st_size > MAX_STUDY_BYTES:
            return ()
        with read_study(path) as study:
            found = [_spread(study, one) for one in study.cases()]
    except (InputError, OSError):
        return ()
    return tuple(one for one in found if one is not None)


def _spread(study: Study, stored: StoredCase) -> Spread | None:
    model = MODELS.get(stored.model)
    if model is None or len(model.parameters) != stored.params:
        return None
    names = tuple(one.name for one in model.parameters)
    units = tuple("" if one.unit == "1" else one.unit for one in model.parameters)
    samples = study.load(stored.case.name)
    good = samples.params[(samples.status == "converged") & np.isfinite(samples.params).all(axis=1)]
    if len(good) < FEWEST:
        return None
    with np.errstate(all="ignore"):
        mean, sigma = good.mean(axis=0), good.std(axis=0, ddof=1)
        stated = np.sqrt(np.diagonal(stored.covariance)) if len(stored.covariance) else None
        together = correlations(samples, names)
    return Spread(stored.case, names, units, len(good), mean, sigma, stated, together)
