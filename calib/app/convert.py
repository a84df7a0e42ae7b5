"""A camera or a rig as files of another tool: `calib convert`, `calib.convert("camera.json", "opencv")`."""

import math
import re
import shlex
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

from calib.app.cameras_told import numbers_of, refit_numbers
from calib.cameras import fitted_models, parameter_names
from calib.cameras.formats import ACCEPTED_PX, FORMATS, ONLY_READ, ONLY_WRITTEN, RIG_FORMATS, WRITTEN_FORMATS
from designer.base.codec import encode_written
from designer.base.errors import InputError
from designer.base.files import JsonValue, check_folder, place_of, write_files
from designer.base.options import argument, option
from designer.base.own_files import require_ours, signed
from designer.base.words import several, shown
from designer.kinds.presets import camera_templates, one_of
from designer.page.capability import capability, written_to
from designer.page.output import Output, asked_output
from designer.page.result import Result

if TYPE_CHECKING:
    from calib.app.inputs import Place
    from calib.cameras.camera import Camera
    from calib.cameras.formats.format import CameraFormat
    from calib.cameras.formats.holding import Held
    from calib.cameras.formats.reading import OpenedCamera, OpenedRig
    from calib.cameras.formats.rig_format import RigFormat
    from calib.cameras.refit import Refit
    from calib.cameras.rig import Rig
    from designer.page.blocks import Page

ALL_FORMATS = tuple(dict.fromkeys([*FORMATS, *RIG_FORMATS]))
ALL_WRITTEN, ALL_READ = (*ALL_FORMATS, *ONLY_WRITTEN), (*ALL_FORMATS, *ONLY_READ)


