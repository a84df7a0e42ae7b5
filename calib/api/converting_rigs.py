"""A rig as files of another tool."""

import math
import shlex
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from calib.app.inputs import Place
from calib.cameras.camera import Camera
from calib.cameras.refit import Refit
from calib.cameras.rig import Rig, keep_cameras
from calib.core.se3 import compose, make_pose
from calib.interop.choosing import LARGE_PX
from calib.interop.holding import Held, fit_to_format
from calib.interop.losses import lost_of
from calib.interop.rigs import OWN_RIG
from calib.interop.rigs.format import RigFormat, WrittenRig
from calib.interop.rigs.reading import OpenedRig, find_rig_format, require_unit
from designer.base.errors import InputError
from designer.base.files import check_folder, write_files
from designer.base.own_files import require_ours, signed
from designer.base.small_file import place_of
from designer.base.words import several, shown


@dataclass(frozen=True, eq=False)
class RigConversion:
    """A rig as another tool's files have it: `converted.texts`, `converted.save("camchain.yaml")`."""

    opened: OpenedRig  # as it was, of the cameras that are written
    held: tuple[Held, ...]  # (C,) each camera as a file holds it, and by which of the format's lenses
    format: RigFormat
    unit: str  # of lengths in the files

    @property
    def rig(self) -> Rig:
        """The rig as the files hold it: poses of cameras whose frames were turned turn with them."""
        rig = self.opened.read.rig
        cameras = tuple(one.camera for one in self.held)
        if cameras == rig.cameras:  # the very same: what is known of their numbers stays
            return rig
        turns = [np.eye(3) if one.refit is None else one.refit.new_from_old for one in self.held]
        poses = compose(np.stack([make_pose(turn, np.zeros(3)) for turn in turns]), rig.cam_from_rig)
        return replace(rig, cameras=cameras, cam_from_rig=poses, covariance=None)

    @property
    def texts(self) -> dict[str, str]:
        """What the files hold, by name; of a format of one file, one."""
        lenses = tuple(one.lens for one in self.held)
        return dict(self.format.write(WrittenRig(self.rig, lenses, self.unit, self.format.words(self.rig.names))))

    @property
    def named_fits(self) -> tuple[tuple[str, str, Refit], ...]:
        """Camera, what was fitted, and its fit, of reading and of writing; none: it is exact."""
        found = self.opened.read
        rows = zip(found.rig.names, found.rig.cameras, found.refits, self.held, strict=True)
        fits = [
            (name, what, fit)
            for name, camera, read, held in rows
            for what, fit in ((camera.model, read), (held.fitted, held.refit))
        ]
        return tuple((name, what, fit) for name, what, fit in fits if fit is not None)

    @property
    def max_px(self) -> float:
        """The largest difference anywhere in an image that a fit left; 0: exact."""
        return max((fit.max_px for _, _, fit in self.named_fits), default=0.0)

    @property
    def rms_px(self) -> float:
        """The largest root mean square difference of a camera likewise."""
        return max((fit.rms_px for _, _, fit in self.named_fits), default=0.0)

    @property
    def is_far(self) -> bool:
        """Whether the difference is worth a warning."""
        return self.max_px > LARGE_PX

    @property
    def can_be_compared(self) -> bool:
        """Whether the cameras are known by their names when the files are read again."""
        names = self.opened.read.rig.names
        return self.format.words(names) == names

    @property
    def remarks(self) -> tuple[str, ...]:
        """What there was to say of the files that were read, a line each."""
        return self.opened.read.remarks

    @property
    def lost(self) -> tuple[str, ...]:
        """What the files do not say that the rig knew, a line each."""
        rig, lost = self.opened.read.rig, []
        for name, camera, held in zip(rig.names, rig.cameras, self.held, strict=True):
            lost += [f"of {name}: {line}" for line in lost_of(camera, held, self.format.cameras)]
        kinds = {(camera.model, one.lens.is_wide) for camera, one in zip(rig.cameras, self.held, strict=True)}
        if len({model for model, _ in kinds}) < len(kinds):
            each = ", ".join(f"{name} {one.lens.name}" for name, one in zip(rig.names, self.held, strict=True))
            lost.append(f"that cameras are of one model, as they get lenses of two kinds: {each}")
        if self.format.name == OWN_RIG:
            is_gone = rig.covariance is not None and self.rig.covariance is None
            return (*lost, *(("how sure it all is",) if is_gone else ()))
        if rig.covariance is not None:
            lost.append("how sure it all is, which rig.json keeps")
        if rig.delay_s is not None:
            lost.append("the delays of the cameras' time stamps")
        if not self.format.keeps_frame and not np.array_equal(rig.cam_from_rig[0], np.eye(4)):
            whose = f" ({rig.rig_frame})" if rig.rig_frame and rig.rig_frame not in rig.names else ""
            lost.append(f"the rig's frame{whose}; the files' is that of camera {rig.names[0]}")
        written = self.format.words(rig.names)
        if written != rig.names:
            lost.append(f"the cameras' names; they are called {', '.join(written[:4])}{', ...' * (len(written) > 4)}")
        return tuple(lost)

    def places(self, out: Place) -> tuple[Path, ...]:
        """Where the files go: into the folder `out`, or to the file."""
        place = Path(out)
        return tuple(place / name for name in self.texts) if self.format.is_folder else (place,)

    def save(self, out: Place) -> Path:
        """Write the file, or the folder's files, signed as of their kind; return the place.

        Raises:
            InputError: a file where a folder has to be, or the other way round, a file that was read, or somebody
                else's.
        """
        place = place_of(out, "a file or a folder to write")
        check_converted_rig(place, self.format, self.opened)
        texts, sort = self.texts, f"{self.format.name}rig"
        files = {
            path: signed(name if self.format.is_folder else self.format.file_name, text.encode(), sort)
            for path, (name, text) in zip(self.places(place), texts.items(), strict=True)
        }
        for path in files:
            _require_not_read(path, self.opened)
        write_files(files)
        return place


