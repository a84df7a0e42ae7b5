"""What `rig` returns, and the folder it writes."""

import os
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from calib.api.page_shown import ShownAsPage
from calib.api.rig_observing import RigSearch
from calib.api.rig_pictures import draw_rig_pictures, remove_rig_pictures
from calib.app.inputs import folder_of
from calib.cameras.rig import RIG, Rig
from calib.core.types import RigObservations
from calib.observe.calibration_file import Provenance
from calib.observe.rig_sightings import KIND as SIGHTINGS
from calib.observe.rig_sightings import rig_sightings_to_csv
from calib.records.hand_eye_file import HAND_EYE, HAND_EYE_FILE, HandEye, hand_eye_of
from calib.records.rig_file import RIG_CALIBRATION, RIG_CALIBRATION_FILE, RIG_FILE, write_rig
from calib.records.rig_folder import RigRun
from calib.rigs.halves import enlarged
from calib.rigs.options import CameraChoice
from calib.rigs.result import RigCalibration
from calib.robot.poses import KIND as ROBOT_POSES
from calib.robot.poses import robot_poses_to_csv
from calib.show.folder import PAGE_FILE, why_no_page, write_folder_page
from calib.show.parts.kept_target import keep_target
from calib.solver.options import SolveOptions
from calib.verdict.next_robot_poses import NextPose, photo_names
from calib.verdict.rig_judge import RIG_VERDICT, RIG_VERDICT_FILE, JudgedRig
from calib.verdict.verdict import Verdict
from designer.base.answer import program
from designer.base.errors import InputError
from designer.base.files import check_folder, write_files
from designer.base.own_files import require_ours
from designer.target import TargetGeometry
from designer.tolerance.made import Made

SIGHTINGS_FILE, NEXT_POSES_FILE = "sightings.csv", "next_poses.csv"


@dataclass(frozen=True, eq=False)
class RigResult(ShownAsPage):
    """Cameras that saw one target together, and where each stands: `found.rig.save("rig.json")`.

    In a notebook the result shows its report.
    """

    target: TargetGeometry | None  # None: the points came from elsewhere
    search: RigSearch | None  # of the photos; None: solved from observations
    observations: RigObservations  # as they were solved from
    choices: tuple[CameraChoice, ...]  # of each camera
    calibration: RigCalibration
    judged: JudgedRig
    made: Made | None  # how the target was; None: nobody knows
    settings: tuple[tuple[str, str], ...] = ()  # names and values as they were given, for the record
    options: SolveOptions = field(default_factory=SolveOptions)  # what held for all cameras
    kind = "rig"

    def __repr__(self) -> str:
        """A line, where no page can be shown."""
        return f"<RigResult, {self.verdict.grade}: {self.verdict.sentence}>"

    @property
    def rig(self) -> Rig:
        """What a program needs of it, its covariances enlarged if halves of the frames ask for it."""
        return enlarged(self.calibration, self.judged.compared).rig

    @property
    def hand_eye(self) -> HandEye:
        """Where the first camera sits on the robot, or beside it.

        Raises:
            ValueError: nothing carried the rig.
        """
        return hand_eye_of(self.calibration, self.rig.covariance, self.next_poses)

    @property
    def next_poses(self) -> tuple[NextPose, ...]:
        """Poses of the robot from which photos would tell most of where the camera sits: `[0].base_from_flange`."""
        return self.judged.next_poses

    @property
    def verdict(self) -> Verdict:
        """Whether to use it, and why."""
        return self.judged.verdict

    @property
    def told(self) -> RigRun:
        """As it would be read from its folder."""
        return RigRun(self.calibration, self.provenance, self.judged, self.target)

    @property
    def remarks(self) -> tuple[str, ...]:
        """What a person must know of photos, observations and cameras, one line each."""
        made = () if self.made is None else (self.made.sentence,)
        return tuple(dict.fromkeys((*made, *self.calibration.remarks, *self.observations.remarks)))

    @property
    def provenance(self) -> Provenance:
        """Where it comes from."""
        layout_id = "" if self.target is None else self.target.layout_id
        geometry_id = self.observations.points.geometry_id
        return Provenance(program(), layout_id, geometry_id, options=self.options, settings=self.settings)

    def save(self, folder: str | os.PathLike[str]) -> tuple[Path, ...]:
        """Write the folder that `calib rig` writes; return the files.

        Raises:
            InputError: the folder takes no files, or holds somebody else's; the message names them.
        """
        writer = RigWriter(folder_of(folder))
        writer.write(self)
        if remark := writer.write_page(self, ""):
            raise InputError(remark)
        return tuple(writer.files)


