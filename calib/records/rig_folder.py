"""A rig as its page and its commands tell it: in memory (`calib rig`) and from its folder it is the same value."""

import hashlib
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

from calib.observe.calibration_file import Provenance
from calib.records.rig_file import RIG_CALIBRATION_FILE, read_rig
from calib.rigs.result import RigCalibration
from calib.verdict.judged_run import TARGET_FILE
from calib.verdict.rig_evidence import RigEvidence, rig_evidence
from calib.verdict.rig_judge import RIG_VERDICT, RIG_VERDICT_FILE, JudgedRig, judge_rig
from calib.verdict.verdict import Criteria, Verdict
from designer.base.errors import InputError
from designer.base.files import write_files
from designer.base.words import printable
from designer.target import TargetGeometry, load_target


@dataclass(frozen=True, eq=False)
class RigRun:
    """A solved rig, and what is known of it."""

    found: RigCalibration
    provenance: Provenance
    judged: JudgedRig | None = None  # None: nobody judged
    target: TargetGeometry | None = None  # as it was used
    faults: tuple[str, ...] = ()  # what is there and could not be read or written, one line each

    @property
    def verdict(self) -> Verdict | None:
        """On the rig."""
        return None if self.judged is None else self.judged.verdict

    @cached_property
    def evidence(self) -> RigEvidence:
        """What it was, or would be, judged by."""
        return rig_evidence(self.found, (self.judged or JudgedRig(_NOTHING, _NO_CRITERIA)).compared)


_NO_CRITERIA = Criteria("", "", {})
_NOTHING = Verdict("usable", "", "", (), ())


def read_rig_run(folder: Path) -> RigRun:
    """Read a rig's folder; a verdict or a target that cannot be read is left out, and said.

    Raises:
        InputError: the rig cannot be read; the message names the file.
    """
    found, provenance = read_rig(folder)
    faults: list[str] = []
    judged: JudgedRig | None = None
    target: TargetGeometry | None = None
    try:
        judged = RIG_VERDICT.read_if_there(folder / RIG_VERDICT_FILE)
    except InputError as error:
        faults.append(_within(folder, error))
    if judged is not None and judged.solution_sha256 != _digest(folder):
        faults.append(f"{RIG_VERDICT_FILE}: on another solution; calib report with --criteria judges again")
        judged = None
    try:
        target = load_target(folder / TARGET_FILE) if (folder / TARGET_FILE).exists() else None
    except InputError as error:
        faults.append(_within(folder, error))
    if target is not None and target.geometry_id != found.observations.points.geometry_id:
        faults.append(f"{TARGET_FILE}: not the target that the rig was solved with, so it is not drawn")
        target = None
    return RigRun(found, provenance, judged, target, tuple(faults))


def judge_rig_again(folder: Path, criteria: Criteria) -> JudgedRig:
    """Judge a folder's rig by other limits, and write `rig_verdict.json`; halves are those of the verdict there.

    Raises:
        InputError: the folder holds no rig that can be read, or takes no files; the message names it.
    """
    run = read_rig_run(folder)
    judged = replace(judge_rig(run.found, run.evidence.halves, criteria), solution_sha256=_digest(folder))
    write_files({folder / RIG_VERDICT_FILE: RIG_VERDICT.text(judged)})
    return judged


def _digest(folder: Path) -> str:
    return hashlib.sha256((folder / RIG_CALIBRATION_FILE).read_bytes()).hexdigest()


def _within(folder: Path, error: InputError) -> str:
    """What is wrong, with paths as they are from the page."""
    return printable(str(error).replace(f"{folder}/", ""))