def convert_rig(
    rig: OpenedRig,
    to: str,
    *,
    name: str,
    cameras: Iterable[str] = (),
    unit: str | None = None,
    model: str | None = None,
    lens: str | None = None,
    zero: Collection[str] = (),
    accept_px: float = math.inf,
    out: Path | None = None,
) -> RigConversion:
    """Express a rig as files of another tool do; see `calib.convert`, which calls it.

    Args:
        rig: as it was read.
        to: the kind of files.
        name: what messages call the rig.
        cameras: those to write, in this order; (): all.
        unit: of lengths in the files; None: the usual one.
        model: as for `calib.convert`, of each camera; so are the others.
        lens: likewise.
        zero: likewise, lens parameters to leave out.
        accept_px: likewise, of the worst camera.
        out: likewise.

    Raises:
        InputError: as `calib.convert`.
    """
    target = find_rig_format(to)
    opened = _of_cameras(rig, several("--cameras", cameras))
    require_unit(target, unit, "--unit")
    if out is not None:
        check_converted_rig(out, target, opened)
    names = opened.read.rig.names
    if not target.fewest <= len(names) <= target.most:
        wanted = target.fewest if target.fewest == target.most else f"{target.fewest} to {target.most}"
        hint = f"name them, as in {' '.join(f'--cameras {shlex.quote(one)}' for one in names[: target.most])}"
        raise InputError(f"{name}: {target.title} holds {wanted} cameras, the rig has {len(names)}; {hint}")
    try:
        each = zip(names, opened.read.rig.cameras, strict=True)
        held = tuple(_fitted(one, camera, target, model, zero, lens, accept_px) for one, camera in each)
    except InputError as error:
        raise InputError(f"{name}: {error}") from None
    return RigConversion(opened, held, target, unit or target.unit)


def _of_cameras(opened: OpenedRig, names: Sequence[str]) -> OpenedRig:
    """Those cameras of the rig, in that order; all if none are named."""
    if not names:
        return opened
    found = opened.read
    rows = [found.rig.row(name) for name in names]
    rig = keep_cameras(found.rig, rows)
    return replace(opened, read=replace(found, rig=rig, refits=tuple(found.refits[row] for row in rows)))


def _fitted(
    name: str,
    camera: Camera,
    target: RigFormat,
    model: str | None,
    zero: Collection[str],
    lens: str | None,
    accept_px: float,
) -> Held:
    try:
        return fit_to_format(camera, target.cameras, model, zero, lens, accept_px)
    except InputError as error:
        raise InputError(f"camera {shown(name)}: {error}") from None


def check_converted_rig(out: Path, target: RigFormat, source: OpenedRig) -> None:
    """Refuse a place that does not suit the format, or holds the input, or something of somebody else's.

    Raises:
        InputError: the message names it.
    """
    if target.is_folder:
        check_folder(out)
        return
    if out.is_dir():
        raise InputError(f"{out}: is a folder; name the file with -o, such as {out / target.file_name}")
    _require_not_read(out, source)
    require_ours(out)


def _require_not_read(place: Path, source: OpenedRig) -> None:
    if source.is_file(place):
        raise InputError(f"{place}: is a file to read; choose another place with -o")
