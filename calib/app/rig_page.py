"""What a rig tells: its lead, which a screen says too, the sections of its page, and the answer for programs."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, cast

import numpy as np

from calib.draw.rig_pictures import pictures_section
from calib.draw.rig_tables import (
    cameras_table,
    frame_name,
    halves_table,
    mechanism_section,
    next_poses_table,
    next_poses_words,
    pairs_table,
    places_table,
    ties_table,
)
from calib.draw.run_tables import headline_by, verdict_blocks
from calib.judge.folders import RIG_FILE, RigRun
from calib.judge.halves import NoHalves, RigHalves, SplitKind
from calib.judge.next_robot_poses import photo_names
from calib.rigs.relative import center_sigma_mm
from calib.rigs.rig_calibration_file import CAMERAS, folder_names
from designer.base.words import capital, counted, printable, span
from designer.base.words import figure as digits
from designer.page.blocks import Block, Command, Facts, Page, Paragraph, Section, Steps
from designer.page.folders import some_of

if TYPE_CHECKING:
    from calib.app.solved_rig import SolvedRig
    from calib.rigs.result import MechanismFit, RigCalibration
    from designer.base.answer import Value

KINDS_OF_HALVES: tuple[tuple[SplitKind, str], ...] = (
    ("by turns", "alike ones"),
    ("in order", "the first and the last"),
)
OF_PAIRS = "Of the joint covariance of all cameras, so that it does not matter whose frame the rig's is."
OF_NEXT_FRAMES = "The next frames would help most of those tried; what each gives is with those before it."
OF_NEXT_POSES = (
    "The next poses of the robot would help most of those tried; what each gives is with those before it. "
    "Whether it gets there, and what stands in the way, is not known here."
)


def rig_page(run: RigRun, folder: Path | None = None, *, is_drawn: bool = True) -> Page:
    """All that a rig tells.

    Args:
        is_drawn: with its scene and graph, which take a second.
    """
    evidence = run.evidence
    seen, halves = run.found.observations, evidence.halves
    remarks = some_of(tuple(dict.fromkeys((*run.found.remarks, *seen.remarks))))
    sections = [Section("Verdict", verdict_blocks(run.verdict, run.faults, remarks)), *_next(run)]
    if is_drawn:
        from calib.draw.solved_rig_scene import rig_view, rig_words

        sections.append(Section("The rig in 3D", (rig_view(run),), lead=rig_words(run.found)))
    sections.append(Section("Cameras", (cameras_table(run), places_table(run))))
    if folder is not None and (pictures := pictures_section(folder, run.found)) is not None:
        sections.append(pictures)
    if evidence.pairs:
        sections.append(Section("Distances and angles", (pairs_table(evidence.pairs),), lead=OF_PAIRS))
    if len(seen.camera_names) > 1:
        from calib.draw.rig_tables import sharing_figure, sharing_words

        graph = (sharing_figure(seen.camera_names, seen.shared),) if is_drawn else ()
        lead = sharing_words(seen.camera_names, seen.shared)
        sections.append(Section("How the cameras hang together", (*graph, ties_table(run)), lead=lead))
    if run.found.carrier is not None:
        sections.append(mechanism_section(run.found.carrier, run.found))
    compared = (
        (Paragraph(f"{capital(halves_words(halves))}."),) if isinstance(halves, NoHalves) else (halves_table(halves),)
    )
    lead = "" if isinstance(halves, NoHalves) else f"Rigs solved from halves of the frames: {halves_words(halves)}."
    sections += [
        Section("Halves of the frames", compared, lead=lead),
        Section("What is not in the numbers", tuple(map(Paragraph, limits_of(run)))),
    ]
    unjudged = f"{counts_words(run)}. Nobody judged it; calib report with --criteria standard does."
    headline = headline_by(run.verdict, unjudged)
    return Page("", "", headline, tuple(sections), lead=(rig_facts(run),), next_steps=next_steps(run))


def _next(run: RigRun) -> tuple[Section, ...]:
    """What to do better, and which frames or poses to take."""
    if run.judged is None:
        return ()
    frames, poses = run.judged.next_frames, run.judged.next_poses
    named = zip(photo_names(poses), poses, strict=True)
    proposed = (*(frame.sentence for frame in frames), *(f"pose {name}: {pose.sentence}" for name, pose in named))
    steps = tuple(f"{capital(printable(line))}." for line in (*run.judged.verdict.advice, *proposed))
    blocks: tuple[Block, ...] = (*((Steps(steps),) if steps else ()), *((next_poses_table(poses),) if poses else ()))
    lead = OF_NEXT_FRAMES if frames else OF_NEXT_POSES if poses else ""
    return (Section("What would help", blocks, lead=lead),) if blocks else ()


def counts_words(run: RigRun) -> str:
    """How many cameras, frames and sightings."""
    found = run.found
    sightings = sum(int((~out).sum()) for out in found.is_outlier)
    cameras, frames = counted(len(found.cameras), "camera"), counted(len(found.rig_from_target), "frame")
    return f"{cameras}, {frames}, {sightings} sightings"


def rig_facts(run: RigRun) -> Facts:
    """Cameras, residuals, distances, error in space and checks, a line each."""
    found, evidence = run.found, run.evidence
    own = printable(frame_name(found))
    known_px = [one.rms_px for one in evidence.cameras if math.isfinite(one.rms_px)]
    rows = [
        ("rig", f"{counts_words(run)}, {found.status}"),
        ("its frame", f"that of {own}: x right, y down, z forward" if found.reference >= 0 else f"that of the {own}"),
        ("residuals", f"{span(known_px, 2)} px RMS, camera by camera" if known_px else "none"),
    ]
    if found.carrier is not None:
        rows.append(("camera", _sits_words(run.stated)))
        rows.append(("carried by", mechanism_words(found.carrier)))
    if run.judged is not None and run.judged.next_poses:
        rows.append(("next poses", next_poses_words(run.judged.next_poses)))
    if evidence.pairs:
        rows.append(("distances", _distances_words(run)))
    if evidence.middle is not None:
        one = evidence.middle
        parts = f"{digits(one.noise_mm, 2)} mm by noise, {digits(one.rig_mm, 2)} mm by the rig"
        placed = (
            f"a point {digits(one.away_mm, 3)} mm away is placed to {digits(one.sigma_mm, 2)} mm (1 sigma): {parts}"
        )
        rows.append(("in space", placed))
    rows.append(("halves", halves_words(evidence.halves)))
    if run.judged is not None:
        checks = [check for check in run.judged.verdict.checks if check.grade != "unknown"]
        good = sum(check.grade == "good" for check in checks)
        criteria = run.judged.criteria
        rows.append((
            "checks", f"{good} of {len(checks)} good; limits: {printable(criteria.name)} ({printable(criteria.title)})"
        ))  # fmt: skip
    return Facts(tuple(rows))


def _sits_words(found: "RigCalibration") -> str:
    """Where the first camera sits on what moves, or beside it, with its deviations."""
    rig = found.rig
    place = ", ".join(f"{value:.2f}" for value in rig.center_mm[0].tolist())
    sigma = center_sigma_mm(rig)[0] if rig.covariance is not None else np.full(3, math.nan)
    if not np.isfinite(sigma).all():
        return f"{found.rig_frame}_from_cam: at {place} mm; not determined"
    turn = np.sqrt(np.diagonal(rig.covariance)[rig.pose_rows(0)][:3]) if rig.covariance is not None else sigma
    deviations = ", ".join(digits(value, 2) for value in sigma.tolist())
    return (
        f"{found.rig_frame}_from_cam: at {place} mm, known to {deviations} mm and "
        f"{digits(float(np.rad2deg(turn.max())), 2)} deg (1 sigma)"
    )


def mechanism_words(carrier: "MechanismFit") -> str:
    """What carried it, and how well that says where it is."""
    if not (math.isfinite(carrier.sigma_mm) and math.isfinite(carrier.sigma_rad)):
        return printable(carrier.kind)
    own = f"{digits(carrier.sigma_mm, 2)} mm and {digits(float(np.rad2deg(carrier.sigma_rad)), 2)} deg"
    size = ""
    if carrier.size_sigma > 0:
        size = f"; by its ways the target has {100 * carrier.size:.2f} % of the size its file says"
    return f"{printable(carrier.kind)}; its own errors are {own} a coordinate{size}"


def _distances_words(run: RigRun) -> str:
    pairs = [pair.relative for pair in run.evidence.pairs]
    known = [one for one in pairs if math.isfinite(one.baseline_sigma_mm)]
    if not known:
        return "not determined"
    if len(pairs) == 1:
        return f"{digits(known[0].baseline_mm, 5)} ± {digits(known[0].baseline_sigma_mm, 2)} mm between the cameras"
    worst = digits(max(one.baseline_sigma_mm for one in known), 2)
    return f"{span(one.baseline_mm for one in known)} mm between cameras, each known to {worst} mm or better (1 sigma)"


def halves_words(halves: RigHalves | NoHalves) -> str:
    """What halves of the frames tell of the stated standard deviations."""
    if isinstance(halves, NoHalves):
        return f"not compared: {printable(halves.reason)}"
    parts = [
        f"{words} differ by {digits(ratio, 2)} sigma"
        for kind, words in KINDS_OF_HALVES
        if math.isfinite(ratio := halves.ratio_of(kind))
    ]
    chance = f"chance gives up to {digits(halves.by_chance, 2)}"
    if halves.factor > 1:
        chance += f", so the noise's part of all sigmas here is {digits(halves.factor, 2)} times as large"
    if halves.target_factor < halves.factor:
        at_target = f"{digits(halves.target_factor, 2)} times" if halves.target_factor > 1 else "as stated"
        chance += f"; where they place the target they are {at_target}"
    return f"{', '.join(parts)}; {chance}"


def limits_of(run: RigRun) -> tuple[str, ...]:
    """What the numbers do not hold, a line each."""
    found = run.found
    lines = []
    if found.target_covariance is None or not found.target_covariance.any():  # not known, or taken as exact
        lines.append(
            "The target is taken to be as its file says. All lengths have its scale: printed 0.1 % too large, they are "
            "0.1 % too large, whatever the standard deviations say."
        )
    else:
        lines.append("What the target may be off, its scale above all, is in the standard deviations.")
    given = [
        printable(name)
        for name, refined in zip(found.observations.camera_names, found.is_refined, strict=True)
        if not refined
    ]
    if given:
        lines.append(f"The lens of {', '.join(given)} was given, and is taken as exact.")
    if found.delay_s is None and len(found.cameras) > 1:
        lines.append(
            "The photos of a frame are taken to be of one moment: a target that moved while cameras were not "
            "synchronous shows in the residuals, and its part that repeats in none."
        )
    if isinstance(run.evidence.halves, NoHalves):
        lines.append("Standard deviations are by the residuals' noise alone, and nothing checked them.")
    lines.append(
        "What all frames have in common no halves show: a lens that the camera model does not fit, cameras that sag, "
        "or another temperature when the rig is used."
    )
    return tuple(lines)


def next_steps(run: RigRun, folder: str = "") -> tuple[Command, ...]:
    """Commands to go on with, and what for.

    Args:
        folder: of its files, as it is typed in a shell; "": they are typed in it.
    """
    place = f"{folder}/{RIG_FILE}" if folder else RIG_FILE
    convert = Command(f"calib convert {place} --to ros -o ros", "The rig as files of another program; --to says which")
    if len(run.found.cameras) < 2:
        return (convert,)
    return (
        Command(f"calib budget {place}", "What errors in space to expect, where and by what"),
        Command(f"calib triangulate {place} sightings.csv", "Points that the cameras see, in mm, with covariances"),
        convert,
    )


def rig_answer(found: "SolvedRig") -> "dict[str, Value]":
    """The rig as programs are told of it."""
    from calib.judge.verdict import Verdict
    from calib.observe.calibration_file import CAMERA_FILE
    from designer.base.codec import encode

    solved, rig, evidence, folder = found.calibration, found.rig, found.run.evidence, found.folder or Path()
    verdict = found.run.verdict
    folders = folder_names(rig.names)
    centers_mm, sigmas_mm = rig.center_mm + 0.0, center_sigma_mm(rig)
    cameras: list[Value] = [
        {
            "name": one.name,
            "model": rig.cameras[row].model,
            "is_refined": solved.is_refined[row],
            "frames": one.frames,
            "sightings": one.sightings,
            "outliers": one.left_out,
            "rms_px": one.rms_px,
            "center_mm": centers_mm[row].tolist(),
            "center_sigma_mm": sigmas_mm[row].tolist(),
            "delay_s": None if rig.delay_s is None else float(rig.delay_s[row]),
            "camera_file": str(folder / CAMERAS / folders[row] / CAMERA_FILE),
        }
        for row, one in enumerate(evidence.cameras)
    ]
    pairs: list[Value] = [
        {
            "cameras": list(one.names),
            "distance_mm": one.relative.baseline_mm,
            "distance_sigma_mm": one.relative.baseline_sigma_mm,
            "frames": one.frames,
            "epipolar_px": one.epipolar_px,
        }
        for one in evidence.pairs
    ]
    return {
        "verdict": None if verdict is None else cast("dict[str, Value]", encode(Verdict, verdict)),
        "status": solved.status,
        "rig_file": str(folder / RIG_FILE),
        "rig_frame": solved.rig_frame or rig.names[max(0, solved.reference)],
        "frames": solved.observations.frame_count,
        "cameras": cameras,
        "pairs": pairs,
        "next_poses": [
            {"base_from_flange": one.base_from_flange.tolist(), "sentence": one.sentence} for one in found.next_poses
        ],
    }
