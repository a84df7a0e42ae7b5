"""A rig that is solved and judged, and its folder: what `calib.rig`, `calib.hand_eye` and `calib.turntable` give."""

import shlex
from collections.abc import Mapping
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, cast

from calib.app.calibration import SolvedCameras
from calib.app.options import exports_folder
from designer.base.errors import InputError
from designer.base.files import check_folder, named_in_files
from designer.base.own_files import require_ours
from designer.base.words import printable
from designer.page.progress import Progress

if TYPE_CHECKING:
    from calib.app.inputs import Place
    from calib.cameras.rig import Rig
    from calib.core.types import RigObservations
    from calib.judge.folders import RigRun
    from calib.judge.hand_eye_file import HandEye
    from calib.judge.joint_solution import RigSeen
    from calib.judge.judge import Judged
    from calib.judge.verdict import NextPose
    from calib.rigs.result import RigCalibration
    from designer.base.answer import Value
    from designer.page.blocks import Page
    from designer.page.output import Output

SIGHTINGS_FILE, NEXT_POSES_FILE = "sightings.csv", "next_poses.csv"


@dataclass(frozen=True, eq=False, repr=False)
class SolvedRig(
    SolvedCameras, kind="rig", title="Rig of cameras", sought="solution",
    files={
        "rig.json": "the cameras, where each stands and the joint covariance, for other commands and programs",
        "verdict.json": "what was checked, for programs",
        "rig_calibration.json": "the whole solution: poses, frames, covariances",
        "target.json": "the target as it was used", SIGHTINGS_FILE: "what the cameras saw; --table solves it again",
        "hand_eye.json": "where the camera sits on what moves, or beside it, for a robot's program",
        NEXT_POSES_FILE: "the robot's next poses; calib hand-eye --robot reads it",
    },
):  # fmt: skip
    """Cameras that saw one target together, and where each stands: `found.rig.save("rig.json")`."""

    run: "RigRun"  # as it is read from its folder
    seen: "RigSeen | None" = None  # what it was solved from; None: read from a folder
    folder: Path | None = None  # that holds it; None: nothing is written

    @property
    def rig(self) -> "Rig":
        """What a program needs of it, its covariances enlarged if halves of the frames ask for it."""
        return self.run.stated.rig

    @property
    def calibration(self) -> "RigCalibration":
        """The whole solution."""
        return self.run.found

    @property
    def observations(self) -> "RigObservations":
        """What it was solved from."""
        return self.calibration.observations if self.seen is None else self.seen.observations

    @property
    def judged(self) -> "Judged":
        """The verdict, and what it rests on.

        Raises:
            ValueError: nobody judged the rig of this folder.
        """
        if self.run.judged is None:
            raise ValueError("nobody judged the rig of this folder")
        return self.run.judged

    @property
    def hand_eye(self) -> "HandEye":
        """Where the first camera sits on the robot, or beside it.

        Raises:
            ValueError: nothing carried the rig.
        """
        from calib.judge.hand_eye_file import hand_eye_of

        return hand_eye_of(self.calibration, self.rig.covariance, self.next_poses)

    @property
    def next_poses(self) -> "tuple[NextPose, ...]":
        """Poses of the robot from which photos would tell most of where the camera sits: `[0].base_from_flange`."""
        return () if self.run.judged is None else self.run.judged.next_poses

    @property
    def remarks(self) -> tuple[str, ...]:  # type: ignore[override]  # a field of other results
        """What a person must know of photos, observations and cameras, one line each."""
        made = () if self.seen is None or self.seen.made is None else (self.seen.made.sentence,)
        return tuple(dict.fromkeys((*made, *self.calibration.remarks, *self.observations.remarks)))

    @property
    def remedy(self) -> str:
        """To do what the verdict advises."""
        return "do what is said above" if self.is_negative else ""

    def page(self) -> "Page":
        """All that is told, without pictures of the photos."""
        from calib.app.rig_page import rig_page

        return rig_page(self.run)

    def page_beside(self, folder: Path) -> "Page":
        """The same with the pictures in the folder, which are drawn if photos were searched."""
        from calib.app.rig_page import rig_page
        from calib.draw.rig_pictures import draw_rig_pictures

        search = None if self.seen is None else self.seen.search
        faults = () if search is None else draw_rig_pictures(folder, self.calibration, search)
        return rig_page(replace(self.run, faults=(*self.run.faults, *faults)), folder)

    def words(self, page: "Page | None" = None) -> "Page":
        """Its lead, checks and tables, how the target was made, and commands that are typed outside of the folder."""
        from calib.app.rig_page import next_steps, rig_page
        from designer.page.blocks import Section
        from designer.page.folders import notes

        said = page or rig_page(self.run, is_drawn=False)
        made = () if self.seen is None or self.seen.made is None else notes((self.seen.made.sentence,))
        place = "" if self.folder is None else shlex.quote(printable(str(self.folder)))
        steps = () if self.is_negative else next_steps(self.run, place)
        return replace(said, sections=(*said.sections, Section("", made)), next_steps=steps)

    def draw_page(self, folder: Path, command: str = "") -> "tuple[Page | None, tuple[Path, ...], str]":
        """Likewise; with the pictures among its files."""
        from calib.draw.rig_pictures import pictures_in

        page, files, remark = super().draw_page(folder, command)
        return page, files if page is None else (*pictures_in(folder, self.calibration), *files), remark

    def purposes(self, folder: Path) -> tuple[tuple[str, str], ...]:
        """Those of the rig, and the lens of each camera."""
        from calib.rigs.rig_calibration_file import CAMERAS, folder_names

        names = self.calibration.observations.camera_names
        lenses = (
            (f"{CAMERAS}/{place}/camera.json", f"the lens of {printable(name)}; beside it its part of the solution")
            for name, place in zip(names, folder_names(names), strict=True)
        )
        return (*self.files.items(), *lenses)

    def answer(self) -> "dict[str, Value]":
        """The verdict, cameras and pairs."""
        from calib.app.rig_page import rig_answer

        return rig_answer(self)

    @classmethod
    def check(cls, folder: Path) -> None:
        """Refuse a folder that takes no rig, or holds somebody else's files, before any work is done.

        Raises:
            InputError: the message names the file.
        """
        from calib.cameras.rig import RIG
        from calib.judge.folders import RIG_FILE
        from calib.judge.hand_eye_file import HAND_EYE, HAND_EYE_FILE
        from calib.judge.judge import VERDICT, VERDICT_FILE
        from calib.observe.calibration_file import RIG_CALIBRATION_FILE
        from calib.observe.rig_observations import KIND as SIGHTINGS
        from calib.observe.robot_poses import KIND as ROBOT_POSES
        from calib.rigs.rig_calibration_file import RIG_CALIBRATION

        check_folder(folder)
        for name, kind in (
            (RIG_CALIBRATION_FILE, RIG_CALIBRATION.format), (RIG_FILE, RIG.format), (SIGHTINGS_FILE, SIGHTINGS),
            (VERDICT_FILE, VERDICT.format), (HAND_EYE_FILE, HAND_EYE.format), (NEXT_POSES_FILE, ROBOT_POSES),
        ):  # fmt: skip
            require_ours(folder / name, kind=kind)

    def write(self, out: "Output") -> "SolvedRig":
        """Write all but the page; the rig with its folder.

        Raises:
            InputError: a file is somebody else's, or the solution makes no sense.
        """
        import numpy as np

        from calib.draw.rig_pictures import pictures_in
        from calib.judge.folders import keep_target, kind_in, write_rig
        from calib.judge.hand_eye_file import HAND_EYE, HAND_EYE_FILE
        from calib.judge.next_robot_poses import photo_names
        from calib.observe.photos import remove_ours
        from calib.observe.rig_observations import rig_sightings_to_csv
        from calib.observe.robot_poses import robot_poses_to_csv
        from designer.page.page_file import why_no_page

        folder, run = out.place, self.run
        self.check(folder)
        if why := why_no_page(folder, self.kind):
            raise InputError(why)
        is_again = kind_in(folder) == "rig"
        out.files += write_rig(folder, run.found, run.provenance, run.judged)
        tables = {folder / SIGHTINGS_FILE: rig_sightings_to_csv(self.observations)}
        if run.found.carrier is not None:
            tables[folder / HAND_EYE_FILE] = HAND_EYE.text(self.hand_eye)
        if self.next_poses:
            poses = np.stack([one.base_from_flange for one in self.next_poses])
            tables[folder / NEXT_POSES_FILE] = robot_poses_to_csv(photo_names(self.next_poses), poses)
        else:
            (folder / NEXT_POSES_FILE).unlink(missing_ok=True)  # those of an earlier run help no more
        out.write(tables)
        if run.target is not None:
            out.files += keep_target(folder, run.target, is_again=is_again)
        remove_ours(pictures_in(folder, run.found))  # of an earlier run, which may be of other photos
        out.finished.append(folder)
        return replace(self, folder=folder)


def folder_for(name: str, given: Mapping[str, object], target: str = "target") -> Path:
    """Where a command writes unless it is told: beside a target's other results, if there is one."""
    return exports_folder(cast(Path, given[target])) / name if target in given else Path(name)


def settings_of(*given: tuple[str, object]) -> tuple[tuple[str, str], ...]:
    """Names and the files that were given for them, for the record."""
    return tuple((name, named_in_files(Path(one))) for name, one in given if isinstance(one, str | PathLike))


def begun(out: "Output | Place | None") -> "Output | None":
    """The folder that a rig is written to; InputError: it takes none."""
    to = SolvedRig.begun(out)
    if to is not None:
        to.answer = {"verdict": None}
    return to


def finished(found: SolvedRig, to: "Output | None", out: "Output | Place | None", progress: Progress) -> SolvedRig:
    """The rig, written if there is a folder, with its page if nobody else draws that."""
    if to is None:
        return found
    progress("writing", 0, 0)
    to.answer = {}
    found = found.write(to)
    if to is not out:
        found.drawn_in(to.place)
    return found