@dataclass(frozen=True, eq=False)
class Conversion(Result, kind="conversion", title="Conversion", doing="fitting lenses", is_written=False):
    """A camera, or a rig, as another tool's files have it: `converted.texts`, `converted.save("camera.yaml")`."""

    named: str  # what was converted, as it was given
    place: Path | None  # of the file, or of the folder; None: it is not known yet
    opened: "OpenedCamera | OpenedRig"  # as it was; of a rig, the cameras that are written
    held: "tuple[Held, ...]"  # (C,) each camera as a file holds it, and by which of the format's lenses
    format: "CameraFormat | RigFormat"
    unit: str  # of lengths in a rig's files; "": one camera has none
    remarks: tuple[str, ...]  # on the files that were read, such as how a lens of no name was taken

    @property
    def camera(self) -> "Camera":
        """The camera as the file holds it; of a rig, the first."""
        return self.held[0].camera

    @property
    def rig(self) -> "Rig":
        """The rig as the files hold it: poses of cameras whose frames were turned turn with them.

        Raises:
            InputError: it is one camera.
        """
        from calib.cameras.formats.holding import rig_as_held
        from calib.cameras.formats.reading import OpenedRig

        if not isinstance(self.opened, OpenedRig):
            raise InputError("one camera is no rig: take camera")
        return rig_as_held(self.opened.read.rig, self.held)

    @property
    def each(self) -> "tuple[tuple[str, Camera, Refit | None, Held], ...]":
        """Name, camera as it was read, what that took, and camera as it is held; a camera alone has no name."""
        from calib.cameras.formats.reading import OpenedRig

        if not isinstance(self.opened, OpenedRig):
            return (("", self.opened.read.camera, self.opened.read.refit, self.held[0]),)
        found = self.opened.read
        return tuple(zip(found.rig.names, found.rig.cameras, found.refits, self.held, strict=True))

    @property
    def texts(self) -> dict[str, str]:
        """What the files hold, by name; of a format of one file, one.

        Raises:
            InputError: the format is no text.
        """
        from calib.cameras.formats.format import CameraFormat
        from calib.cameras.formats.rig_format import WrittenRig

        if isinstance(self.format, CameraFormat):
            if self.format.files is not None:
                raise InputError(f"{self.format.title} is no text: save it")
            return {self.format.file_name: self.format.write(self.camera, self.held[0].lens)}
        lenses, words = tuple(one.lens for one in self.held), self.format.words(self.rig.names)
        return dict(self.format.write(WrittenRig(self.rig, lenses, self.unit, words)))

    @property
    def text(self) -> str:
        """What the file holds, or the first of several."""
        return next(iter(self.texts.values()))

    @property
    def named_fits(self) -> "tuple[tuple[str, str, Refit], ...]":
        """Camera, what was fitted, and its fit, of reading and of writing; none: it is exact."""
        fits = [
            (name, what, fit)
            for name, camera, read, held in self.each
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
        from calib.cameras.formats.holding import LARGE_PX

        return self.max_px > LARGE_PX

    @property
    def lost(self) -> tuple[str, ...]:
        """What the files do not say that the camera or the rig knew, a line each."""
        from calib.cameras.formats.format import CameraFormat
        from calib.cameras.formats.holding import lost_of, lost_of_rig
        from calib.cameras.formats.reading import OpenedRig

        if isinstance(self.opened, OpenedRig):
            return lost_of_rig(self.opened.read.rig, self.held, cast("RigFormat", self.format))
        return lost_of(self.opened.read.camera, self.held[0], cast(CameraFormat, self.format))

    def document(self) -> "dict[str, JsonValue]":
        """What was read, what is written, and what it cost."""
        is_rig, file = bool(self.unit), None if self.place is None else str(self.place)
        read = [{**_name("name", name), **encode_written(numbers_of(camera))} for name, camera, _, _ in self.each]
        written = [
            {**_name("name", name), "lens": held.lens.name, **encode_written(numbers_of(held.camera))}
            for name, _, _, held in self.each
        ]
        fits = [{**_name("camera", name), **encode_written(refit_numbers(fit))} for name, _, fit in self.named_fits]
        tried = [{"lens": lens.name, **encode_written(refit_numbers(fit))} for lens, fit in self.held[0].tried]
        return cast("dict[str, JsonValue]", {
            "read": {
                "file": self.named, "format": self.opened.format.name, **({"cameras": read} if is_rig else read[0])
            },
            "written": {
                "file": file, "format": self.format.name,
                **({"unit": self.unit, "cameras": written} if is_rig else written[0]),
            },
            "is_exact": not self.named_fits, "rms_px": self.rms_px, "max_px": self.max_px, "fits": fits,
            **({} if is_rig else {"tried": tried}), "lost": list(self.lost),
        })  # fmt: skip

    def page(self) -> "Page":
        """What was read and written, what it cost, and how the files are opened."""
        from calib.app.convert_page import conversion_page

        return conversion_page(self)

    def save(self, place: str | PathLike[str], *, command: str = "", has_page: bool = False) -> tuple[Path, ...]:
        """Write the file, or the folder's files, signed as of their kind, whatever their names; return them.

        Raises:
            InputError: a file where a folder has to be, or the other way round, a file that was read, or somebody
                else's.
        """
        from calib.cameras.formats.format import CameraFormat

        path = place_of(place, "a file or a folder to write")
        _check_out(path, self.format, self.opened)
        is_folder, sort = _is_folder(self.format), f"{self.format.name}{'rig' * bool(self.unit)}"
        if isinstance(self.format, CameraFormat) and self.format.files is not None:
            files = {
                path if name == self.format.file_name else path.parent / name: content
                for name, content in self.format.files(self.camera).items()
            }
        else:
            encode = (self.format if isinstance(self.format, CameraFormat) else self.format.cameras).encode
            files = {
                path / name if is_folder else path: signed(
                    name if is_folder else self.format.file_name, encode(text), sort
                )
                for name, text in self.texts.items()
            }
        for file in files:
            _require_not_read(file, self.opened)
            require_ours(file)
        write_files(files)
        return tuple(files)


def _refuse_of_file(**options: str | None) -> None:
    """Refuse what says how a file is read, where there is none."""
    if odd := next((f"{name} {shown(value)}" for name, value in options.items() if value is not None), ""):
        raise InputError(f"{odd}: is of a file; leave it out")


@capability
def convert(
    camera: Annotated[
        "Camera | Rig | Place",
        argument(
            "file of a camera or a rig, of any of these kinds, a folder with one, or a camera template",
            complete=camera_templates,
        ),
    ],
    to: Annotated[
        str,
        option(
            f"kind of file to write: {'|'.join(WRITTEN_FORMATS)}; of a rig {'|'.join(RIG_FORMATS)}",
            metavar="FORMAT",
            complete=one_of(ALL_WRITTEN),
        ),
    ],
    *,
    source: Annotated[
        str | None,
        option(
            f"kind of file to read, of those that are written, or {'|'.join(ONLY_READ)} (default: found out)",
            flag="--from",
            metavar="FORMAT",
            complete=one_of(ALL_READ),
        ),
    ] = None,
    model: Annotated[
        str | None,
        option(
            f"camera model to write: {'|'.join(fitted_models())} (default: what the file can hold)",
            complete=one_of(fitted_models()),
        ),
    ] = None,
    lens: Annotated[
        str | None,
        option("lens of the file, by its own name for it, such as OPENCV (default: the closest)", metavar="LENS"),
    ] = None,
    without: Annotated[
        Iterable[str], option("lens parameter to leave out, such as k3", metavar="NAME", is_many=True)
    ] = (),
    accept_px: Annotated[
        float | None,
        option(
            "how far a lens that is fitted may be off anywhere in the image (default: 0.1px, of a lut 0.001px; where "
            "--model, --lens or --without is given, what that costs)",
            0,
            metavar="PIXELS",
        ),
    ] = None,
    cameras: Annotated[
        Iterable[str], option("of a rig, a camera to write, in this order (default: all)", metavar="NAME", is_many=True)
    ] = (),
    unit: Annotated[
        str | None, option("of lengths in a rig's files: mm, cm or m (default: as their tool has it)", metavar="UNIT")
    ] = None,
    source_unit: Annotated[
        str | None,
        option("likewise of a rig's files to read (default: as they say)", flag="--from-unit", metavar="UNIT"),
    ] = None,
    frame: Annotated[
        str | None,
        option("of a rig: name of the frame that its places are in, such as tool0 or base_link", metavar="NAME"),
    ] = None,
    out: Annotated[
        "Output | Place | None", written_to("file to write, or folder of several", metavar="FILE", is_needed=True)
    ] = None,
) -> Conversion:
    """Write a camera or a rig as files of another tool, or read its files: `convert("camera.json", "opencv")`.

    Of the file's lenses the camera's own is written, or the closest one of its family, with a focal plane or wide: it
    is fitted over the whole image, the residual is told in pixels, and refused above 0.1 px unless it is accepted; a
    file's lens that is none of ours likewise. Of a file with several cameras one is named as in chain.yaml#cam1;
    without a name they are a rig, if the file says where they stand.

    >>> calib.convert("camera.json", "opencv").save("camera.yaml")
    >>> calib.convert("rig.json", "kalibr", out="camchain.yaml").max_px

    Raises:
        InputError: a file that cannot be read, a format, model, lens or parameter that is none, a camera that sees
            more than the format's lenses can, or a fit that is off by more than is accepted.
    """
    from calib.cameras.camera import Camera
    from calib.cameras.formats.holding import fit_to_format
    from calib.cameras.formats.reading import OpenedRig, find_format, require_unit
    from calib.cameras.rig import Rig

    zero, names = _lens_parameters(several("--without", without)), several("--cameras", cameras)
    output, is_object = asked_output(out), isinstance(camera, Camera | Rig)
    if is_object:
        _refuse_of_file(source=source, source_unit=source_unit)
    called = ("the rig" if isinstance(camera, Rig) else "the camera") if is_object else fspath(cast("Place", camera))
    most_px = ACCEPTED_PX if accept_px is None or to in ONLY_WRITTEN else accept_px
    read = _opened(camera, to, source, source_unit, most_px)
    target: CameraFormat | RigFormat
    opened: OpenedCamera | OpenedRig
    rig = read if isinstance(read, OpenedRig) else None
    if isinstance(read, OpenedRig):
        if to in ONLY_WRITTEN:
            raise InputError(f"--to {to}: is of one camera; name it, as in {called}#{read.read.rig.names[0]}")
        target, opened = find_format(to, RIG_FORMATS, "rig"), _in_frame(_of_cameras(read, names), frame)
        require_unit(target, unit, "--unit")
        each, cameras_of = tuple(zip(opened.read.rig.names, opened.read.rig.cameras, strict=True)), target.cameras
    else:
        for flag, value in (("--cameras", names), ("--unit", unit), ("--from-unit", source_unit), ("--frame", frame)):
            if value:
                raise InputError(f"{flag}: is for rigs, and this is one camera; leave it out")
        cameras_of, opened = _camera_format(to, accept_px, is_chosen=bool(model or lens or zero)), read
        each, target = (("", opened.read.camera),), cameras_of
    # What somebody asked for by name is theirs to judge.
    accepted_px = (math.inf if model or lens or zero else cameras_of.accept_px) if accept_px is None else accept_px
    if output is not None:
        _check_out(output.place, target, opened)
    if rig is not None:
        _check_count(called, [name for name, _ in each], cast("RigFormat", target))
    held = []
    for name, one in each:
        try:
            held.append(fit_to_format(one, cameras_of, model, zero, lens, accepted_px))
        except InputError as error:
            raise InputError(f"{called}: {f'camera {shown(name)}: ' if name else ''}{error}") from None
    place = None if output is None else output.place
    used_unit = (unit or cast("RigFormat", target).unit) if rig is not None else ""
    made = Conversion(called, place, opened, tuple(held), target, used_unit, opened.read.remarks)
    if output is not None:
        output.files += made.save(output.place)
    return made


def _camera_format(to: str, accept_px: float | None, *, is_chosen: bool) -> "CameraFormat":
    """The format of that name, as accurate as is asked for where there is a choice."""
    from calib.cameras.formats.reading import find_format

    found = find_format(to, WRITTEN_FORMATS, "camera")
    if found.accurate_to is None:
        return found
    if is_chosen:
        raise InputError(f"--to {to}: has no lens and no parameters; leave out --model, --lens and --without")
    return found.accurate_to(accept_px)


def _opened(
    camera: "Camera | Rig | Place", to: str, source: str | None, source_unit: str | None, accept_px: float
) -> "OpenedCamera | OpenedRig":
    """What is read: one camera is a rig of one where a format holds rigs alone, and the other way round."""
    from calib.app.inputs import opened_camera, opened_rig, rig_named
    from calib.cameras.camera import Camera
    from calib.cameras.formats.reading import as_rig, only_camera
    from calib.cameras.rig import Rig

    if isinstance(camera, Rig):
        rig: OpenedRig | None = opened_rig(camera)
    else:
        rig = None if isinstance(camera, Camera) else rig_named(camera, source, source_unit, accept_px)
    if rig is None:
        one = opened_camera(cast("Camera | Place", camera), source, accept_px)
        return as_rig(one) if to in RIG_FORMATS and to not in FORMATS else one
    is_alone = (
        len(rig.read.rig.names) == 1 and to in WRITTEN_FORMATS and (to not in RIG_FORMATS or RIG_FORMATS[to].fewest > 1)
    )
    return only_camera(rig) if is_alone else rig


def _name(key: str, name: str) -> dict[str, str]:
    """Of a rig's camera."""
    return {key: name} if name else {}


def _is_folder(target: "CameraFormat | RigFormat") -> bool:
    """Whether a format has several files."""
    from calib.cameras.formats.rig_format import RigFormat

    return isinstance(target, RigFormat) and target.is_folder


def _check_count(called: str, names: Sequence[str], target: "RigFormat") -> None:
    """Refuse a rig of too few or too many cameras for the format."""
    if not target.fewest <= len(names) <= target.most:
        wanted = target.fewest if target.fewest == target.most else f"{target.fewest} to {target.most}"
        hint = f"name them, as in {' '.join(f'--cameras {shlex.quote(one)}' for one in names[: target.most])}"
        if len(names) == 1:
            hint = f"name it alone, as in FILE#{names[0]}"
        raise InputError(f"{called}: {target.title} holds {wanted} cameras, the rig has {len(names)}; {hint}")


def _of_cameras(opened: "OpenedRig", names: Sequence[str]) -> "OpenedRig":
    """Those cameras of the rig, in that order; all if none are named."""
    from calib.cameras.rig import keep_cameras

    if not names:
        return opened
    found = opened.read
    rows = [found.rig.row(name) for name in names]
    rig = keep_cameras(found.rig, rows)
    return replace(opened, read=replace(found, rig=rig, refits=tuple(found.refits[row] for row in rows)))


def _in_frame(opened: "OpenedRig", frame: str | None) -> "OpenedRig":
    """The rig with another name for its frame."""
    if frame is None:
        return opened
    if not re.fullmatch(r"[A-Za-z0-9_-]{1,100}", frame) or frame in opened.read.rig.names:
        raise InputError(f"--frame {shown(frame)}: must be 1 to 100 letters, digits, _ or -, and no camera's name")
    return replace(opened, read=replace(opened.read, rig=replace(opened.read.rig, rig_frame=frame)))


def _check_out(out: Path, target: "CameraFormat | RigFormat", source: "OpenedCamera | OpenedRig") -> None:
    """Refuse a place that does not suit the format, or holds the input, or something of somebody else's."""
    from calib.cameras.formats.format import CameraFormat
    from calib.cameras.formats.reading import BINARY
    from calib.images.bag import SUFFIXES

    told_by_ending = (*BINARY, ".toml", *SUFFIXES)
    if _is_folder(target):
        check_folder(out)
        return
    if out.is_dir():
        raise InputError(f"{out}: is a folder; name the file with -o, such as {out / target.file_name}")
    kind, ending = target if isinstance(target, CameraFormat) else target.cameras, out.suffix.lower()
    wanted = Path(target.file_name).suffix
    if ending != wanted and (kind.encode is not str.encode or ending in told_by_ending):
        by = f"{shown(ending)} means another kind of file" if ending in told_by_ending else "is told by its ending"
        raise InputError(f"{out}: {target.title}: {by}; name it {out.with_suffix(wanted).name}")
    _require_not_read(out, source)
    require_ours(out)


def _require_not_read(place: Path, source: "OpenedCamera | OpenedRig") -> None:
    if source.is_file(place):
        raise InputError(f"{place}: is a file to read; choose another name with -o")


def _lens_parameters(names: tuple[str, ...]) -> tuple[str, ...]:
    """Names of lens parameters, checked."""
    from calib.cameras.refit import FOCAL_AND_CENTRE

    known = sorted({name for model in fitted_models() for name in parameter_names(model)[FOCAL_AND_CENTRE:]})
    for name in names:
        if name not in known:
            raise InputError(f"--without {shown(name)}: no lens parameter; there are {', '.join(known)}")
    return names
