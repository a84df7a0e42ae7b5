"""The page of a rig: from a rig in memory, or from what its folder stores and nothing else."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from calib.draw.checks import check_findings
from calib.records.rig_file import CAMERAS, folder_names
from calib.records.rig_folder import RigRun, read_rig_run
from calib.rigs.halves import NoRigHalves, RigHalves
from calib.show.parts.origin import Origin
from calib.show.rig.carrier import carrier_section, next_poses_table
from calib.show.rig.graph import sharing_figure, sharing_words
from calib.show.rig.pictures import pictures_section
from calib.show.rig.scene import rig_view, rig_words
from calib.show.rig.tables import cameras_table, halves_table, pairs_table, places_table, ties_table
from calib.show.rig.words import halves_words, limits_of, next_steps, rig_facts, rig_headline, sentence
from calib.verdict.next_robot_poses import photo_names
from designer.base.words import capital, printable
from designer.page.blocks import Block, Command, Finding, Findings, Fold, Page, Paragraph, Section, Steps
from designer.page.folders import file_list, some_of, title_of

FILES = (
    ("rig.json", "the cameras, where each stands and the joint covariance, for other commands and programs"),
    ("rig_verdict.json", "what was checked, for programs"),
    ("rig_calibration.json", "the whole solution: poses, frames, covariances"),
    ("target.json", "the target as it was used"),
    ("sightings.csv", "what the cameras saw; --table solves it again"),
    ("hand_eye.json", "where the camera sits on what moves, or beside it, for a robot's program"),
    ("next_poses.csv", "the robot's next poses; calib hand-eye --robot reads it"),
)
FILES_OF_CAMERA = (
    ("calibration.json", "its part of the solution, as a calibration of its own"),
    ("camera.json", "its lens, for other commands and programs"),
    ("observations.csv", "each sighting and its residual"),
)


@dataclass(frozen=True, eq=False)
class RigPageView:
    """What the sections of a rig's page are made from."""

    run: RigRun
    folder: Path  # of its files


def rig_page(folder: Path, origin: Origin) -> Page:
    """Read a folder and build its page.

    Raises:
        InputError: the rig in it cannot be read; the message names the file.
    """
    return rig_page_of(read_rig_run(folder), folder, origin)


def rig_page_of(run: RigRun, folder: Path, origin: Origin) -> Page:
    """The page of a rig whose files lie in a folder: `SECTIONS`, as far as they have something to say."""
    view = RigPageView(run, folder)
    sections = tuple(section for make in SECTIONS if (section := make(view)) is not None)
    return Page(
        title=title_of(folder), kind="Rig of cameras", headline=rig_headline(run), lead=(rig_facts(run),),
        sections=sections, made_by=origin.command, program=origin.program,
    )  # fmt: skip


def _verdict(view: RigPageView) -> Section:
    """What was checked, and what the solution says."""
    run = view.run
    remarks = some_of(tuple(dict.fromkeys((*run.found.remarks, *run.found.observations.remarks))))
    rest = (
        *(Finding("usable", "Not on this page", printable(fault)) for fault in run.faults),
        *(Finding("note", "Said by the solution", printable(remark)) for remark in remarks),
    )
    checks: tuple[Block, ...] = () if run.verdict is None else (Findings(check_findings(run.verdict)),)
    return Section("Verdict", (*checks, *((Findings(rest),) if rest else ())))


def _next(view: RigPageView) -> Section | None:
    """What to do better, which frames to take, and what to go on with."""
    run = view.run
    advice = () if run.verdict is None else run.verdict.advice
    frames, poses = ((), ()) if run.judged is None else (run.judged.next_frames, run.judged.next_poses)
    named = (f"{name}: {pose.sentence}" for name, pose in zip(photo_names(poses), poses, strict=True))
    proposed = (*(frame.sentence for frame in frames), *(f"pose {line}" for line in named))
    steps = (*map(sentence, advice), *map(sentence, proposed))
    commands = tuple(Command(line, purpose) for line, purpose in next_steps(run))
    tables = (next_poses_table(poses),) if poses else ()
    blocks: tuple[Block, ...] = (*((Steps(steps),) if steps else ()), *tables, *commands)
    lead = ""
    if frames:
        lead = "The next frames would help most of those tried; what each gives is with those before it."
    elif poses:
        lead = (
            "The next poses of the robot would help most of those tried; what each gives is with those before it. "
            "Whether it gets there, and what stands in the way, is not known here."
        )
    return Section("Next", blocks, lead=lead) if blocks else None


def _scene(view: RigPageView) -> Section:
    return Section("The rig in 3D", (rig_view(view.run),), lead=rig_words(view.run.found))


def _cameras(view: RigPageView) -> Section:
    return Section("Cameras", (cameras_table(view.run), places_table(view.run)))


def _photos(view: RigPageView) -> Section | None:
    """What was found in a few photos of each camera."""
    return pictures_section(view.folder, view.run.found)


def _pairs(view: RigPageView) -> Section | None:
    """How cameras stand to each other."""
    pairs = view.run.evidence.pairs
    if not pairs:
        return None
    lead = "Of the joint covariance of all cameras, so that it does not matter whose frame the rig's is."
    return Section("Distances and angles", (pairs_table(pairs),), lead=lead)


def _sharing(view: RigPageView) -> Section | None:
    """How cameras hang together."""
    seen = view.run.found.observations
    if len(seen.camera_names) < 2:
        return None
    names, shared = seen.camera_names, seen.shared
    return Section(
        "How the cameras hang together", (sharing_figure(names, shared), ties_table(view.run)),
        lead=sharing_words(names, shared),
    )  # fmt: skip


def _halves(view: RigPageView) -> Section:
    """Whether the standard deviations can be believed."""
    halves = view.run.evidence.halves
    if isinstance(halves, NoRigHalves):
        return Section("Halves of the frames", (Paragraph(f"{capital(halves_words(halves))}."),))
    return Section("Halves of the frames", (halves_table(halves),), lead=_halves_lead(halves))


def _halves_lead(halves: RigHalves) -> str:
    return f"Rigs solved from halves of the frames: {halves_words(halves)}."


def _carrier(view: RigPageView) -> Section | None:
    """What moved the target or the cameras."""
    carrier = view.run.found.carrier
    return None if carrier is None else carrier_section(carrier, view.run.found)


def _limits(view: RigPageView) -> Section:
    return Section("What is not in the numbers", tuple(Paragraph(line) for line in limits_of(view.run)))


def _files(view: RigPageView) -> Section:
    """What the folder holds: of the rig in sight, of its cameras behind a click."""
    folder, names = view.folder, view.run.found.observations.camera_names
    found = file_list(folder, FILES)
    own = tuple(
        Fold(
            f"Files of {printable(name)}",
            (file_list(folder, tuple((f"{CAMERAS}/{place}/{file}", why) for file, why in FILES_OF_CAMERA)),),
        )
        for name, place in zip(names, folder_names(names), strict=True)
    )
    return Section("Files", (found, *own))


SECTIONS: list[Callable[[RigPageView], Section | None]] = [
    _verdict, _next, _scene, _cameras, _photos, _pairs, _sharing, _carrier, _halves, _limits, _files,
]  # fmt: skip
"""In the order of reading; one that has nothing to say of a rig is None."""
