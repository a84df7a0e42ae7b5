"""`calib study bootstrap --rig`: how far samples of a rig's frames scatter."""

from pathlib import Path

from calib.commands.folder_page import say_next, with_page
from designer.base.answer import Summary
from designer.page.progress import progress_bars

SAMPLES = 200
"""Each is a rig that is solved."""


def bootstrap_of_rig(rig: Path, samples: int, seed: int, out: Path) -> Summary:
    """Draw and solve, write the study with its page, and say it."""
    from calib.api.bootstrapping_rigs import check_rig_bootstrap_folder, rig_bootstrap
    from calib.show.studies.rig_bootstrap_page import facts_of, findings_of, headline_of, pairs_table
    from calib.studies.rig_bootstrap_record import RIG_BOOTSTRAP
    from designer.page.blocks import Facts
    from designer.page.terminal import say_facts, say_findings, say_headline, say_table, say_written

    check_rig_bootstrap_folder(out)
    with progress_bars() as progress:
        found = rig_bootstrap(rig, samples=samples, seed=seed, progress=progress)
        files = found.save(out)
    say_headline(headline_of(found.study))
    say_facts(Facts(facts_of(found.study)))
    say_findings(findings_of(found.study))
    say_table(pairs_table(found.study))
    say_written(out, files)
    answer = RIG_BOOTSTRAP.document(found.study)
    return say_next(with_page(Summary(answer, files, remarks=found.study.remarks), out, "rig_bootstrap"), out)
