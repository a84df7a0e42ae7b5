"""One default for weights, in the library and in all commands."""

import inspect
from collections.abc import Callable

import pytest

from calib.app.measure import measure
from calib.app.pose import pose
from calib.app.run import run
from calib.app.solve import solve
from calib.app.study_bootstrap import bootstrap
from calib.app.tolerance import tolerance
from calib.solver.problem import AS_THE_PAPER, SolveOptions
from calib.solver.start import solve_poses


@pytest.mark.parametrize("function", [solve, run, measure, pose, bootstrap, solve_poses])
def test_commands_and_library_weigh_alike(function: Callable[..., object]) -> None:
    """Whoever asks for nothing gets observations that count by the covariances they state."""
    assert inspect.signature(function).parameters["weighted"].default is SolveOptions().weighted is True


def test_the_papers_way_is_asked_for() -> None:
    """Studies that repeat the paper, or state what errors of a print cost its way, count all observations alike."""
    assert not AS_THE_PAPER.weighted
    assert inspect.signature(tolerance).parameters["weighted"].default is AS_THE_PAPER.weighted
