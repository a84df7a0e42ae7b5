"""What `calib convert` says of a camera."""

import shlex
from pathlib import Path
from typing import TYPE_CHECKING

from calib.commands.camera_argument import camera_answer, camera_line, refit_answer, refit_line
from designer.base.answer import Summary
from designer.base.words import printable
from designer.page.terminal import quoted

if TYPE_CHECKING:
    from calib.api.converting import Conversion


def tell_camera(done: "Conversion", name: str, out: Path) -> Summary:
    """Print what was read and written, what it cost, and answer with the same."""
    from calib.interop.choosing import LARGE_PX

    opened, held, target = done.opened, done.held, done.format
    print(f"read   {printable(name)}: {opened.format.title}, {camera_line(opened.read.camera)}")
    for remark in opened.read.remarks:
        print(f"       {remark}")
    for fitted, one in done.named_fits:
        print(refit_line(fitted, one))
    print(f"wrote  {printable(str(out))}: {target.title}, {camera_line(held.camera, held.called)}")
    if len(held.tried) > 1:
        others = ", ".join(f"{one.name} {fit.rms_px:.4f}" for one, fit in held.tried)
        print(f"chosen {held.lens.name}, the closest of (RMS in px) {others}; another with --lens")
    for loss in done.lost:
        print(f"lost   {loss}")
    if not done.fits:
        print("exact  no fit was needed")
    elif done.is_far:
        print(f"warning: the two cameras differ by more than {LARGE_PX:g} px somewhere; see where with calib diff")
    print(f"open   {target.opens_with.format(file=printable(str(out)), url=out.absolute().as_uri())}")
    return Summary(
        {
            "read": {"file": name, "format": opened.format.name, **camera_answer(opened.read.camera)},
            "written": {"file": str(out), "format": target.name, "lens": held.lens.name, **camera_answer(held.camera)},
            "is_exact": not done.fits,
            "rms_px": done.rms_px,
            "max_px": done.max_px,
            "fits": [refit_answer(one) for one in done.fits],
            "tried": [{"lens": one.name, **refit_answer(fit)} for one, fit in held.tried],
            "lost": done.lost,
        },
        (out,),
        (f"calib diff {shlex.quote(printable(name))} {quoted(out)}",) if done.is_far else (),
        opened.read.remarks,
    )
