"""A camera as a file of another tool."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, overload

from calib.app.inputs import Place, opened_camera, opened_rig, rig_named
from calib.cameras import fitted_models, parameter_names
from calib.cameras.camera import Camera
from calib.cameras.refit import FOCAL_AND_CENTRE, Refit
from calib.cameras.rig import Rig
from calib.interop.choosing import ACCEPTED_PX, LARGE_PX
from calib.interop.format import CameraFormat
from calib.interop.holding import Held, fit_to_format
from calib.interop.losses import lost_of
from calib.interop.reading import OpenedCamera, find_format
from calib.interop.rigs.reading import OpenedRig
from designer.base.errors import InputError
from designer.base.files import write_files
from designer.base.own_files import require_ours, signed
from designer.base.small_file import place_of
from designer.base.words import several, shown

if TYPE_CHECKING:
    from calib.api.converting_rigs import RigConversion


@dataclass(frozen=True, eq=False)
class Conversion:
    """A camera as another tool's file has it: `converted.text`, `converted.max_px`, `converted.save("camera.yaml")`."""

    opened: OpenedCamera  # as it was
    held: Held  # as the file holds it, and by which of the format's lenses
    format: CameraFormat  # of the file

    @property
    def camera(self) -> Camera:
        """The camera as the file holds it."""
        return self.held.camera

    @property
    def fits(self) -> tuple[Refit, ...]:
        """What it took, of reading and of writing; none: it is exact."""
        return tuple(one for _, one in self.named_fits)

    @property
    def named_fits(self) -> tuple[tuple[str, Refit], ...]:
        """What was fitted, with its fit, of reading and of writing; none: it is exact."""
        names = self.opened.read.camera.model, self.held.fitted
        both = zip(names, (self.opened.read.refit, self.held.refit), strict=True)
        return tuple((name, one) for name, one in both if one is not None)

    @property
    def text(self) -> str:
        """What the file holds."""
        return self.format.write(self.camera, self.held.lens)

    @property
    def max_px(self) -> float:
        """The largest difference anywhere in the image that a fit left; 0: exact."""
        return max((one.max_px for one in self.fits), default=0.0)

    @property
    def rms_px(self) -> float:
        """The root mean square difference likewise."""
        return max((one.rms_px for one in self.fits), default=0.0)

    @property
    def is_far(self) -> bool:
        """Whether the difference is worth a warning."""
        return self.max_px > LARGE_PX

    @property
    def remarks(self) -> tuple[str, ...]:
        """What there was to say of the file that was read, such as how a lens of no name was taken, a line each."""
        return self.opened.read.remarks

    @property
    def lost(self) -> tuple[str, ...]:
        """What the file does not say that the camera knew, a line each."""
        return lost_of(self.opened.read.camera, self.held, self.format)

    def save(self, path: Place) -> Path:
        """Write the file, signed as one of its kind, whatever its name; return its place.

        Raises:
            InputError: a folder, the file that was read, or somebody else's.
        """
        place = place_of(path, "a file to write")
        check_converted(place, self.format, self.opened)
        write_files({place: signed(self.format.file_name, self.text.encode(), self.format.name)})
        return place


