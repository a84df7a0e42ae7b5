"""A camera as a file of another tool."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calib.api.loading import Place, opened_camera
from calib.cameras import LINEAR, fitted_models, parameter_names
from calib.cameras.camera import Camera
from calib.cameras.refit import FOCAL_AND_CENTRE, Refit
from calib.core.files import write_files
from calib.interop.choosing import LARGE_PX
from calib.interop.format import CameraFormat
from calib.interop.holding import Held, fit_to_format
from calib.interop.reading import OpenedCamera, find_format
from designer.base.errors import InputError
from designer.base.own_files import require_ours, signed
from designer.base.small_file import place_of
from designer.base.words import several, shown


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
    def lost(self) -> tuple[str, ...]:
        """What the file does not say that the camera knew, a line each."""
        camera, lost = self.opened.read.camera, []
        values = dict(zip(parameter_names(camera.model), camera.params.tolist(), strict=True))
        lens = self.held.lens
        gone = [name for name in lens.cannot_hold if lens.model == camera.model and values.get(name)]
        if gone and self.held.refit is not None:
            others = "the others make up for what they can"
            lost.append(f"{' '.join(gone)}, for which {self.format.title} has no place; {others}")
        is_foreign = bool(lens.numbers) or lens.approximate is not None
        if camera.field_rad is not None and is_foreign:
            lost.append(
                f"where the image circle ends, {np.degrees(camera.field_rad) / 2:.1f} degrees off the axis; "
                "the file's lens goes on, untried"
            )
        if camera.learned is not None and (is_foreign or self.camera.learned is None):
            lost.append("where the map is known; the file's lens goes on to the edges of the image, untried")
        elif self.camera.model == LINEAR and np.any(camera.params[FOCAL_AND_CENTRE:]):
            lost.append("the lens's distortion")
        return tuple(lost)

    def save(self, path: Place) -> Path:
        """Write the file, signed as one of its kind, whatever its name; return its place.

        Raises:
            InputError: a folder, the file that was read, or somebody else's.
        """
        place = place_of(path, "a file to write")
        check_converted(place, self.format, self.opened)
        write_files({place: signed(self.format.file_name, self.text.encode(), self.format.name)})
        return place


def convert(
    camera: Camera | Place,
    to: str,
    *,
    source: str | None = None,
    model: str | None = None,
    lens: str | None = None,
    without: Iterable[str] = (),
    out: Place | None = None,
) -> Conversion:
    """Express a camera as a file of another tool does: `convert("camera.json", "opencv").save("camera.yaml")`.

    It is written by the camera's own lens where the format has it. Else the format's lenses that suit the field of view
    are fitted over the whole image, the closest is written, and the residual is told in pixels.

    Args:
        camera: a camera, a file of any kind, a folder with one, or a template.
        to: the kind of file.
        source: the kind of the file to read; None: found out.
        model: the camera model to write; None: what the file can hold.
        lens: one of the format's lenses, by the format's own name, such as `ds-none`; None: chosen as told above.
        without: lens parameters to leave out, such as `k3`.
        out: where it is to go, refused before any work is done if it cannot; `save` writes it.

    Raises:
        InputError: a file that cannot be read, a format, model, lens or parameter that is none, or a camera that sees
            more than the format's lenses can.
    """
    target = find_format(to)
    opened = opened_camera(camera, source)
    if out is not None:
        check_converted(place_of(out, "a file to write"), target, opened)
    zero = _lens_parameters(several("--without", without))
    try:
        held = fit_to_format(opened.read.camera, target, model, zero, lens)
    except InputError as error:
        name = "the camera" if isinstance(camera, Camera) else camera
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


def _lens_parameters(names: tuple[str, ...]) -> tuple[str, ...]:
    """Names of lens parameters, checked."""
    known = sorted({name for model in fitted_models() for name in parameter_names(model)[FOCAL_AND_CENTRE:]})
    for name in names:
        if name not in known:
            raise InputError(f"--without {shown(name)}: no lens parameter; there are {', '.join(known)}")
    return names
