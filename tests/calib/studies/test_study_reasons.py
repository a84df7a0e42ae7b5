from dataclasses import replace

import numpy as np

from calib.studies.findings import findings
from calib.studies.paper_table import BOARD, ICOSAHEDRON, SIZES
from calib.studies.reasons import reasons
from calib.studies.statistics import Case, CaseSummary, summarise
from tests.support.study_cases import paper_samples

SETTING = ("area", "all")


def summaries(pose_factor: float) -> list[CaseSummary]:
    """Cases with the paper's moments, the icosahedron's pose errors times a factor."""
    rng = np.random.default_rng(4)
    made = []
    for target in (BOARD, ICOSAHEDRON):
        for size in SIZES:
            samples = paper_samples(target, size, 400, rng)
            metrics = samples.metrics.copy()
            metrics[:, 3] *= pose_factor if target == ICOSAHEDRON else 1.0
            made.append(summarise(Case(target, size, 200, *SETTING), replace(samples, metrics=metrics)))
    return made


def said(pose_factor: float, focal_px: dict[str, float]) -> str:
    """The reasons for cases with these standard deviations of the focal length."""
    found = summaries(pose_factor)
    covariance = {(target, *SETTING): np.diag([sigma**2, 1.0]) for target, sigma in focal_px.items()}
    return "\n".join(reasons(findings(found), found, covariance))


def test_a_worse_pose_is_explained_by_the_focal_length() -> None:
    """Where the icosahedron has worse poses, the sigmas of the focal lengths and their ratio are named; else not."""
    sigma = {BOARD: 0.002, ICOSAHEDRON: 0.012}
    line = said(20.0, sigma)
    assert "0.012 px for the icosahedron and 0.0020 px for the board (6.0 times)" in line
    assert "pose" not in said(1e-3, sigma)


def test_no_reason_is_made_up() -> None:
    """Without a stated accuracy of both targets, or with a fixed focal length, nothing is said of it."""
    assert "pose" not in said(20.0, {BOARD: 0.002})
    assert "pose" not in said(20.0, {BOARD: 0.0, ICOSAHEDRON: 0.01})