@overload
def convert(
    camera: Camera, to: str, *, source: str | None = None, model: str | None = None, lens: str | None = None,
    without: Iterable[str] = (), cameras: Iterable[str] = (), unit: str | None = None, source_unit: str | None = None,
    accept_px: float | None = None, out: Place | None = None,
) -> Conversion: ...  # fmt: skip
@overload
def convert(
    camera: Rig, to: str, *, source: str | None = None, model: str | None = None, lens: str | None = None,
    without: Iterable[str] = (), cameras: Iterable[str] = (), unit: str | None = None, source_unit: str | None = None,
    accept_px: float | None = None, out: Place | None = None,
) -> "RigConversion": ...  # fmt: skip
@overload
def convert(
    camera: Place, to: str, *, source: str | None = None, model: str | None = None, lens: str | None = None,
    without: Iterable[str] = (), cameras: Iterable[str] = (), unit: str | None = None, source_unit: str | None = None,
    accept_px: float | None = None, out: Place | None = None,
) -> "Conversion | RigConversion": ...  # fmt: skip
def convert(
    camera: Camera | Rig | Place,
    to: str,
    *,
    source: str | None = None,
    model: str | None = None,
    lens: str | None = None,
    without: Iterable[str] = (),
    cameras: Iterable[str] = (),
    unit: str | None = None,
    source_unit: str | None = None,
    accept_px: float | None = None,
    out: Place | None = None,
) -> "Conversion | RigConversion":
    """Express a camera as a file of another tool does: `convert("camera.json", "opencv").save("camera.yaml")`.

    It is written by the camera's own lens where the format has it. Else the format's lenses of the same family, with a
    focal plane or wide, are fitted over the whole image, the closest is written, and the residual is told in pixels.
    Likewise a rig: `convert("rig.json", "kalibr").save("camchain.yaml")`.

    Args:
        camera: a camera or a rig, a file of any kind, a folder with one, or a template.
        to: the kind of file.
        source: the kind of the file to read; None: found out.
        model: the camera model to write; None: what the file can hold.
        lens: one of the format's lenses, by the format's own name, such as `ds-none`; None: chosen as told above.
        without: lens parameters to leave out, such as `k3`.
        cameras: of a rig, those to write, in this order; (): all.
        unit: of lengths in a rig's files, "mm" or "m", where their tool takes any; None: the usual one.
        source_unit: likewise of the files to read; None: as they say, or as usual.
        accept_px: how far the file's lens may be off, anywhere in the image; None: .1 px, or as far as it is where a
            model, a lens, or a parameter to leave out was asked for.
        out: where it is to go, refused before any work is done if it cannot; `save` writes it.

    Raises:
        InputError: a file that cannot be read, a format, model, lens or parameter that is none, a camera that sees
            more than the format's lenses can, or a fit that is off by more than is accepted.
    """
    zero = _lens_parameters(several("--without", without))
    place = None if out is None else place_of(out, "a file to write")
    accepted_px = _accepted_px(accept_px, is_asked=bool(model or lens or zero))

    def of_rig(rig: OpenedRig, name: str) -> "RigConversion":
        from calib.api.converting_rigs import convert_rig

        return convert_rig(
            rig, to, name=name, cameras=cameras, unit=unit, model=model, lens=lens, zero=zero, accept_px=accepted_px,
            out=place,
        )  # fmt: skip

    if isinstance(camera, Rig):
        return of_rig(opened_rig(camera), "the rig")
    rig = None if isinstance(camera, Camera) else rig_named(camera, source, source_unit)
    if rig is not None:
        return of_rig(rig, str(camera))
    for option, value in (("--cameras", several("--cameras", cameras)), ("--unit", unit), ("--from-unit", source_unit)):
        if value:
            raise InputError(f"{option}: is for rigs, and this is one camera; leave it out")
    target = find_format(to)
    opened = opened_camera(camera, source)
    if place is not None:
        check_converted(place, target, opened)
    try:
        held = fit_to_format(opened.read.camera, target, model, zero, lens, accepted_px)
    except InputError as error:
        name = "the camera" if isinstance(camera, Camera) else str(camera)
        raise InputError(f"{name}: {error}") from None
    return Conversion(opened, held, target)


def check_converted(out: Path, target: CameraFormat, source: OpenedCamera) -> None:
    """Refuse a place that is a folder, the input, or somebody else's.

    Raises:
        InputError: the message names it.
    """
    if out.is_dir():
        raise InputError(f"{out}: is a folder; name the file with -o, such as {out / target.file_name}")
    if source.is_file(out):
        raise InputError(f"{out}: is the file to read; choose another name with -o")
    require_ours(out)


def _accepted_px(asked_px: float | None, *, is_asked: bool) -> float:
    """How far a fit may be off; what somebody asked for by name is theirs to judge.

    Raises:
        InputError: no number of pixels.
    """
    if asked_px is None:
        return math.inf if is_asked else ACCEPTED_PX
    if isinstance(asked_px, bool) or not isinstance(asked_px, int | float) or not asked_px >= 0:
        raise InputError(f"--accept {shown(asked_px)}: must be a number of pixels, 0 or more")
    return float(asked_px)


def _lens_parameters(names: tuple[str, ...]) -> tuple[str, ...]:
    """Names of lens parameters, checked."""
    if not names:
        return ()
    known = sorted({name for model in fitted_models() for name in parameter_names(model)[FOCAL_AND_CENTRE:]})
    for name in names:
        if name not in known:
            raise InputError(f"--without {shown(name)}: no lens parameter; there are {', '.join(known)}")
    return names
