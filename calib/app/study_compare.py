"""The paper's objects, made with errors and photographed: `calib study compare`."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, cast

from calib.app.options import CameraTemplate, Dask, Jobs, Resume, Seed
from calib.app.study_result import FORMATS, STUDY_OUT, TABLES, StudyResult, rows_to_csv, sampling_in
from designer.base.codec import encode
from designer.base.errors import InputError
from designer.base.marks import NOT_IN_FILE
from designer.base.options import option
from designer.page.capability import capability
from designer.page.output import Output, output_of
from designer.page.progress import Progress, unheard

if TYPE_CHECKING:
    from calib.app.inputs import Place
    from calib.draw.style import FigureSheet
    from calib.studies.compare.cases import Results
    from calib.studies.runner import DrawCount
    from designer.base.files import JsonValue
    from designer.page.blocks import Page

MOST_PRINTS, MOST_SETS = 10_000, 1000


@dataclass(frozen=True, eq=False)
class ComparedObjects(
    StudyResult, kind="compare", title="Comparison", files={**TABLES, "study.sqlite": "every set of photos"}
):
    """The paper's real-world figure in simulation: `found.results.table`, `found.save("compare")`."""

    columns = "object,part"
    formats = FORMATS
    remarks = ()
    results: Annotated["Results", NOT_IN_FILE]
    sampled: Annotated["DrawCount", NOT_IN_FILE]
    place: Annotated[str, NOT_IN_FILE]  # its folder, as it is typed

    def document(self) -> "dict[str, JsonValue]":
        """Medians over sets and prints, and single errors."""
        from calib.studies.compare.cases import ComparisonTable

        return cast("dict[str, JsonValue]", encode(ComparisonTable, self.results.table))

    def page(self) -> "Page":
        """Which object is best, which errors explain the paper's numbers, and what the virtual camera brings."""
        from calib.app.compare_page import comparison_page

        return comparison_page(self)

    def sheets(self) -> "tuple[FigureSheet, ...]":
        """Boxes of the objects, of the lens, and single errors."""
        from calib.app.compare_page import comparison_sheets

        return comparison_sheets(self.results)

    def csv(self) -> bytes:
        """Every median, a line a case and error."""
        from calib.studies.compare.cases import CaseRow

        return rows_to_csv(CaseRow, self.results.table.cases)


@capability
def study_compare(
    out: Annotated["Place | Output", STUDY_OUT],
    *,
    quick: Annotated[bool, option("2 prints and 2 sets: which way it goes, in a minute")] = False,
    prints: Annotated[
        int | None, option("of each object, each with errors of its own (default: 12)", 1, MOST_PRINTS)
    ] = None,
    sets: Annotated[int | None, option("of photos of each print (default: 12)", 1, MOST_SETS)] = None,
    virtual_sets: Annotated[int, option("of them solved with the virtual camera, which is slow", 1, MOST_SETS)] = 1,
    camera: CameraTemplate = "phase-one-ixg",
    seed: Seed = 1,
    jobs: Jobs = None,
    dask: Dask = None,
    resume: Resume = False,
    progress: Progress = unheard,
) -> ComparedObjects:
    """Simulate the paper's real-world figure: five made objects, three camera models, 12 sets of photos a print.

    Each print is one draw of the object's errors; errors are measured against the drawing, as the paper had to. Says
    which errors explain the paper's medians, and whether the virtual camera wins behind a lens no Brown model fits.

    Args:
        out: a folder for every set of photos, so that a stopped comparison goes on, and for the tables.

    Raises:
        InputError: numbers, a camera or a folder that cannot be used.
        StudyStoppedError: interrupted; what is finished is kept.
    """
    from os import fspath

    from calib.studies.compare import cases
    from calib.studies.compare.cases import results_of
    from calib.studies.compare.scene import SETS
    from calib.studies.store import read_study

    usual = cases.QUICK if quick else SETS
    prints, sets = (usual if one is None else one for one in (prints, sets))
    if virtual_sets > sets:
        raise InputError(f"--virtual-sets {virtual_sets}: there are {sets} sets of a print; give at most as many")
    output, name = output_of(out), fspath(camera)  # type: ignore[arg-type]  # a template or a file
    ComparedObjects.check(output.place)
    plan = cases.Plan(name, prints, sets, virtual_sets, 1 if quick else cases.ALONE_PRINTS, seed)
    cases.usable_camera(name)
    identity = cases.identity(plan)
    with sampling_in(output, jobs, dask, resume=resume, progress=progress) as sampling:
        sampling.check(identity)
        progress("placing cameras", 0, 0)
        comparison = cases.comparison(plan)
        output.finished.append(sampling.path)
        sampled = sampling.run(identity, comparison.cases, chunk=1)
        with read_study(sampling.path) as study:
            found = ComparedObjects(results_of(study, comparison), sampled, str(output.place))
    return found.saved(output, progress)
