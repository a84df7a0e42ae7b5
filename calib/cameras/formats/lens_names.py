"""Which lens a file names, under whatever key and by whatever name: `distortion_type: KANNALA_BRANDT`, `fisheye: true`.

Programs name the lens of one set of numbers by many keys and words (`also_called` of `calib.cameras.ABILITIES`). A key
that names one is obeyed, or the file is refused: k1 k2 k3 k4 of a fisheye read as k1 k2 p1 p2 are off by hundreds of
pixels.
"""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

from calib.cameras import ABILITIES, COMMON, LINEAR, WIDE
from calib.cameras.formats.parsing import shown_plain
from designer.base.errors import InputError

BROWN = (COMMON, "opencv8", "opencv12", "opencv14")
"""One lens, of which the number of coefficients tells how much of it is there."""
_KEY = re.compile(
    r"(?:camera|cam|dist|distort|distortion|lens|proj|projection|intrinsics?|calib|calibration|coeffs?)?"
    r"model(?:type|name|kind)?|(?:dist|distort|distortion|lens|proj|projection|intrinsics?)(?:type|kind)"
)
_LOOSE = ("model", "modelname", "lens", "type", "cameratype", "distortion", "projection")
"""Keys that may as well hold the name of a product, or of something else."""
_FISHEYE = re.compile(
    r"(?:is|use|has|opencv|cv|lens|camera|cam)*fisheye(?:model|lens|camera|cam|flag|distortion|type)?"
)
_NAME = re.compile(r"([A-Za-z][A-Za-z0-9_ -]{1,40})[\"']?\s*[:=]")
YES, NO = ("true", "yes", "on", "y"), ("false", "no", "off", "n")
NOTHING = ("", "null", "~", "unknown")
NO_LENS = ("none", "pinholenone", "undistorted", "nodistortion")
_FILLING = ("lensmodel", "distortion", "lens", "model", "camera", "calib", "cv", "cv2", "opencv")
LONGEST_LINE, DEEPEST = 2000, 30


@dataclass(frozen=True)
class NamedLens:
    """What a file says of its lens."""

    said: str  # by which key and word
    model: str | None  # of ours; None: only that it is no fisheye
    is_without: bool = False  # coefficients, by its name
    remarks: tuple[str, ...] = ()

    @property
    def is_brown(self) -> bool:
        """Whether it has Brown's distortion, or none."""
        return self.model is None or self.model in (*BROWN, LINEAR)

    @property
    def is_certain(self) -> bool:
        """Whether it tells how coefficients are meant: a pinhole may have any."""
        return self.model != LINEAR

    def agrees(self, other: "NamedLens | str") -> bool:
        """Whether both may be of one camera."""
        model = other if isinstance(other, str) else other.model
        if self.model is None or model is None:
            wide = [one for one in (self.model, model) if one is not None and ABILITIES[one].is_wide]
            return not wide
        if {self.model, model} <= {*BROWN, LINEAR}:
            return True
        return self.model == model or {self.model, model} == {LINEAR, WIDE}


def model_named(word: str) -> str | None:
    """The model that other programs call so: `KANNALA_BRANDT4`, `pinhole-equi`, `LENSMODEL_OPENCV8`."""
    words = re.findall(r"[a-z0-9]+", word.lower())
    for some in (words, [one for one in words if one not in _FILLING]):
        if "".join(some) in _TABLE:
            return _TABLE["".join(some)]
        each = {_TABLE.get(one) for one in some}
        if len(each) > 1:
            each -= {LINEAR}
        if len(each) == 1:
            return each.pop()
    return None


def _normal(word: str) -> str:
    return re.sub(r"[^a-z0-9]", "", word.lower())


_TABLE = {_normal(word): name for name, model in ABILITIES.items() for word in (name, *model.also_called.split())}


def names_lens(key: str) -> bool:
    """Whether a key of that name says which lens it is; of one of several cameras it may end in a number."""
    plain = _normal(key).rstrip("0123456789")
    return plain in _LOOSE or bool(_KEY.fullmatch(plain) or _FISHEYE.fullmatch(plain))


def mentions_lens(line: str) -> bool:
    """Whether a line of a file has such a key."""
    return len(line) < LONGEST_LINE and any(names_lens(one[1]) for one in _NAME.finditer(line.partition("#")[0]))


def named_lens(values: Mapping[str, object], origin: str) -> NamedLens | None:
    """The lens that keys of a mapping, or of mappings within, name; None: none does.

    Raises:
        InputError: a name that is not known, or two that contradict each other.
    """
    found: NamedLens | None = None
    remarks: list[str] = []
    for key, value in _named(values, set(), 0):
        one = _said(key, value, origin)
        if one is None:
            continue
        if one.remarks:
            remarks += one.remarks
        elif found is not None and not found.agrees(one):
            raise InputError(f"{origin}: {found.said}, but {one.said}; leave the one that is right")
        elif found is None or found.model in (None, LINEAR):
            found = one
    if found is None and not remarks:
        return None
    return replace(found or NamedLens("nothing", LINEAR), remarks=tuple(remarks))


def require_agreement(values: Mapping[str, object], model: str | None, origin: str, *known: str) -> None:
    """Refuse a file whose other keys than those known name another lens than the one that was read.

    Raises:
        InputError: they do.
    """
    said = named_lens({key: value for key, value in values.items() if key not in known}, origin)
    if said is not None and model is not None and not said.agrees(model):
        raise InputError(f"{origin}: {said.said}, but the lens is read as {model}; leave the one that is right")


def _named(value: object, seen: set[int], depth: int) -> Iterator[tuple[str, object]]:
    """Keys that name a lens, with what they hold, at any depth; a part that stands there twice, once."""
    if not isinstance(value, dict | list) or id(value) in seen or depth > DEEPEST:
        return
    seen.add(id(value))
    for key, one in value.items() if isinstance(value, dict) else (("", one) for one in value):
        if isinstance(one, dict | list):
            yield from _named(one, seen, depth + 1)
        elif isinstance(key, str) and names_lens(key):
            yield key, one


def _answer(word: str) -> bool | None:
    """Whether a word means yes; None: neither yes nor no."""
    if word.lower() in (*YES, *NO):
        return word.lower() in YES
    try:
        return float(word) != 0
    except ValueError:
        return None


def _said(key: str, value: object, origin: str) -> NamedLens | None:
    """What one key says, if it says anything."""
    word = " ".join(str(value).split()) if isinstance(value, str | int | float) else ""
    said = f"{key} is {shown_plain(value)}"
    if word.lower() in NOTHING:
        return None
    plain = _normal(key).rstrip("0123456789")
    if _FISHEYE.fullmatch(plain) and (is_so := _answer(word)) is not None:
        return NamedLens(said, WIDE if is_so else None)
    model = model_named(word)
    if model is not None:
        return NamedLens(said, model, _normal(word) in NO_LENS)
    if plain in _LOOSE and "fish" not in word.lower():
        return NamedLens(said, LINEAR, remarks=(f"{said}, which names no lens that is known, and is passed over",))
    raise InputError(
        f"{origin}: {key} {shown_plain(value)}: not supported; calibrate with plumb_bob or rational_polynomial or "
        f"equidistant, or take {key} out if it names no lens"
    )
