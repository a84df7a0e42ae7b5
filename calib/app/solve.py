"""From what was detected to a judged camera: `calib solve`, `calib.solve("detections.csv", "ico.target.json")`."""

from collections.abc import Iterable, Sequence
from os import PathLike
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Annotated, cast

from calib.app import options
from calib.app.calibration import Run, reference_of, solved, view_of_reference
from designer.base.errors import InputError
from designer.base.files import named_in_files
from designer.base.options import argument, option
from designer.base.words import shown
from designer.page.capability import capability, written_to
from designer.page.output import Output, output_of
from designer.page.progress import Progress, unheard

if TYPE_CHECKING:
    from calib.app.inputs import Place
    from calib.core.types import Detections, Observations
    from calib.renderer.truth import Truth
    from designer.target import TargetGeometry


@capability(folder=lambda given: cast(Path, given["observed"]).parent / "camera")
def solve(
    observed: Annotated[
        "Observations | Place | Iterable[Detections] | None",
        argument("detections.csv, a CSV with image,u,v,X,Y,Z, or a corners.vnl", metavar="DETECTIONS", is_needed=True),
    ] = None,
    target: Annotated["TargetGeometry | Place | None", option("the target file of detections.csv")] = None,
    *,
    model: options.Model = "all",
    fix: options.Fix = (),
    share: options.Share = (),
    priors: options.Priors = (),
    focal_px: options.FocalGuess = None,
    loss: options.Loss = "squares",
    reject_sigma: options.Reject = None,
    weighted: options.Weighted = True,
    minimise: options.Minimise = "image",
    free_bend: options.FreeBend = None,
    breathing_mm: options.Breathing = None,
    vary: options.Vary = None,
    sessions: options.Sessions = None,
    reference: options.ReferencePhoto = None,
    reference_target: options.ReferenceTarget = None,
    image_size: options.ImageSize = None,
    grid: options.Grid = None,
    pitch_mm: options.Pitch = None,
    points: options.Points = None,
    made: options.Made = None,
    capture: options.Capture = None,
    criteria: options.Limits = "standard",
    truth: "Truth | Place | None" = None,
    rendered_id: str = "",
    object_points: "Sequence[object] | None" = None,
    image_points: "Sequence[object] | None" = None,
    unit: str | None = None,
    out: Annotated[
        "Output | Place | None", written_to("folder for the results (default: camera, beside what is solved from)")
    ] = None,
    progress: Progress = unheard,
) -> Run:
    """Solve the camera, and where it stood, from what was detected, and judge it: `solve("d.csv", "t.json")`.

    The exit code is 1 if the verdict is: do not use.

    >>> detector = calib.Detector("ico.target.json")
    >>> run = calib.solve([detector.detect(frame) for frame in frames], detector.target)
    >>> run = calib.solve(object_points=object_points, image_points=image_points, image_size=gray.shape[::-1])

    Args:
        observed: a file of observations, what was found in photos, or observations as `load_observations` has them.
        truth: of rendered photos, or its `truth.json`.
        object_points: instead, as `cv2.calibrateCamera` takes them; see `calib.observations`.
        image_points: of these.
        unit: of the object points; None: lengths are told as if it were mm.
        rendered_id: of the geometry that the photos were rendered of; "": what the records beside a file say.

    Raises:
        InputError: options that break a rule, or observations that do not determine a camera.
    """
    from calib.app.calibration_folder import RunFolder
    from calib.app.inputs import criteria_of, file_or_observations, rendered_id_of, target_of, truth_from
    from calib.judge.solutions import SolveTask
    from calib.observe.sessions import with_sessions
    from calib.solver.capture_error import capture_of
    from calib.solver.plan import plan_from_words
    from designer.tolerance.made import how_made

    if observed is None or any(one is not None for one in (object_points, image_points, unit)):
        observed, image_size = _of_arrays(observed, object_points, image_points, image_size, unit), None
    limits, taken = criteria_of(criteria), capture_of(capture)
    plan = plan_from_words(
        model, fix=fix, share=share, focal_px=focal_px, loss=loss, reject=reject_sigma, weighted=weighted,
        minimise=minimise, free_bend=free_bend, prior=priors,
        breathing_mm=breathing_mm, vary=vary,
    )  # fmt: skip
    to = None if out is None else output_of(out)
    folder = None if to is None else RunFolder(to, plan.may_solve)
    observations = file_or_observations(observed, target, image_size, grid, pitch_mm, points)
    geometry = None if target is None else target_of(target)
    way = how_made(geometry, made, rendered_id=rendered_id or rendered_id_of(observed))
    seen, told = reference_of(reference, reference_target)
    plan = with_sessions(plan, sessions, {name: str(PurePath(name).parent) for name in observations.view_names})
    plan, observations = plan.suited(observations)
    seen = view_of_reference(seen, plan, observations.view_names)
    given = named_in_files(Path(target)) if isinstance(target, str | PathLike) else ""
    files = (
        (("detections", named_in_files(Path(observed))), ("target", given))
        if isinstance(observed, str | PathLike)
        else ()
    )
    words = (("points", points), ("made", made), ("capture", capture))
    kept = (*files, *((name, word) for name, word in words if word is not None), *told)
    layout_id = "" if geometry is None else geometry.layout_id
    task = SolveTask(observations, plan, layout_id, kept, seen, truth_from(truth), way, taken)
    return solved(task, geometry, None, limits, progress, folder, is_whole=to is not out)


def _of_arrays(
    observed: object, object_points: "Sequence[object] | None", image_points: "Sequence[object] | None",
    image_size: tuple[int, int] | None, unit: str | None,
) -> "Observations":  # fmt: skip
    """What OpenCV's arrays show."""
    from calib.core.types import Observations
    from calib.observe.arrays import observations

    given = {"object_points": object_points, "image_points": image_points, "image_size": image_size, "unit": unit}
    for name, one in (("object_points", object_points), ("image_points", image_points)):
        if one is not None and (isinstance(one, str | bytes) or not hasattr(one, "__len__")):
            raise InputError(f"{name} {shown(one)}: must be a list with an array a photo")
    first = next((name for name, one in given.items() if one is not None and name != "image_size"), "")
    if observed is not None:
        raise InputError(f"{first} {shown(given[first])}: goes with arrays alone; leave what else was seen out")
    if object_points is None or image_points is None or image_size is None:
        missing = ", ".join(name for name, one in given.items() if one is None and name != "unit")
        told = f"{first} alone: missing is {missing}" if first else "nothing is given to solve from"
        raise InputError(f"{told}; give detections, or object_points, image_points and image_size")
    found = observations(object_points, image_points, image_size, unit=unit)
    if not isinstance(found, Observations):
        raise InputError("image_points: of several cameras; give those of one, or calib.rig(calib.observations(...))")
    return found
