"""What `calib convert` says of a rig."""

import shlex
from pathlib import Path
from typing import TYPE_CHECKING

from calib.commands.camera_argument import camera_answer, camera_line, refit_answer, refit_line
from designer.base.answer import Summary
from designer.base.words import printable
from designer.page.terminal import quoted

if TYPE_CHECKING:
    from calib.api.converting_rigs import RigConversion


def tell_rig(done: "RigConversion", name: str, out: Path) -> Summary:
    """Print what was read and written, what it cost, and answer with the same."""
    from calib.interop.choosing import LARGE_PX

    found, target = done.opened.read, done.format
    print(f"read   {printable(name)}: {done.opened.format.title}, {len(found.rig.names)} cameras")
    for remark in found.remarks:
        print(f"       {printable(remark)}")
    for camera, fitted, fit in done.named_fits:
        print(f"{printable(camera)}: {refit_line(fitted, fit)}")
    places = done.places(out)
    print(f"wrote  {printable(str(out))}: {target.title}, lengths in {done.unit}")
    for camera, held in zip(found.rig.names, done.held, strict=True):
        print(f"       {printable(camera)}: {camera_line(held.camera, held.called)}")
    if target.is_folder:
        print(f"files  {', '.join(path.name for path in places)}")
    for loss in done.lost:
        print(f"lost   {printable(loss)}")
    if not done.named_fits:
        print("exact  no fit was needed")
    elif done.is_far:
        print(
            f"warning: a camera differs by more than {LARGE_PX:g} px somewhere; see calib diff, and --lens for another"
        )
    print(f"open   {target.opens_with.format(file=printable(str(out)))}")
    return Summary(
        {
            "read": {
                "file": name,
                "format": done.opened.format.name,
                "cameras": [
                    {"name": camera, **camera_answer(one)}
                    for camera, one in zip(found.rig.names, found.rig.cameras, strict=True)
                ],
            },
            "written": {
                "file": str(out),
                "format": target.name,
                "unit": done.unit,
                "cameras": [
                    {"name": camera, "lens": held.lens.name, **camera_answer(held.camera)}
                    for camera, held in zip(found.rig.names, done.held, strict=True)
                ],
            },
            "is_exact": not done.named_fits,
            "rms_px": done.rms_px,
            "max_px": done.max_px,
            "fits": [{"camera": camera, **refit_answer(fit)} for camera, _, fit in done.named_fits],
            "lost": done.lost,
        },
        places,
        (f"calib diff {shlex.quote(printable(name))} {quoted(out)}",) if done.is_far and done.can_be_compared else (),
        found.remarks,
    )
