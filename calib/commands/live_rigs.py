"""The command `calib live` of several cameras."""

from collections.abc import Callable, Sequence
from pathlib import Path

from calib.api.rig_result import RigWriter
from calib.capture.live_rig import live_rig
from calib.commands.live_said import line_to_show, said, stopped_live
from calib.commands.rig import answers, said_rig
from designer.base.answer import Summary


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
    writer = RigWriter(folder)
    with answers("rig"):
        try:
            found = live_rig(
                target, writer, cameras=cameras, watch=watch, size=size, resume=resume, model=model, criteria=criteria,
                made=made, port=port, opened=opened, heard=said, command=line_to_show(),
            )  # fmt: skip
        except KeyboardInterrupt:
            stopped_live(Summary({}, tuple(writer.files)))
    return said_rig(found, writer, remark="", verbose=False)
