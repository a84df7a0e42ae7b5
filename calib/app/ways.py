"""In which way a target is best made: `design ways`, `calib.ways("ico.target.json")`."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

from calib.app.options import AimOffset, CameraTemplate, Distance, FittedModel, Seed, TargetFile, Views, Weighted
from calib.app.study_result import TABLES
from calib.app.tolerance import Tolerance, tolerance
from calib.cameras import DEFAULT
from designer.base.options import option
from designer.page.capability import capability
from designer.page.progress import Progress, unheard

if TYPE_CHECKING:
    from designer.base.answer import Value
    from designer.page.blocks import Page


@dataclass(frozen=True, eq=False)
class Ways(Tolerance, kind="ways", title="Ways of making", doing="predicting", files=TABLES):
    """In which way a target is best made: `found.study.ways()[0].way.name`.

    What its errors cost, as `Tolerance` has it.
    """

    def answer(self) -> "dict[str, Value]":
        """Each way: its errors, price and hours."""
        by = self.study.ranked_by
        rows: list[Value] = [
            {
                "way": one.way.name, "title": one.way.title, "totals": dict(one.asked.totals),
                "beyond": one.asked.beyond, "worst": one.worst, "price_eur": one.way.price_eur, "hours": one.way.hours,
            }
            for one in self.study.ways()
        ]  # fmt: skip
        return {"ranked_by": by, "ways": rows}

    def page(self) -> "Page":
        """The same study, told as a choice between ways of making."""
        from calib.app.tolerance_page import ways_page

        return ways_page(self)


@capability
def ways(
    target: TargetFile,
    *,
    by: Annotated[
        str, option("what they are ranked by: distortion_map, focal_length, intersection, pose, ...")
    ] = "distortion_map",
    views: Views = 90,
    distance_mm: Distance = None,
    aim_offset_mm: AimOffset = None,
    camera: CameraTemplate = "machine-vision",
    model: FittedModel = DEFAULT,
    weighted: Weighted = False,
    seed: Seed = 1,
    progress: Progress = unheard,
) -> Ways:
    """In which way a target is best made, by the camera's error, price and hours: `ways("ico.target.json")`.

    All error templates that suit the target, predicted at once; what each of their errors costs is on the page.

    >>> best = calib.ways("ico.target.json").study.ways()[0]
    >>> best.way.name, best.total("focal_length"), best.way.price_eur, best.way.hours

    Raises:
        InputError: files or options that break a rule; the message names it.
    """
    from calib.app.inputs import target_of
    from calib.studies.tolerance.explore import templates_for
    from calib.studies.tolerance.quantities import quantity_named
    from designer.tolerance.made import error_model_for

    geometry, by = target_of(target, "rings"), quantity_named(by).name
    assumed = error_model_for(geometry)
    errors = next(iter(templates_for(geometry))) if assumed is None else assumed.errors.name
    found = tolerance(
        target, errors, views=views, distance_mm=distance_mm, aim_offset_mm=aim_offset_mm, camera=camera, model=model,
        weighted=weighted, linear=True, by=by, seed=seed, progress=progress,
    )  # fmt: skip
    return Ways(
        found.study, found.drawn, seed, found.layer_height_mm, found.target_file, found.camera_remarks, (),
        found.made_by,
    )  # fmt: skip
