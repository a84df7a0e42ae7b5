"""`design tolerance --rig`: what manufacturing errors cost a rig."""

from collections.abc import Sequence
from pathlib import Path

from calib.commands.folder_page import say_next, with_page
from designer.base.answer import Summary
from designer.page.progress import progress_bars

DRAWS = 20
"""Each is a rig that is solved."""


def tolerance_of_rig(
    target: Path, errors: str, rig: str, changes: Sequence[str], frames: int, distance: str | None, draws: int,
    seed: int, out: Path,
) -> Summary:  # fmt: skip
    """Find the costs, write them with their page, and say them."""
    from calib.api.tolerancing_rigs import check_rig_tolerance_folder, rig_tolerance
    from calib.app.inputs import DISTANCES_MM
    from calib.renderer.quantities import length_range
    from calib.show.studies.rig_tolerance_page import costs_table, facts_of, findings_of, headline_of
    from calib.studies.tolerance.rig_record import RIG_TOLERANCE
    from designer.page.blocks import Facts
    from designer.page.terminal import say_facts, say_findings, say_headline, say_table, say_written

    check_rig_tolerance_folder(out)
    with progress_bars() as progress:
        found = rig_tolerance(
            target, errors, rig, changes=changes, frames=frames, draws=draws, seed=seed, progress=progress,
            distance_mm=None if distance is None else length_range("--distance", distance, *DISTANCES_MM),
        )  # fmt: skip
        files = found.save(out)
    say_headline(headline_of(found.study))
    say_facts(Facts(facts_of(found.study)))
    say_findings(findings_of(found.study))
    say_table(costs_table(found.study))
    say_written(out, files)
    answer = RIG_TOLERANCE.document(found.study)
    return say_next(with_page(Summary(answer, files, remarks=found.study.remarks), out, "rig_tolerance"), out)
