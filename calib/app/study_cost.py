"""Which distances to minimise, measured: `calib study cost`, `calib.study_cost("cost")`."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from calib.app.options import Dask, Grid, ImageSize, Jobs, Pitch, Resume, Seed
from calib.app.study_result import FORMATS, STUDY_OUT, TABLES, StudyResult, rows_to_csv, sampling_in
from calib.cameras import DEFAULT, fitted_models
from designer.base.errors import InputError
from designer.base.marks import INLINE, NOT_IN_FILE
from designer.base.options import option
from designer.base.words import cut, printable
from designer.page.capability import capability
from designer.page.output import Output, output_of
from designer.page.progress import Progress, unheard

if TYPE_CHECKING:
    from calib.app.inputs import Place
    from calib.core.types import Detections, Observations
    from calib.draw.style import FigureSheet
    from calib.studies.cost.ratios import CostTable
    from calib.studies.runner import DrawCount
    from designer.page.blocks import Page
    from designer.target import TargetGeometry

MOST_SETS, MOST_STARTS = 10_000, 100_000
USUAL, QUICK = (30, 60), (8, 20)
"""Sets and starts; such as are enough to see which way it goes."""
OWN = "own photos"


@dataclass(frozen=True, eq=False)
class CostStudy(
    StudyResult, kind="cost", title="Study", files={**TABLES, "study.sqlite": "every set of photos and every start"}
):
    """Each cost against the distances in the image: `found.table.compared("ray")`, `found.save("cost")`.

    In a notebook the result shows its page.
    """

    columns = "scene,condition"
    formats = FORMATS
    remarks = ()
    table: Annotated["CostTable", INLINE]
    sampled: Annotated["DrawCount", NOT_IN_FILE]
    place: Annotated[str, NOT_IN_FILE]  # its folder, as it is typed

    def page(self) -> "Page":
        """Which distances are best minimised, and how many bad starts each stands."""
        from calib.app.cost_page import cost_page

        return cost_page(self)

    def sheets(self) -> "tuple[FigureSheet, ...]":
        """Errors over the image's."""
        from calib.app.cost_page import counts_sentence
        from calib.draw.cost_tables import draw_costs, height_px
        from calib.draw.style import FigureSheet

        draw = partial(draw_costs, table=self.table)
        alt = counts_sentence(self.table)
        return (FigureSheet("costs", "Errors over the image's, by cost", alt, height_px(self.table), draw),)

    def csv(self) -> bytes:
        """Every comparison, a line each."""
        from calib.studies.cost.ratios import CostRatio

        return rows_to_csv(CostRatio, self.table.cases)


@capability
def study_cost(
    out: Annotated["Place | Output", STUDY_OUT],
    detections: Annotated[
        "Observations | Place | Iterable[Detections] | None",
        option("photos of your own too: detections.csv, or a CSV with image,u,v,X,Y,Z"),
    ] = None,
    target: Annotated["TargetGeometry | Place | None", option("the target file of detections.csv")] = None,
    *,
    model: Annotated[
        str | None, option(f"of your photos: {', '.join(fitted_models())} (default: {DEFAULT})", names=fitted_models)
    ] = None,
    quick: Annotated[bool, option("8 sets and 20 starts: which way it goes")] = False,
    sets: Annotated[
        int | None, option("of simulated photos of each scene and condition (default: 30)", 3, MOST_SETS)
    ] = None,
    starts: Annotated[int | None, option("bad ones of each scene (default: 60)", 1, MOST_STARTS)] = None,
    image_size: ImageSize = None,
    grid: Grid = None,
    pitch_mm: Pitch = None,
    seed: Seed = 1,
    jobs: Jobs = None,
    dask: Dask = None,
    resume: Resume = False,
    progress: Progress = unheard,
) -> CostStudy:
    """Measure what to minimise: distances in the image, or in space between rays and rings: `study_cost("cost")`.

    Boards and icosahedra, as drawn, as made and with outliers, and photos of your own: errors of camera, poses and
    photos held out, each cost against the image's on the same sightings; and from how bad starts each comes back.

    >>> found = calib.study_cost("cost", "detections.csv", "ico.target.json", model="opencv")
    >>> [row.ratio for row in found.table.compared("ray") if row.measure == "held_out_mm"]

    Args:
        out: a folder for every set of photos, so that a stopped study goes on, and for the tables.
        detections: photos of one's own too, of which each is held out in turn; None: simulated ones alone.
        target: that these show; None: points from elsewhere.

    Raises:
        InputError: numbers, photos or a folder that cannot be used.
        StudyStoppedError: interrupted; what is finished is kept.
    """
    from calib.app.inputs import file_or_observations
    from calib.studies.cost import ratios
    from calib.studies.identity import photos_read
    from calib.studies.store import read_study

    usual = QUICK if quick else USUAL
    sets, starts = (known if one is None else one for one, known in zip((sets, starts), usual, strict=True))
    output = output_of(out)
    CostStudy.check(output.place)
    real = None
    own: Mapping[str, Path | str] = {}
    if detections is not None:
        name = cut(printable(Path(detections).name)) if isinstance(detections, str | PathLike) else ""
        seen = file_or_observations(detections, target, image_size, grid, pitch_mm)
        real = ratios.RealPhotos(name or OWN, seen, model or DEFAULT)
        own = photos_read(real.observations, detections, target=target)
    else:
        of_photos = {
            "--target": target, "--model": model, "--image-size": image_size, "--grid": grid, "--pitch": pitch_mm,
        }  # fmt: skip
        if odd := next((name for name, value in of_photos.items() if value is not None), ""):
            raise InputError(f"{odd}: says nothing without photos of your own; give --detections too")
    plan = ratios.CostPlan(sets, starts, seed, *(("", "") if real is None else (real.name, real.model)))
    identity = ratios.identity(plan, own)
    with sampling_in(output, jobs, dask, resume=resume, progress=progress) as sampling:
        sampling.check(identity)
        progress("placing cameras", 0, 0)
        cases = ratios.cases_of(plan, real)
        output.finished.append(sampling.path)
        sampled = sampling.run(identity, cases)
        with read_study(sampling.path) as study:
            found = CostStudy(ratios.table_of(study, plan), sampled, str(output.place))
    return found.saved(output, progress)
