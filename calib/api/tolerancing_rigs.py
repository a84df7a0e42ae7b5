"""What manufacturing errors of a target cost a rig: what `design tolerance --rig` does."""

from collections.abc import Sequence
from dataclasses import dataclass
from os import fspath
from pathlib import Path

import numpy as np

from calib.api.page_shown import ShownAsPage
from calib.api.rendering_rigs import held_before, simulated_rig
from calib.api.table_folder import check_table_folder, write_table
from calib.app.inputs import MAX_SEED, Place, target_of
from calib.cameras.rig import Rig
from calib.renderer.held_target import held_poses
from calib.renderer.poses import MAX_VIEWS
from calib.renderer.quantities import whole
from calib.renderer.rig_template import SimulatedRig
from calib.rigs.middle import middle_error
from calib.studies.tolerance.rig_costs import LENGTH_MM, SimulatedFrames, drawn_cost, predicted_costs
from calib.studies.tolerance.rig_record import RIG_TOLERANCE, RigToleranceStudy
from designer.base.answer import program
from designer.base.errors import InputError
from designer.base.words import cut, printable
from designer.page.progress import Progress, unheard
from designer.target import TargetGeometry
from designer.tolerance.error_file import error_model

MOST_DRAWS = 10_000


@dataclass(frozen=True, eq=False)
class RigToleranceResult(ShownAsPage):
    """What errors of a target cost a rig: `found.study.together.baseline_mm`, `found.save("tolerance")`.

    In a notebook the result shows its page.
    """

    study: RigToleranceStudy
    kind = "rig_tolerance"

    def save(self, folder: Place) -> tuple[Path, ...]:
        """Write `table.json`; return the files.

        Raises:
            InputError: the folder takes no files, or holds somebody else's.
        """
        return write_table(folder, RIG_TOLERANCE, self.study)


def check_rig_tolerance_folder(folder: Path) -> None:
    """Refuse a folder that takes no such study, before any work is done.

    Raises:
        InputError: the message names it.
    """
    check_table_folder(folder, RIG_TOLERANCE)


def rig_tolerance(
    target: TargetGeometry | Place,
    errors: str,
    rig: Rig | SimulatedRig | Place,
    *,
    changes: Sequence[str] = (),
    frames: int = 30,
    distance_mm: float | tuple[float, float] | None = None,
    draws: int = 20,
    seed: int = 1,
    progress: Progress = unheard,
) -> RigToleranceResult:
    """What errors of a target cost a rig: `rig_tolerance("ico.target.json", "fdm-dual", "stereo-pair")`.

    >>> found = calib.rig_tolerance("ico.target.json", "fdm-dual", "four-webcams")
    >>> found.study.together.baseline_mm, found.study.costs[0].name

    Frames of the target before the rig are simulated, and the rig is solved as if the target were as drawn. What each
    error then does is predicted from the Jacobians, and checked by prints that are drawn and solved.

    Args:
        target: a geometry, or its file.
        errors: an error template, or a TOML file.
        rig: a template's name, a TOML file, a `rig.json`, or a rig.
        changes: other sizes of single errors: `face_tilt=0.1deg`.
        frames: how many.
        distance_mm: from the camera that the target is held to, or nearest and farthest; None: the template's.
        draws: prints that are drawn as a check; 0: none.
        seed: of all that is random.
        progress: is told what is being done.

    Raises:
        InputError: files or options that break a rule, or frames that do not determine the rig.
    """
    geometry, made = target_of(target, "rings"), error_model(errors, changes)
    simulated = simulated_rig(rig)
    if len(simulated.rig.names) < 2:
        raise InputError("--rig: one camera is no rig; leave it out")
    held = held_before(simulated, distance_mm)
    count, seed = whole("--frames", frames, 1, MAX_VIEWS), whole("--seed", seed, 0, MAX_SEED)
    draws = whole("--draws", draws, 0, MOST_DRAWS)
    progress("setting up", 0, 0)
    rng = np.random.default_rng(seed)
    before = SimulatedFrames(simulated.rig, geometry, held_poses(simulated.rig, geometry, held, count, rng))
    found = before.solved(geometry, rng)
    *costs, together, noise = predicted_costs(found, geometry, made)
    middle = middle_error(found)
    drawn = None
    if draws:
        drawn = drawn_cost(
            before, None if middle is None else middle.point_mm, made, seed, draws,
            lambda done: progress("drawing prints", done, draws),
        )  # fmt: skip
    remarks = () if geometry.source == "nominal" else (
        f"the target file is a {geometry.source} one; its shape is taken as the drawing",
    )  # fmt: skip
    near, far = held.distance_mm
    study = RigToleranceStudy(
        program=program(),
        settings={
            "errors": printable(fspath(errors)), "set": " ".join(changes), "frames": str(count), "seed": str(seed),
            "distance": f"{near:g}..{far:g}mm",
        },
        target=_name_of(target), rig=printable(simulated.name), errors=f"{made.name}: {made.title}",
        cameras=tuple(map(printable, simulated.rig.names)), frames=found.observations.frame_count,
        sightings=sum(map(len, found.residual_px)), length_mm=LENGTH_MM,
        away_mm=float("nan") if middle is None else middle.away_mm, costs=tuple(costs), together=together, noise=noise,
        draws=draws, drawn=drawn, remarks=remarks,
    )  # fmt: skip
    return RigToleranceResult(study)


def _name_of(target: TargetGeometry | Place) -> str:
    """What a target is called."""
    if isinstance(target, TargetGeometry):
        return "target"
    return cut(printable(Path(target).name.removesuffix(".json").removesuffix(".target")))
