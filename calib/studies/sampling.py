"""Where the samples of a study are kept, and who computes them."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from calib.studies.identity import StudyIdentity
from calib.studies.runner import run_cases
from calib.studies.store import check_place, open_study
from calib.studies.workers import CaseSpec
from designer.page.progress import Progress

STUDY_FILE = "study.sqlite"
Tell = Callable[[float], None]
"""Told how many are done."""


def after(before: float, tell: Tell) -> Tell:
    """Tells of the progress of a part, what came before it included."""
    return lambda done: tell(before + done)


@dataclass(frozen=True)
class DrawCount:
    """How many draws were computed, and how long that took."""

    new: int = 0
    before: int = 0  # that the folder had
    seconds: float = 0.0


def ask_cluster(dask: str | None, progress: Progress) -> None:
    """Refuse a cluster that cannot be used, by the address of its scheduler; None: there is none to ask.

    Raises:
        InputError: so it is.
    """
    if dask is not None:
        from calib.studies.dask_cluster import check_cluster

        progress("asking the cluster", 0, 0)
        check_cluster(dask)


@dataclass(frozen=True, eq=False)
class Sampling:
    """Where the samples of a study are kept, and who computes them."""

    path: Path  # of the study's file
    jobs: int  # processes
    dask: str | None  # address of a cluster's scheduler, which computes the samples instead
    resume: bool
    progress: Progress

    def check(self, identity: StudyIdentity) -> None:
        """Refuse a place or a cluster that cannot be used, before there is much work behind us.

        Raises:
            InputError: so it is.
        """
        check_place(self.path, identity, resume=self.resume)
        ask_cluster(self.dask, self.progress)

    def run(
        self, identity: StudyIdentity, groups: Sequence[tuple[Sequence[CaseSpec], int]], chunk: int | None = None
    ) -> DrawCount:
        """Compute the samples that are missing.

        Args:
            identity: what makes it this study.
            groups: cases, and how many samples are wanted of each of them.
            chunk: samples that are computed at a time; None: as many as take a moment.

        Raises:
            StudyStoppedError: interrupted, or no workers are left; what there is, is kept.
        """
        total, start = sum(len(specs) * count for specs, count in groups), time.perf_counter()
        self.path.parent.mkdir(parents=True, exist_ok=True)
        new = before = 0
        with open_study(self.path, identity, resume=self.resume) as study:
            for specs, samples in groups:
                counts: list[int] = []
                done = before + new

                def tell(count: int, counts: list[int] = counts, done: int = done) -> None:
                    counts.append(count)
                    self.progress("sampling", done + count, total)

                run_cases(
                    specs, study, samples=samples, seed=identity.seed, jobs=self.jobs, dask=self.dask,
                    on_progress=tell, chunk=chunk, before=done, total=total,
                )  # fmt: skip
                before, new = before + counts[0], new + counts[-1] - counts[0]
        return DrawCount(new, before, time.perf_counter() - start)
