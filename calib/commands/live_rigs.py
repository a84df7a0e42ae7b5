"""The command `calib live` of several cameras."""

from collections.abc import Callable, Sequence
from pathlib import Path

from calib.capture.live_rig import live_rig
from calib.commands.live_said import line_to_show, said, stopped_live
from designer.base.answer import NegativeError, Summary
from designer.base.errors import NoAnswerError
from designer.page.capability import told
from designer.page.output import Output


def take_rig_photos(
    target: Path,
    folder: Path,
    *,
    cameras: Sequence[str],
    watch: Sequence[Path],
    size: tuple[int, int] | None,
    resume: bool,
    model: str,
    criteria: str,
    made: str | None,
    port: int,
    opened: Callable[[str], None],
) -> Summary:
    """Take photos with several cameras at once, and say what came of the rig; arguments as of `calib.live_rig`."""
    output = Output(folder, folder)
    try:
        found = live_rig(
            target, output, cameras=cameras, watch=watch, size=size, resume=resume, model=model, criteria=criteria,
            made=made, port=port, opened=opened, heard=said, command=line_to_show(),
        )  # fmt: skip
    except KeyboardInterrupt:
        stopped_live(Summary({}, tuple(output.files)))
    except NoAnswerError as error:
        raise NegativeError(f"no rig: {error}", Summary(output.answer, remarks=(str(error),))) from None
    return told(found, output, "", verbose=False, has_page=False)
