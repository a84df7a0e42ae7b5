"""Whether cameras are still as their file says: `calib check`, `calib.check("camera.json", "t.json", "photos")`."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from calib.app.options import Made, PhotoJobs
from designer.base.files import place_of
from designer.base.marks import NOT_IN_FILE, Gap
from designer.base.options import argument, option
from designer.base.words import figure, printable
from designer.page.capability import capability
from designer.page.progress import Progress, unheard
from designer.page.result import Result

if TYPE_CHECKING:
    from calib.app.calibration import Run
    from calib.app.check_history import PastCheck
    from calib.app.inputs import Place
    from calib.app.solved_rig import SolvedRig
    from calib.cameras.camera import Camera
    from calib.cameras.rig import Rig
    from calib.core.types import Detections, Observations, RigObservations
    from calib.judge.drift import DriftHypothesis, DriftTest, LeftOut
    from calib.judge.reference import Reference
    from calib.rigs.result import RigCalibration
    from calib.solver.calibration import Calibration
    from designer.page.blocks import Page
    from designer.target import TargetGeometry

Verdict = Literal["yes", "no", "cannot say"]
MOST_NAMED, MISFITS, SURELY_FREE = 6, 1.2, 4.0
UNITS: Mapping[str, tuple[float, str]] = {
    "focal length": (100.0, "%"), "size": (100.0, "%"), "turn": (180 / math.pi, "deg"),
    "principal point": (1.0, "px"), "shift": (1.0, "mm"),
}  # fmt: skip
"""Of what is told: what its numbers are multiplied by, and the unit then."""
TOLD = ("focal length", "principal point", "turn", "shift")


@dataclass(frozen=True, eq=False)
class Change:
    """What the photos say of one change, as if it were the only one; nan where they tell nothing."""

    camera: str
    what: str  # "focal length", "principal point", and of a rig's camera "turn", "shift"
    unit: str
    amount: tuple[Gap, ...]  # of vectors along the camera's x, y, z
    sigma: tuple[Gap, ...]
    visible: Gap  # the least that would be found with 95 %

    @property
    def size(self) -> float:
        """The amount, or the length of a vector."""
        return self.amount[0] if len(self.amount) == 1 else math.hypot(*self.amount)

    @property
    def size_sigma(self) -> float:
        """The standard deviation of the size."""
        parts = (one * error for one, error in zip(self.amount, self.sigma, strict=True))
        return math.hypot(*parts) / max(abs(self.size), 1e-300)

    @property
    def text(self) -> str:
        """The size with its standard deviation."""
        sign = "" if len(self.amount) > 1 else "+" if self.size >= 0 else "-"
        return f"{sign}{figure(abs(self.size), 3)} \N{PLUS-MINUS SIGN} {figure(self.size_sigma, 2)} {self.unit}"


@dataclass(frozen=True)
class Cause:
    """What explains all that is seen."""

    camera: str  # "": the target
    what: str
    text: str


@dataclass(frozen=True, eq=False)
class CameraCheck(Result, kind="check", title="Check", doing="checking", files={}):
    """Whether cameras are as their file says: `found.verdict`, `found.changes[0].amount`."""

    verdict: Verdict
    reason: str
    p: Gap  # probability of photos like these if nothing changed
    false_alarms: float
    checked: str  # the file
    changes: tuple[Change, ...]
    causes: tuple[Cause, ...]  # one: it is that; several: these photos do not tell them apart; none: none explains it
    photos: tuple[str, ...]  # that counted; of a rig frames
    left_out: "tuple[LeftOut, ...]"
    remarks: tuple[str, ...]
    history: Annotated["tuple[PastCheck, ...]", NOT_IN_FILE] = ()
    test: Annotated["DriftTest | None", NOT_IN_FILE] = None
    image_sizes: Annotated[tuple[tuple[int, int], ...], NOT_IN_FILE] = ()

    @property
    def is_negative(self) -> bool:
        """Whether the answer is not yes: nothing that nobody knows passes a cron job."""
        return self.verdict != "yes"

    @property
    def remedy(self) -> str:
        """What to do before it is asked again."""
        if self.verdict == "no":
            return "solve again what is not as it was"
        return "" if self.verdict == "yes" else "take more photos: near, tilted by 20 to 50 deg, all over the image"

    def page(self) -> "Page":
        """The verdict with its numbers, residuals, and earlier checks."""
        from calib.app.check_page import check_page

        return check_page(self, is_drawn=True)

    def words(self, page: "Page | None" = None) -> "Page":
        """The same without figures."""
        from calib.app.check_page import check_page

        return check_page(self, is_drawn=False)


@capability
def check(
    camera: Annotated[
        "Camera | Rig | Calibration | RigCalibration | Run | SolvedRig | Place",
        argument("camera or rig file, or the folder of a calibration, which knows best", metavar="CAMERA|RIG"),
    ],
    target: Annotated[
        "TargetGeometry | Place | None",
        argument("the target file (NAME.target.json) of what the photos show; a table with X, Y, Z needs none"),
    ] = None,
    photos: Annotated[
        "Observations | RigObservations | Place | Iterable[Place | Detections]",
        argument("photos; of a rig a folder a camera, or one that holds these; or a table of sightings", is_many=True),
    ] = (),
    *,
    false_alarms_share: Annotated[
        float, option("how often a camera that is as its file says may be called changed", 0.001, 0.5)
    ] = 0.01,
    focal_percent: Annotated[
        float, option("a change of the focal length that matters: else it cannot be said", 1e-4, 100)
    ] = 0.1,
    turn_deg: Annotated[
        float, option("a turn of a rig's camera that matters; also a shift that moves its picture as far", 1e-4, 90)
    ] = 0.05,
    pattern: Annotated[
        str | None, option("of a rig: file names of all cameras in one folder: '{camera}{frame}.jpg'")
    ] = None,
    history: Annotated[
        "Place | None", option("folder with a table of all checks, to which this is added", metavar="DIR")
    ] = None,
    made: Made = None,
    jobs: PhotoJobs = None,
    progress: Progress = unheard,
) -> CameraCheck:
    """Tell whether a camera or a rig is still as its file says: `check("camera.json", "t.json", "photos").verdict`.

    From one photo or a few, of which only the poses are solved. The answer is yes, no, or cannot say: a change that
    matters would not have been seen. The exit code is 0 for yes, and 1 for no and for cannot say.

    >>> found = calib.check("camera.json", "board.target.json", "photos/*.jpg")
    >>> found.verdict, found.changes[0].amount, found.causes

    Raises:
        InputError: files that cannot be read, photos of another size, or a camera that has no parameters.
    """
    from calib.app.check_history import added, history_in
    from calib.app.check_inputs import TABLES, observed_for, reference_of_file
    from calib.app.inputs import in_order, target_of
    from calib.judge.drift import drift_test
    from calib.solver.target_error import unbent
    from designer.tolerance.made import EXACT, how_made

    folder = None if history is None else place_of(history, "a folder")
    if folder is not None:
        history_in(folder)  # refuses what is somebody else's before any work is done
    if (
        isinstance(photos, list | tuple)
        and not photos
        and isinstance(target, str | PathLike)
        and Path(target).suffix.lower() in TABLES
    ):
        photos, target = target, None
    reference, bend, bent_id, remarks = reference_of_file(
        in_order(
            camera,
            "calib check CAMERA|RIG TARGET PHOTO...",
            camera_rig_calibration=camera,
            target=target,
            photos=photos,
        )
    )
    geometry = None if target is None else target_of(target)
    seen, unseen, rendered_id, said = observed_for(reference, geometry, photos, pattern, jobs, progress)
    way = how_made(geometry, made, rendered_id=rendered_id)
    prior = None if way is None else way.prior
    if bend is not None and seen is not None and bent_id in (seen.points.geometry_id or None,):
        prior = None if prior is None else unbent(prior, bend, seen.points)
        seen = replace(seen, sightings=tuple(bend.bent(one) for one in seen.sightings))
    test = None
    if seen is not None:
        progress("comparing", 0, 0)
        test = drift_test(
            reference, seen, prior, false_alarms=false_alarms_share, is_exact=way is not None and way.name == EXACT
        )
    name = fspath(camera) if isinstance(camera, str | PathLike) else f"a {type(camera).__name__}"
    if way is not None and way.because and way.prior is not None:
        remarks = (*remarks, way.sentence)
    matters = focal_percent, turn_deg
    found = _told(test, reference, matters, false_alarms_share, name, unseen, (*remarks, *said))
    return found if folder is None else replace(found, history=added(folder, found))


def _told(
    test: "DriftTest | None", reference: "Reference", matters: tuple[float, float], false_alarms: float, checked: str,
    unseen: "tuple[LeftOut, ...]", remarks: tuple[str, ...],
) -> CameraCheck:  # fmt: skip
    """The verdict, and why."""
    none = "no photo shows enough of the target"
    if test is None:
        return CameraCheck("cannot say", none, math.nan, false_alarms, checked, (), (), (), unseen, remarks)
    every = [one for one in test.explanations if one.camera and one.what in TOLD]
    changes = tuple(_change_of(one) for one in every)
    causes = tuple(Cause(one.camera, one.what, _cause_text(test, one)) for one in test.causes)
    verdict, reason = _verdict(test, changes, causes, matters, reference)
    return CameraCheck(
        verdict, reason, test.p, false_alarms, checked, changes, causes, test.frames, (*unseen, *test.left_out),
        remarks, test=test, image_sizes=tuple(one.image_size for one in reference.rig.cameras),
    )  # fmt: skip


def _verdict(
    test: "DriftTest", changes: tuple[Change, ...], causes: tuple[Cause, ...], matters: tuple[float, float],
    reference: "Reference",
) -> tuple[Verdict, str]:  # fmt: skip
    """Yes only where what matters would have been seen."""
    if test.contradict:
        return "cannot say", "the photos contradict each other: something moved meanwhile, or another camera took one"
    if test.is_changed and reference.states_nothing and test.times_free < SURELY_FREE:
        return "cannot say", (
            f"the photos leave over {test.times_free:.1f} times what they would by a free camera, and the file does "
            "not say what it left over of those it was solved from; give the folder of the calibration"
        )
    if test.is_changed and not causes:
        return "no", "something changed, and no simple cause explains all of it"
    if test.is_changed:
        texts = " or ".join(one.text for one in causes[:MOST_NAMED])
        return "no", texts if len(causes) == 1 else f"{texts}: these photos do not tell which"
    least = {
        what: max((one for one in changes if one.what == what), key=lambda one: one.visible, default=None)
        for what in TOLD
    }  # fmt: skip
    focal, turn = matters
    wanted = {"focal length": focal, "turn": turn, "shift": test.distance_mm * math.tan(math.radians(turn))}
    for what, most in wanted.items():
        if (one := least[what]) is not None and one.visible > most:
            but = f"no change is seen, but {_visible(one)} would not be; what matters is {figure(most, 2)} {one.unit}"
            misfit = f"the calibration itself misfits, its own photos deviate {test.misfit:.1f} times what it states: "
            return "cannot say", f"{misfit if test.misfit > MISFITS else ''}{but}"
    if blind := [name for name in reference.rig.names if not any(one.camera == name for one in changes)]:
        return "cannot say", f"no photo of {', '.join(map(printable, blind))} shows the target"
    seen = [_visible(one) for what, one in least.items() if one is not None and (what in wanted or len(changes) == 2)]
    return "yes", f"as the file says: {', '.join(seen[:-1])} or {seen[-1]} would have been seen (95 %)"


def _visible(one: Change) -> str:
    size = f"{figure(one.visible, 2)} {one.unit}" if math.isfinite(one.visible) else "any size"
    word = {"focal length": "a change of the focal length", "principal point": "a move of the principal point"}
    return f"{word.get(one.what, 'a ' + one.what)} of {size}"


def _change_of(one: "DriftHypothesis") -> Change:
    scale, unit = UNITS[one.what]
    return Change(
        one.camera, one.what, unit, tuple((scale * one.amount).tolist()), tuple((scale * one.sigma).tolist()),
        scale * one.visible,
    )  # fmt: skip


def _cause_text(test: "DriftTest", one: "DriftHypothesis") -> str:
    """A cause with its number."""
    is_rig = len({each.camera for each in test.explanations if each.camera}) > 1
    name = printable(one.camera)
    of = f" of {name}" if is_rig else ""
    if one.what not in UNITS:
        return {
            "lens": f"the lens{of} is another (focal length, principal point and distortion together)",
            "place": f"{name} was turned and shifted", "bend": "the target is bent in another way",
        }[one.what]  # fmt: skip
    size = _change_of(one).text
    return {
        "focal length": f"the focal length{of} changed by {size}",
        "principal point": f"the principal point{of} moved by {size}", "turn": f"{name} was turned by {size}",
        "shift": f"{name} was shifted by {size}", "size": f"the target is larger than its file says by {size}",
    }[one.what]  # fmt: skip
