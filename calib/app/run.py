"""From photos to a judged camera: `calib run`, `calib.run("ico.target.json", "photos/*.jpg")`."""

from collections.abc import Iterable
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

from calib.app import options
from calib.app.calibration import Run, reference_of, solved, view_of_reference
from calib.app.detect import DETECTIONS_FILE, DetectedPhotos
from designer.base.errors import NoAnswerError
from designer.base.files import named_in_files, place_of
from designer.base.options import option
from designer.page.capability import capability, written_to
from designer.page.output import Output, output_of
from designer.page.progress import Progress, unheard

if TYPE_CHECKING:
    from calib.app.inputs import Pixels, Place
    from calib.observe.photos import Search


class NothingFoundError(NoAnswerError):
    """No photo shows the target; what was seen instead: `error.search`."""

    def __init__(self, message: str, found: DetectedPhotos) -> None:
        super().__init__(message, found)
        self.search: Search = found.search


@capability(folder=lambda given: options.exports_folder(cast(Path, given["target"])) / "calibration")
def run(
    target: options.Target,
    photos: options.Photos = (),
    *,
    images: "Iterable[Pixels] | None" = None,
    topic: options.Topic = None,
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
    made: options.Made = None,
    capture: options.Capture = None,
    truth: Annotated[
        "Place | None", option("of rendered photos (default: the truth.json beside them, if there is one)")
    ] = None,
    criteria: options.Limits = "standard",
    jobs: options.PhotoJobs = None,
    out: Annotated["Output | Place | None", written_to("folder (default: exports/NAME/calibration)")] = None,
    progress: Progress = unheard,
) -> Run:
    """Detect, solve, detect again with the lens known, solve all models, judge: `run("ico.target.json", "photos")`.

    The second search knows the lens that a first solution gives. The exit code is 1 if nothing was found, or if the
    verdict is: do not use.

    >>> run = calib.run("ico.target.json", "photos/*.jpg")
    >>> run.verdict.grade, run.best.camera.matrix

    Args:
        images: instead of photos arrays (H, W) or (H, W, 3) in blue, green, red; they are named image-1, image-2, ...

    Raises:
        InputError: files or options that break a rule, or photos that do not determine a camera.
        NothingFoundError: no photo shows the target.
    """
    from contextlib import nullcontext

    from calib.app.calibration_folder import RunFolder
    from calib.app.inputs import criteria_of, in_order, photos_given, target_of
    from calib.draw.gallery import OVERLAYS
    from calib.judge.folders import kind_in
    from calib.judge.solutions import SolveTask
    from calib.observe.observations import observations_from_detections
    from calib.observe.photos import named_photos
    from calib.observe.search import PhotoSearch, truth_beside, with_truth
    from calib.observe.sessions import with_sessions
    from calib.solver.capture_error import capture_of
    from calib.solver.plan import plan_from_words
    from designer.tolerance.made import how_made

    geometry, limits, taken = (
        target_of(in_order(target, "calib run TARGET PHOTO...", target=target, photos=photos), "rings"),
        criteria_of(criteria),
        capture_of(capture),
    )
    plan = plan_from_words(
        model, fix=fix, share=share, focal_px=focal_px, loss=loss, reject=reject_sigma, weighted=weighted,
        minimise=minimise, free_bend=free_bend, prior=priors,
        breathing_mm=breathing_mm, vary=vary,
    )  # fmt: skip
    to = None if out is None else output_of(out)
    folder = None if to is None else RunFolder(to, plan.may_solve)
    asked = photos_given(photos, images, topic, geometry, progress)
    if folder is not None:
        asked = folder.without_own_pictures(asked)
    asked, known = with_truth(asked, None if truth is None else place_of(truth, "a truth.json"))
    way = how_made(geometry, made, rendered_id=asked.rendered_id)
    seen, told = reference_of(reference, reference_target)
    named = {photo.name: str(photo.path.parent) for photo in named_photos(asked.photos)}
    seen = view_of_reference(seen, plan := with_sessions(plan, sessions, named), list(named))
    with nullcontext() if folder is None else folder.drawing() as staging:
        search, plan = PhotoSearch(geometry, asked, staging, jobs, progress).twice(plan)
        if folder is not None and staging is not None:
            folder.write_search(search, staging)
    file = named_in_files(Path(target)) if isinstance(target, str | PathLike) else "NAME.target.json"
    if not search.with_target:
        found = DetectedPhotos(search, file if isinstance(target, str | PathLike) else "", remarks=search.remarks)
        if to is not None and folder is not None:
            overlays = to.place / OVERLAYS
            found = DetectedPhotos(search, found.target_file, to.place / DETECTIONS_FILE, overlays, search.remarks)
            to.page = overlays if kind_in(to.place) else to.place
            to.answer = {**to.answer, "best": None, "models": [], "verdict": None}
        raise NothingFoundError(f"none of {len(search.results)} photos shows the target", found)
    plan, observations = plan.suited(observations_from_detections(search.with_target, geometry, origin="the photos"))
    seen = view_of_reference(seen, plan, observations.view_names)
    table = () if to is None else (("detections", named_in_files(to.place / DETECTIONS_FILE)),)
    ways = tuple((name, word) for name, word in (("made", made), ("capture", capture)) if word is not None)
    kept = (("target", file), *table, ("photos", str(len(asked.paths))), *ways, *told)
    shown = tuple(one.photo for one in search.results if one.seen is not None)
    task = SolveTask(observations, plan, geometry.layout_id, kept, seen, known, way, taken, shown)
    beside = None if known is None else Path(truth) if truth is not None else truth_beside(asked.paths)
    return solved(task, geometry, search, limits, progress, folder, is_whole=to is not out, truth_file=beside)
