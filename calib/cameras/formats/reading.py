"""Camera files of any kind that is known, found out by their content."""

import os
from dataclasses import dataclass
from pathlib import Path

from calib.cameras import parameter_names
from calib.cameras.camera import Camera, camera_or_preset
from calib.cameras.formats import FORMATS, OWN
from calib.cameras.formats.format import MAX_FILE_BYTES, CameraFormat, ReadCamera
from calib.cameras.formats.parsing import outline, pick
from calib.cameras.formats.rigs.format import RigFormat
from calib.cameras.formats.rigs.reading import largest_bytes, open_rig, recognise_rig
from calib.cameras.refit import FOCAL_AND_CENTRE
from designer.base.errors import InputError
from designer.base.files import parse_json, read_small, read_small_text, read_spec_file
from designer.base.words import shown, suggestion
from designer.kinds.presets import preset_names

HEAD = 2**16
"""Characters from which a file's kind is told."""


BINARY = ".bin"
"""COLMAP's files that are no text end so."""


@dataclass(frozen=True, eq=False)
class OpenedCamera:
    """A camera with the kind of file it came from."""

    format: CameraFormat
    read: ReadCamera
    path: Path | None = None  # of the file it was read from; None: a template

    def is_file(self, place: Path) -> bool:
        """Whether a place is the very file the camera was read from."""
        try:
            return self.path is not None and place.samefile(self.path)
        except OSError:
            return False


def open_camera(name: str, format_name: str | None = None) -> OpenedCamera:
    """The camera of a file, of a template, or of one of a file's several cameras, named as in `FILE#NAME`.

    A folder stands for its `camera.json`. The format is found out if it is not given.

    Raises:
        InputError: no such file, of no known kind, or not valid; the message names it.
    """
    known = None if format_name is None else find_format(format_name)
    if format_name in (None, OWN) and (name in preset_names("cameras") or _is_ours_alone(Path(name))):
        own = Path(name) if name not in preset_names("cameras") else None
        camera = camera_or_preset(name)
        return OpenedCamera(FORMATS[OWN], ReadCamera(camera, remarks=_taken_as_none(camera, own)), own)
    path, wanted = _split(name)
    if path.is_dir():
        path = _camera_in(path)
    largest = max(largest_bytes(), FORMATS[OWN].max_bytes, MAX_FILE_BYTES) if known is None else known.max_bytes
    if path.suffix.lower() == BINARY and format_name in (None, "colmap"):
        from calib.cameras.formats.colmap import text_of

        text = text_of(read_small(path, FORMATS["colmap"].max_bytes, "a camera file"), str(path))
    else:
        text = read_small_text(path, largest, "a camera file")
    kind = known or recognise(text)
    rig_kind = None if known is not None or (kind is not None and kind.holds_many) else recognise_rig(text)
    if rig_kind is not None:
        return _camera_of_rig(path, rig_kind, wanted)
    if kind is None:
        if text.lstrip()[:1] == "{":
            parse_json(text, path, "a camera file")  # which says what is wrong with it, if it is no JSON
        raise InputError(f"{path}: {_why_unknown(text)}; if you know, say --from {'|'.join(FORMATS)}")
    if len(text) > kind.max_bytes:
        raise InputError(f"{path}: more than {kind.max_bytes} bytes; {kind.title} is smaller")
    if wanted is not None and not kind.holds_many:
        raise InputError(f"{path}: {kind.title} holds one camera; leave out {shown('#' + wanted)}")
    return OpenedCamera(kind, kind.read(text, str(path), wanted), path)


def _taken_as_none(camera: Camera, path: Path | None) -> tuple[str, ...]:
    """Which numbers of its lens a TOML file lacks, which may be cut off; one that has none of them means none."""
    given = {} if path is None else read_spec_file(path).get("parameters")
    names = parameter_names(camera.model)[FOCAL_AND_CENTRE:]
    missing = [name for name in names if isinstance(given, dict) and name not in given]
    if not missing or len(missing) == len(names):
        return ()
    return (f"of the lens's {len(names)} numbers the file lacks {' '.join(missing)}: taken as of a lens without",)


def _camera_of_rig(path: Path, kind: RigFormat, wanted: str | None) -> OpenedCamera:
    """One of the cameras of a rig's file; where it stands is left behind."""
    found = open_rig(path, kind.name).read
    row = found.rig.names.index(pick({name: name for name in found.rig.names}, wanted, str(path)))
    return OpenedCamera(FORMATS[OWN], ReadCamera(found.rig.cameras[row], found.refits[row]), path)


def _camera_in(folder: Path) -> Path:
    """The camera's file in a folder of results."""
    own = FORMATS[OWN].file_name
    inside = [] if (folder / own).exists() else sorted(folder.glob(f"*/{own}"))
    if inside:
        models = ", ".join(str(path.parent) for path in inside)
        raise InputError(f"{folder}: holds a camera in a folder of each model; name the folder of one: {models}")
    return folder / own


def _is_ours_alone(path: Path) -> bool:
    """Whether a name is that of a TOML file, or a template's misspelt."""
    return path.suffix.lower() == ".toml" or (not path.suffix and not path.parent.name and not path.exists())


def find_format(name: str) -> CameraFormat:
    """The format of that name."""
    if name not in FORMATS:
        hint = suggestion(name, list(FORMATS)) or f"; there are {', '.join(FORMATS)}"
        raise InputError(f"unknown camera format {shown(name)}{hint}")
    return FORMATS[name]


def recognise(text: str) -> CameraFormat | None:
    """The kind of file a text looks like, if it looks like any."""
    kinds = FORMATS.values()
    found = next((one for one in kinds if one.recognised.search(text[:HEAD])), None)
    if found is None and (names := outline(text)):
        found = next((one for one in kinds if one.recognised.search(names)), None)
    return found


def _split(name: str) -> tuple[Path, str | None]:
    """File and camera; a file may have the mark in its own name."""
    path, mark, camera = name.rpartition("#")
    if not mark or os.path.lexists(name):
        return Path(name), None
    return Path(path), camera


def _why_unknown(text: str) -> str:
    """What a file may be that is no camera file."""
    head = text[:HEAD]
    if "<opencv_storage>" in head:
        return "OpenCV's XML is not read; save it as .yaml"
    if '"ringsolid.' in head:
        return "no camera file; name the camera.json beside it"
    return "not a camera file of a known kind"
