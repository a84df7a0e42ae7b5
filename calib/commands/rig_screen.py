"""A rig on a terminal and to programs; and what options of `calib rig` mean."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, cast

from calib.api.rig_result import RigResult
from calib.draw.checks import check_findings
from calib.observe.calibration_file import CAMERA_FILE
from calib.observe.rig_observations import require_names
from calib.records.rig_file import CAMERAS, RIG_FILE, folder_names
from calib.records.rig_folder import RigRun
from calib.renderer.quantities import parsed
from calib.rigs.halves import RigHalves
from calib.rigs.relative import center_sigma_mm
from calib.show.folder import PAGE_FILE
from calib.show.rig.tables import cameras_table, halves_table, pairs_table, ties_table
from calib.show.rig.words import next_steps, rig_facts, rig_headline
from calib.solver.plan import ALL
from calib.verdict.verdict import Verdict
from designer.base.codec import encode
from designer.base.errors import InputError
from designer.base.units import parse_quantity
from designer.base.words import shown
from designer.page.blocks import Finding, Table
from designer.page.terminal import say_facts, say_findings, say_headline, say_line, say_lines, say_table
from designer.page.terminal import shown as shown_path

if TYPE_CHECKING:
    from designer.base.answer import Value

S_PER_UNIT = {"s": 1.0, "ms": 1e-3, "us": 1e-6}
LONGEST_S = 3600.0
MOST_REMARKS = 8


def tolerance_of(text: str | None) -> float | None:
    """A time in seconds."""
    if text is None:
        return None
    return parsed("--tolerance", text, lambda one: parse_quantity(one, S_PER_UNIT, "a time such as 20ms", LONGEST_S))


def models_of(texts: Sequence[str] | None) -> str | dict[str, str]:
    """A model for all cameras, or by their names."""
    plain = [text for text in texts or () if "=" not in text]
    named = dict(_pair("--model", text, "left=fisheye") for text in texts or () if "=" in text)
    if len(plain) > 1 or (plain and named):
        raise InputError(f"--model {shown(plain[-1])}: give one for all cameras, or each its own as in left=fisheye")
    return named if named else plain[0] if plain else ALL


def lenses_of(texts: Sequence[str] | None) -> dict[str, str]:
    """Files of cameras by the cameras' names."""
    pairs = [_pair("--camera", text, "left=left/camera.json") for text in texts or ()]
    if len(pairs) > 1:
        require_names([name for name, _ in pairs])
    return dict(pairs)


def refined_of(names: Sequence[str] | None) -> bool | tuple[str, ...]:
    """The cameras that are solved on; True: all."""
    return True if names and list(names) == [ALL] else tuple(names or ())


def _pair(option: str, text: str, example: str) -> tuple[str, str]:
    name, equals, value = text.partition("=")
    if not (equals and name and value):
        raise InputError(f"{option} {shown(text)}: needs a camera's name, as in {example}")
    return name, value


def say_rig(found: RigResult, *, verbose: bool) -> None:
    """The lead of the rig's page, and its table of cameras; with `verbose` its other tables."""
    told = found.told
    say_headline(rig_headline(told))
    say_facts(rig_facts(told))
    say_table(cameras_table(told))
    if verbose:
        for table in _more_tables(told):
            say_table(table)
    checks = found.verdict.checks
    worse = [
        finding
        for check, finding in zip(checks, check_findings(found.verdict), strict=True)
        if verbose or (check.grade not in ("good", "unknown") and check.name != found.verdict.leads_with)
    ]
    notes = found.remarks if verbose else found.remarks[:MOST_REMARKS]
    say_findings([*worse, *(Finding("note", "", remark) for remark in notes)])
    if len(notes) < len(found.remarks):
        say_line("", f"and {len(found.remarks) - len(notes)} more remarks; --verbose says them")
    say_lines("better", found.verdict.advice)


def _more_tables(told: RigRun) -> Iterator[Table]:
    evidence = told.evidence
    yield pairs_table(evidence.pairs)
    if evidence.ties:
        yield ties_table(told)
    if isinstance(evidence.halves, RigHalves):
        yield halves_table(evidence.halves)


def say_next(found: RigResult, folder: Path) -> tuple[str, ...]:
    """What to do with the rig; the command lines among it."""
    page = folder / PAGE_FILE
    is_bad = found.verdict.grade == "bad"
    steps = () if is_bad else tuple(f"{line}   # {purpose}" for line, purpose in next_steps(found.told, str(folder)))
    look = (f"open {shown_path(page)} in a browser",) if page.exists() else ()
    say_lines("next", (*look, *steps))
    return steps


def rig_answer(found: RigResult, folder: Path) -> "dict[str, Value]":
    """The rig as programs are told of it."""
    solved, rig, evidence = found.calibration, found.rig, found.told.evidence
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
        "verdict": cast("dict[str, Value]", encode(Verdict, found.verdict)),
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
