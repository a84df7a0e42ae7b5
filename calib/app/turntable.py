"""Where a camera stands beside a turntable: `calib turntable`, `calib.turntable("t.json", "photos", step_deg=10)`."""

import math
from typing import TYPE_CHECKING, Annotated

from calib.app.hand_eye import Lens, PhotosTaken, Refine, Table, TargetShown, seen_by_one, wishes_of_one
from calib.app.options import Fix, FreeBend, Limits, Made, Minimise, Model, PhotoJobs, Points, Priors
from calib.app.solved_rig import SolvedRig, begun, finished, folder_for, settings_of
from designer.base.errors import InputError
from designer.base.options import option
from designer.base.units import parse_angle_rad
from designer.page.capability import capability, written_to
from designer.page.progress import Progress, unheard

if TYPE_CHECKING:
    from calib.app.inputs import Place
    from designer.page.output import Output

TABLE = "turntable"


def _degrees(text: str) -> float:
    return math.degrees(parse_angle_rad(text))


@capability(folder=lambda given: folder_for("turntable", given))
def turntable(
    target: TargetShown = None,
    photos: PhotosTaken = (),
    *,
    step_deg: Annotated[
        float | None,
        option(
            "the table's turn from photo to photo: 10deg (default: all angles are unknown)", -180, 180, parse=_degrees
        ),
    ] = None,
    table: Table = None,
    points: Points = None,
    diameter_mm: float | None = None,
    camera: Lens = None,
    refine: Refine = False,
    model: Model = "all",
    fix: Fix = (),
    priors: Priors = (),
    minimise: Minimise = "image",
    free_bend: FreeBend = None,
    made: Made = None,
    criteria: Limits = "standard",
    jobs: PhotoJobs = None,
    out: Annotated[
        "Output | Place | None", written_to("folder (default: exports/NAME/turntable, or turntable)")
    ] = None,
    progress: Progress = unheard,
) -> SolvedRig:
    """Solve where a camera stands beside a turntable, its axis and angles: `turntable("t.json", "photos", step_deg=9)`.

    The exit code is 1 if the photos do not determine it, or if the verdict is: do not use.

    Args:
        photos: in the order in which they were taken.
        diameter_mm: of circles.

    Raises:
        InputError: files or options that break a rule.
    """
    import numpy as np

    from calib.app.inputs import criteria_of, points_of
    from calib.judge.joint_solution import judged_rig
    from calib.rigs.carrier import turned_by
    from calib.rigs.problem import Mechanism, RigOptions

    if step_deg == 0:
        raise InputError("--step 0deg: a table that does not turn tells nothing; leave it out, or give its turn")
    to = begun(out)
    limits = criteria_of(criteria)
    wishes = wishes_of_one(camera, model, fix, priors, minimise, free_bend, refine=refine)
    seen = seen_by_one(target, photos, table, points_of(points, diameter_mm), wishes, jobs, progress).with_made(made)
    names = seen.observations.frame_names
    taken = names if seen.search is None else seen.search.photos.frame_names
    angle_rad = np.deg2rad(step_deg or 0.0) * np.array([taken.index(name) for name in names], dtype=np.float64)
    carrier = Mechanism(TABLE, turned_by(angle_rad), is_turntable=True, has_free_angles=step_deg is None)
    options = RigOptions(carrier=carrier, minimise=wishes.options.minimise)
    settings = settings_of(("target", target), ("table", table))
    run = judged_rig(seen, wishes, options, limits, settings, progress)
    return finished(SolvedRig(*run), to, out, progress)
