"""A rig from what its cameras saw: each lens chosen, all solved together, and judged."""

from dataclasses import dataclass, replace

from calib.core.types import RigObservations
from calib.judge.rig_folder import RigRun
from calib.judge.rig_judge import judge_rig
from calib.judge.rig_lenses import CameraWishes, choices_of
from calib.judge.verdict import Criteria
from calib.observe.calibration_file import Provenance
from calib.observe.rig_observations import with_remarks
from calib.observe.rig_search import RigSearch
from calib.rigs.accuracy import with_circle_doubt
from calib.rigs.bent import with_bend_error
from calib.rigs.halves import RigHalves, half_solver, rig_halves
from calib.rigs.problem import RigOptions
from calib.rigs.shared_errors import with_shared_errors
from calib.rigs.solve import solve_rig
from calib.rigs.target_error import with_target_error
from calib.solver.plane_bend import PlaneBend
from designer.base.answer import program
from designer.page.progress import Progress
from designer.target import TargetGeometry
from designer.tolerance.made import Made, how_made


@dataclass(frozen=True, eq=False)
class RigSeen:
    """What a rig is solved from, and what it was seen of."""

    observations: RigObservations
    target: TargetGeometry | None = None  # None: the points came from elsewhere
    search: RigSearch | None = None  # of the photos; None: solved from observations
    made: Made | None = None  # how the target was; None: nobody knows
    bend: PlaneBend | None = None  # by which the points were moved; None: they are as the target's file says

    def with_made(self, made: str | None) -> "RigSeen":
        """With how the target was made: as it is said, or as photos and build tell.

        Raises:
            InputError: no such way.
        """
        rendered_id = "" if self.search is None else self.search.rendered_id
        return replace(self, made=how_made(self.target, made, rendered_id=rendered_id))


def judged_rig(
    seen: RigSeen, wishes: CameraWishes, options: RigOptions, limits: Criteria, settings: tuple[tuple[str, str], ...],
    progress: Progress,
) -> tuple[RigRun, RigSeen]:  # fmt: skip
    """Solve a rig and judge it, whatever moves it or its target; what it was seen by, with a word on each lens.

    Raises:
        InputError: cameras that no frames tie together, or that cannot be solved.
    """
    choices, said = choices_of(seen.observations, wishes, progress)
    seen = replace(seen, observations=with_remarks(seen.observations, said))
    progress("solving", 0, 0)
    solved = solve_rig(seen.observations, choices, options)
    stated = with_circle_doubt(with_bend_error(with_target_error(solved, seen.made), seen.bend))
    found = with_shared_errors(stated)
    progress("judging", 0, 0)
    halves = rig_halves(found, half_solver(found, choices, options))
    if isinstance(halves, RigHalves) and halves.has_moved:  # which may look like anything that photos share
        found = replace(found, remarks=stated.remarks)
    origin = Provenance(
        program(), "" if seen.target is None else seen.target.layout_id, seen.observations.points.geometry_id,
        options=wishes.options, settings=settings,
    )  # fmt: skip
    return RigRun(found, origin, judge_rig(found, halves, limits), seen.target), seen
