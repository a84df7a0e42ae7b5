"""What a study is shown as: its tables and figures, made from its file alone."""

from dataclasses import dataclass
from pathlib import Path

from calib.cameras import MODELS, parameter_names
from calib.studies.figures import study_figures
from calib.studies.findings import HeldClaim, findings
from calib.studies.reasons import reasons
from calib.studies.statistics import CaseSummary, summarise
from calib.studies.store import Study
from calib.studies.table_files import table_files
from designer.base.errors import InputError
from designer.base.words import shown

STUDY_FILE = "study.sqlite"
FIGURES_FOLDER = "figures"
DRAWN_BY = {"tolerance": "design tolerance", "compare": "calib study compare"}
"""Studies of other values than a camera's parameters, by the name of these."""


@dataclass(frozen=True, eq=False)
class StudyOutput:
    """What a study says, and the files that say it."""

    summaries: tuple[CaseSummary, ...]
    findings: tuple[HeldClaim, ...]
    reasons: tuple[str, ...]  # why findings do not hold
    files: dict[Path, bytes]


def study_output(study: Study, folder: Path) -> StudyOutput:
    """The tables and figures of all samples that a study has.

    Args:
        study: a study, finished or not.
        folder: where the files are to lie.

    Raises:
        InputError: it has no samples, or its file is damaged.
    """
    stored = study.cases()
    cases = {one.case: study.load(one.case.name) for one in stored}
    cases = {case: samples for case, samples in cases.items() if len(samples.number)}
    if not cases:
        raise InputError(f"{study.path}: holds no samples yet; run the study again with --resume")
    models = {one.model for one in stored}
    for name, command in DRAWN_BY.items():
        if name in models:
            raise InputError(
                f"{study.path}: made by {command}, which draws it again with --resume and the same options"
            )
    names = parameter_names(next(iter(models))) if models <= MODELS.keys() else ()
    if len(models) > 1 or any(one.params != len(names) for one in stored):
        raise InputError(
            f"{study.path}: of models this program does not know: {', '.join(map(shown, sorted(models)))}; "
            "use the version that made it"
        )
    summaries = tuple(summarise(case, samples) for case, samples in cases.items())
    predicted = {(one.case.target, one.case.sampling, one.case.sightings): one.covariance for one in stored}
    figures = study_figures(cases, names, folder / FIGURES_FOLDER, predicted)
    found = findings(summaries)
    why = reasons(found, summaries, predicted)
    return StudyOutput(summaries, found, why, table_files(summaries, folder, why) | figures)