class RigWriter:
    """Writes one folder, and knows what it has written."""

    def __init__(self, folder: Path) -> None:
        """Refuse a place that takes no files, or holds somebody else's, before any work is done.

        Raises:
            InputError: the message names the file.
        """
        self.folder = folder
        self.begin()
        check_folder(folder)
        for name, kind in (
            (RIG_CALIBRATION_FILE, RIG_CALIBRATION.format), (RIG_FILE, RIG.format), (SIGHTINGS_FILE, SIGHTINGS),
            (RIG_VERDICT_FILE, RIG_VERDICT.format), (HAND_EYE_FILE, HAND_EYE.format), (NEXT_POSES_FILE, ROBOT_POSES),
        ):  # fmt: skip
            require_ours(folder / name, kind=kind)

    def begin(self) -> None:
        """Nothing is written yet: of a rig that is solved again, what came of the first attempt does not count."""
        self.files: list[Path] = []
        self._faults: tuple[str, ...] = ()  # what could not be drawn of a rig, for its page

    def write(self, found: RigResult) -> None:
        """Write all of a rig but its page: the verdict, too.

        Raises:
            InputError: a file is somebody else's, or the solution makes no sense.
        """
        if why := why_no_page(self.folder, found.kind):
            raise InputError(why)
        is_again = (self.folder / RIG_CALIBRATION_FILE).exists()
        self.files += write_rig(self.folder, found.calibration, found.provenance, found.judged)
        tables = {self.folder / SIGHTINGS_FILE: rig_sightings_to_csv(found.observations)}
        if found.calibration.carrier is not None:
            tables[self.folder / HAND_EYE_FILE] = HAND_EYE.text(found.hand_eye)
        if found.next_poses:
            poses = np.stack([one.base_from_flange for one in found.next_poses])
            tables[self.folder / NEXT_POSES_FILE] = robot_poses_to_csv(photo_names(found.next_poses), poses)
        write_files(tables)
        if not found.next_poses:
            (self.folder / NEXT_POSES_FILE).unlink(missing_ok=True)  # those of an earlier run help no more
        self.files += tables
        if found.target is not None:
            self.files += keep_target(self.folder, found.target, is_again=is_again)
        remove_rig_pictures(self.folder, found.calibration)

    def write_page(self, found: RigResult, command: str) -> str:
        """Write the folder's page and draw the pictures on it; why there is none, or "".

        Args:
            found: what it shows, all written.
            command: that made the results; "" if it is not known.
        """
        from calib.show.rig.rig_page import rig_page_of

        files, remark = write_folder_page(
            self.folder, found.kind, command,
            lambda origin: rig_page_of(replace(found.told, faults=self._faults), self.folder, origin),
            keep=lambda: self._pictures(found),
        )  # fmt: skip
        self.files += files
        return remark

    def _pictures(self, found: RigResult) -> tuple[Path, ...]:
        """Draw what the page shows of the photos; none if there are no photos."""
        if found.search is None:
            return ()
        pictures, self._faults = draw_rig_pictures(self.folder, found.calibration, found.search)
        return pictures

    def earlier_page(self) -> str:
        """A word on a page of an earlier rig in the folder, which shows another; "" if there is none."""
        page = self.folder / PAGE_FILE
        return f"{page}: is of an earlier run; calib report {self.folder} draws it again" if page.exists() else ""
