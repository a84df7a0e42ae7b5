"""What `run` and `solve` return: cameras of one or several models, judged."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from calib.api.page_shown import ShownAsPage
from calib.api.searching import Search
from calib.core.types import Observations
from calib.pipeline.solutions import Solution, SolveTask, preference
from calib.verdict.next_views import NextView
from calib.verdict.of_run import Judged
from calib.verdict.verdict import Verdict
from designer.target import TargetGeometry


@dataclass(frozen=True, eq=False)
class RunResult(ShownAsPage):
    """Cameras of one or several models from the same photos, judged: `run.best.camera`, `run.verdict.grade`.

    In a notebook the result shows its report.
    """

    target: TargetGeometry | None  # None: the points came from elsewhere
    search: Search | None  # of the photos; None: solved from observations
    task: SolveTask
    solutions: tuple[Solution, ...]  # of each model, at least one of them solved
    judged: Judged
    next_views: tuple[NextView, ...]  # photos that would make the camera better

    @property
    def observations(self) -> Observations:
        """What the cameras were solved from."""
        return self.task.observations

    @cached_property
    def best(self) -> Solution:
        """The camera to go on with: determined, of a model that other programs know, with the least residuals."""
        return best_of(self.solutions)

    @property
    def verdict(self) -> Verdict:
        """Whether to use the best camera, and why."""
        return self.judged.verdict

    @property
    def remarks(self) -> tuple[str, ...]:
        """What a person must know of photos, observations and cameras, one line each."""
        of_search = () if self.search is None else self.search.remarks
        made = () if self.task.made is None else (self.task.made.sentence,)
        of_best = (*self.best.calibration.remarks, *(self.best.evaluation.remarks if self.best.evaluation else ()))
        return tuple(dict.fromkeys((*of_search, *made, *of_best)))

    def save(self, folder: str | Path) -> tuple[Path, ...]:
        """Write the folder that `calib run` writes: cameras, tables, pictures, verdict and page; return the files.

        Raises:
            InputError: the folder takes no files, or holds somebody else's; the message names them.
        """
        from calib.api.run_writer import RunWriter

        writer = RunWriter(Path(folder), self.task.plan.models)
        writer.write_all(self)
        return tuple(writer.files)

    def _write_all(self, folder: Path) -> tuple[Path, ...]:
        return self.save(folder)


def best_of(solutions: Sequence[Solution]) -> Solution:
    """The one to go on with, of those that were solved.

    Raises:
        ValueError: none was.
    """
    solved = [one for one in solutions if one.evaluation is not None]
    if not solved:
        raise ValueError("no model was solved")
    return min(solved, key=lambda one: preference(one.evaluation))  # type: ignore[arg-type]  # none is None here
