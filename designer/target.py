"""The target geometry: what was (or is to be) printed, as the detector and the calibrator read it.

`NAME.target.json` holds it, as `target.schema.json` beside this file describes. Reading a written file gives back the
same numbers, bit for bit. This module needs numpy and the standard library only, because everything else imports it.
"""

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from os import PathLike
from typing import Literal, cast

import numpy as np
from numpy.typing import NDArray

from designer.base.arrays import Array, Flags, Rows
from designer.base.codes import CODES
from designer.base.errors import InputError
from designer.base.files import once_each, place_of, read_small_text
from designer.base.words import with_article
from designer.marks.face_marks import FaceMarks, are_alike, marks_from_mapping, marks_to_mapping
from designer.spec.build import BUILDS, Form, build_name
from designer.spec.kind import spec_from_mapping, spec_to_mapping
from designer.spec.spec import Spec

FORMAT = "ringsolid.target"
DIGESTED = bytes.fromhex("72696e67666f7267652e7461726765742031")
"""What a digest begins with, for good: the ids of all target files rest on these bytes."""
VERSION = 1
MAX_FILE_BYTES = 64 * 2**20
MAX_INDEX = 1_000_000
_DECIMALS, _FRAME_DECIMALS = 9, 12
"""Of coordinates and of frames that are worked out, so that processors that differ in the last bit agree on ids."""
PARALLEL = 1e-6
"""How far the cosine of the angle between the normals of opposite faces may be from -1."""

Source = Literal["nominal", "measured", "perturbed"]
Needs = Literal["points", "marks", "rings"]
SOURCES: tuple[Source, ...] = ("nominal", "measured", "perturbed")

_LAYOUT_FIELDS = ("ring_face", "ring_index", "is_dot", "face_code")
"""What the detector needs to name rings: the fields behind `layout_id`."""


# Type and shape of every array field: R features, F faces, K corners of a face.
_ARRAYS: Mapping[str, tuple[str, tuple[str | int, ...]]] = {
    "ring_face": ("int64", ("R",)),
    "ring_index": ("int64", ("R", 2)),
    "center_mm": ("float64", ("R", 3)),
    "radius_outer_mm": ("float64", ("R",)),
    "radius_inner_mm": ("float64", ("R",)),
    "is_dot": ("bool", ("R",)),
    "target_from_face": ("float64", ("F", 4, 4)),
    "outline_mm": ("float64", ("F", "K", 2)),
    "window_mm": ("float64", ("F", "K", 2)),
    "face_code": ("int64", ("F",)),
    "lattice_mm": ("float64", ("F", 2, 2)),
    "face_covariance": ("float64", ("F", 6, 6)),
    "mode_mm": ("float64", ("S", "R", 3)),
    "ring_piece": ("int64", ("R",)),
}
_OPTIONAL = ("face_covariance", "mode_mm", "ring_piece")
_UNTOLD = ("ring_piece",)
"""How it is made, which no id tells."""
_REQUIRED = tuple(name for name in _ARRAYS if name not in _OPTIONAL)


@dataclass(frozen=True, eq=False)
class TargetGeometry:
    """R features on F faces, in mm in the target frame: `target.center_mm`, `target.face_count`.

    Two are equal if their ids are.

    Arrays are copied, made C-contiguous and read-only.

    Raises:
        ValueError: an array of the wrong shape, a number that is not finite, an inner radius that is not below
            the outer one (but for points, which have none: all radii are 0), a face number out of range, two
            features with one index, or a frame that is no rigid motion.
    """

    source: Source
    spec: Spec | None  # None: made by others
    ring_face: Rows  # (R,)
    ring_index: Rows  # (R, 2) i, j in the face's lattice
    center_mm: Array  # (R, 3)
    radius_outer_mm: Array  # (R,)
    radius_inner_mm: Array  # (R,) 0 for dots
    is_dot: Flags  # (R,)
    target_from_face: Array  # (F, 4, 4) z: outward normal
    outline_mm: Array  # (F, K, 2) counter-clockwise, in the face frame
    window_mm: Array  # (F, K, 2) inner edge of the border; without a border: the outline
    face_code: Rows  # (F,) row of `CODES`; -1: no code
    lattice_mm: Array  # (F, 2, 2) rows: steps of i and of j in the face frame
    face_covariance: Array | None = None  # (F, 6, 6) rotation vector (rad), translation (mm)
    mode_mm: Array | None = None  # (S, R, 3) see `designer.tolerance.prior`: what else may be off
    ring_piece: Rows | None = None  # (R,) the piece of a board that each is on, from 0; no id tells it
    marks: tuple[FaceMarks, ...] | None = None  # (F,) of another maker's board; None: rings, dots, or points
    build: str | None = None  # how it is made, for information: no id tells it; None: not known
    has_lip: bool = False  # the same: its stickers lie in frames

    def __post_init__(self) -> None:
        if self.source not in SOURCES:
            raise ValueError(f"source is {self.source!r}; it must be one of {', '.join(SOURCES)}")
        if self.build is not None and self.build not in BUILDS:
            raise ValueError(f"build is {self.build!r}; it must be one of {', '.join(BUILDS)}")
        sizes: dict[str, int] = {}
        for name, (dtype, shape) in _ARRAYS.items():
            values = getattr(self, name)
            if values is None and name not in _REQUIRED:
                continue
            array = _frozen(name, values, dtype)
            _check_shape(name, array, shape, sizes)
            object.__setattr__(self, name, array)
        _check_rules(self)

    @property
    def words(self) -> str:
        """What it is, in a few words: "an icosahedron of edge 60 mm"."""
        if self.spec is not None:
            return with_article(self.spec.words)
        if self.marks is not None:
            kinds = list(dict.fromkeys(one.words for one in self.marks))
            each = with_article(kinds[0]) if len(kinds) == 1 else "marks of its own"
            return each if self.is_planar else f"a target of {self.face_count} faces, each with {each}"
        faces = "1 face" if self.is_planar else f"{self.face_count} faces"
        return f"a target of {faces} and {self.ring_count} rings"

    @property
    def ring_count(self) -> int:
        """How many features, dots included."""
        return len(self.ring_face)

    @property
    def point_names(self) -> list[str]:
        """What other tools call each feature: `f03-2-5`, its face and its place (i, j) in the face's lattice."""
        index = np.column_stack([self.ring_face, self.ring_index]).tolist()
        return [f"f{face:02d}-{i}-{j}" for face, i, j in index]

    @property
    def has_marks(self) -> bool:
        """Whether there are rings, dots or others' marks to draw and to detect; else the features are points."""
        return self.marks is not None or bool(self.radius_outer_mm.any())

    @property
    def face_count(self) -> int:
        """How many faces."""
        return len(self.target_from_face)

    @property
    def is_planar(self) -> bool:
        """Whether there is one face only, as of a board; else the faces look several ways, as those of a solid do."""
        return self.face_count == 1

    @property
    def form(self) -> Form:
        """What may be built of it: as its spec says; without one, a front, and perhaps a back, are a plate."""
        if self.spec is not None:
            return self.spec.form
        normal = self.target_from_face[:, :3, 2]
        has_back = self.face_count == 2 and bool(normal[0] @ normal[1] < PARALLEL - 1)
        return "plate" if self.is_planar or has_back else "solid"

    @property
    def is_plate(self) -> bool:
        """Whether it is flat, with one face or with a front and a back; else the faces bound a solid."""
        return self.form == "plate"

    @property
    def faces_up(self) -> bool:
        """Whether all that it shows, it shows to cameras in a cap around its z axis."""
        return self.form in ("plate", "trihedron")

    @property
    def has_back(self) -> bool:
        """Whether it is a plate with a front and a back."""
        return self.is_plate and not self.is_planar

    @property
    def shown_at_once(self) -> int:
        """How many faces a photo needs to fix where the target is, and can show: of a plate one, of a solid three."""
        return 1 if self.is_plate else min(3, self.face_count)

    @property
    def has_codes(self) -> bool:
        """Whether each face carries a code of dots that tells which it is."""
        return bool((self.face_code >= 0).all())

    @property
    def feature_word(self) -> str:
        """What is measured in photos, in the plural: rings, corners, circles, or several of these: marks."""
        if self.marks is None:
            return "rings"
        words = {"circles" if marks.radius_mm else "corners" for marks in self.marks}
        return words.pop() if len(words) == 1 else "marks"

    @cached_property
    def reach_mm(self) -> Array:
        """How far from a feature's centre its own edges reach; 0 of a point.  # (R,)"""
        if self.marks is None:
            return self.radius_outer_mm
        return np.array([marks.reach_mm for marks in self.marks])[self.ring_face]

    @cached_property
    def center_in_face_mm(self) -> Array:
        """The features' centres in their faces' frames; z is 0 on a flat face.  # (R, 3)"""
        frame = self.target_from_face[self.ring_face]
        in_face: Array = np.einsum("rji,rj->ri", frame[:, :3, :3], self.center_mm - frame[:, :3, 3])
        in_face.setflags(write=False)
        return in_face

    @cached_property
    def layout_id(self) -> str:
        """Names the layout: faces, indices, dots, codes and marks. Detections fit any target with the same one."""
        return _digest(self, _LAYOUT_FIELDS)

    @cached_property
    def geometry_id(self) -> str:
        """Names all numbers, the spec and the source."""
        return _digest(self, tuple(name for name in _present_arrays(self) if name not in _UNTOLD), full=True)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, TargetGeometry) and self.geometry_id == other.geometry_id

    def __hash__(self) -> int:
        return hash(self.geometry_id)


def _present_arrays(target: TargetGeometry) -> dict[str, NDArray[np.generic]]:
    """The array fields by name, without an optional one that is absent."""
    return {name: array for name in _ARRAYS if (array := getattr(target, name)) is not None}


def _frozen(name: str, values: object, dtype: str) -> NDArray[np.generic]:
    """`values` as a read-only array of `dtype`, without turning text or fractions into integers."""
    array = np.asarray(values)
    if array.dtype.kind not in {"float64": "fi", "int64": "iu", "bool": "b"}[dtype] and array.size:
        raise ValueError(f"{name} holds {array.dtype} values; it must hold {dtype}")
    if array.dtype.kind == "u" and array.size and array.max() > np.iinfo(np.int64).max:
        raise ValueError(f"{name} holds a number that is too large")
    array = np.array(array, dtype=dtype, order="C")
    if dtype == "float64":
        if not np.isfinite(array).all():
            raise ValueError(f"{name} holds a number that is not finite")
        array = array + 0.0  # no negative zeros: equal numbers must have equal ids
    array.setflags(write=False)
    return array


def _check_shape(name: str, array: NDArray[np.generic], shape: tuple[str | int, ...], sizes: dict[str, int]) -> None:
    """Hold an array to its declared shape; the first array with a letter fixes its size."""
    expected = tuple(sizes.get(n, -1) if isinstance(n, str) else n for n in shape)
    fits = array.ndim == len(shape) and all(e in (-1, n) for e, n in zip(expected, array.shape, strict=True))
    if not fits:
        wanted = " x ".join(str(sizes.get(n, n)) if isinstance(n, str) else str(n) for n in shape)
        raise ValueError(f"{name} has the shape {array.shape}; it must be {wanted}")
    sizes.update({letter: n for letter, n in zip(shape, array.shape, strict=True) if isinstance(letter, str)})


def _check_rules(target: TargetGeometry) -> None:
    """The rules that tie the arrays together; see `TargetGeometry`."""
    _check_marks(target)
    if not target.ring_count or not target.face_count:
        raise ValueError("the target has no rings or no faces")
    if target.outline_mm.shape[1] < 3:
        raise ValueError(f"outline_mm has {target.outline_mm.shape[1]} corners a face; it must have at least 3")
    if target.face_code.min() < -1 or target.face_code.max() >= len(CODES):
        raise ValueError(f"face_code must lie in 0..{len(CODES) - 1}, or be -1 for none")
    if target.ring_face.min() < 0 or target.ring_face.max() >= target.face_count:
        raise ValueError(f"ring_face must lie in 0..{target.face_count - 1}")
    if (piece := target.ring_piece) is not None and (
        not target.is_planar or sorted(set(piece.tolist())) != list(range(int(piece.max()) + 1))
    ):
        raise ValueError("ring_piece must number the pieces of a board with one face from 0 on, each with a ring")
    if np.abs(target.ring_index).max() > MAX_INDEX:
        raise ValueError(f"ring_index must lie in -{MAX_INDEX}..{MAX_INDEX}")
    keys = np.column_stack([target.ring_face, target.ring_index])
    if len(set(map(tuple, keys.tolist()))) != len(keys):
        raise ValueError("two features of one face have the same ring_index")
    inner, outer = target.radius_inner_mm, target.radius_outer_mm
    if outer.any() and not ((inner >= 0) & (inner < outer)).all():
        raise ValueError("radius_inner_mm must be at least 0 and less than radius_outer_mm")
    if not (inner[target.is_dot] == 0).all() or not (inner[~target.is_dot] > 0).all():
        raise ValueError("radius_inner_mm must be 0 for dots and above 0 for rings")
    rotation = target.target_from_face[:, :3, :3]
    if np.abs(rotation).max() > 2:
        raise ValueError("target_from_face must hold rigid motions: a rotation has entries from -1 to 1")
    off = np.abs(rotation @ rotation.transpose(0, 2, 1) - np.eye(3)).max()
    is_affine = (target.target_from_face[:, 3] == np.array([0.0, 0.0, 0.0, 1.0])).all()
    if off > 1e-6 or np.linalg.det(rotation).min() < 0 or not is_affine:
        raise ValueError("target_from_face must hold rigid motions (4 x 4, right-handed, last row 0 0 0 1)")


def _check_marks(target: TargetGeometry) -> None:
    """Features of faces with marks are those that the marks have, in their order."""
    if target.marks is None:
        return
    for one, other in combinations(target.marks, 2):
        if are_alike(one, other):
            remedy = "give them markers of different ids, or different numbers of marks"
            raise ValueError(f"two faces that photos cannot tell apart: {one.words}, and {other.words}; {remedy}")
    index = [marks.index for marks in target.marks]
    face = np.repeat(np.arange(len(index)), [len(rows) for rows in index])
    fits = len(index) == target.face_count and np.array_equal(target.ring_face, face)
    if not fits or not np.array_equal(target.ring_index, np.concatenate(index)):
        raise ValueError("marks must be one for each face, and ring_face and ring_index theirs, face by face")


def _digest(target: TargetGeometry, names: tuple[str, ...], *, full: bool = False) -> str:
    """SHA-256 over the named arrays (with source and spec if `full`), its first 16 hexadecimal digits."""
    digest = hashlib.sha256(DIGESTED)
    if target.marks is not None:
        digest.update(json.dumps([marks_to_mapping(marks) for marks in target.marks], sort_keys=True).encode())
    for name in names:
        array: NDArray[np.generic] = getattr(target, name)
        digest.update(f"{name} {array.shape} {array.dtype.str}".encode())
        digest.update(array.astype(array.dtype.newbyteorder("<"), copy=False).tobytes())
    if full:
        spec = None if target.spec is None else spec_to_mapping(target.spec)
        digest.update(f"{target.source} {json.dumps(spec, sort_keys=True)}".encode())
    return digest.hexdigest()[:16]


def target_to_json(target: TargetGeometry) -> str:
    """The text of `NAME.target.json`: one line a field."""
    document: dict[str, object] = {
        "format": FORMAT,
        "version": VERSION,
        "layout_id": target.layout_id,
        "geometry_id": target.geometry_id,
        "source": target.source,
        "unit": "mm",
        "spec": None if target.spec is None else spec_to_mapping(target.spec),
    }
    if target.build is not None:
        document["build"] = target.build
    if target.has_lip:
        document["has_lip"] = True
    if target.marks is not None:
        document["marks"] = [marks_to_mapping(marks) for marks in target.marks]
    document.update({name: array.tolist() for name, array in _present_arrays(target).items()})
    lines = (f"{json.dumps(key)}: {json.dumps(value, allow_nan=False)}" for key, value in document.items())
    return "{\n" + ",\n".join(lines) + "\n}\n"


def target_from_json(text: str) -> TargetGeometry:
    """The target in the text of a `target.json`.

    Raises:
        ValueError: not JSON, another format or version, a field missing or unknown, a value that breaks a rule
            of `TargetGeometry`, or ids that do not fit the numbers.
    """
    try:
        document = json.loads(text, parse_constant=_refuse_constant, object_pairs_hook=once_each)
    except RecursionError:
        raise ValueError("not a target file: nested too deep") from None
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise ValueError(f'not a target file: it must be a JSON object with "format": "{FORMAT}"')
    if type(document.get("version")) is not int or document["version"] != VERSION:
        raise ValueError(f"target file version {document.get('version')!r}; this program reads version {VERSION}")
    if document.get("unit") != "mm":
        raise ValueError(f'"unit" is {document.get("unit")!r}; it must be "mm"')
    known = {"format", "version", "layout_id", "geometry_id", "source", "unit", "spec", *_REQUIRED}
    odd = (known ^ document.keys()) - {*_OPTIONAL, "build", "has_lip", "marks"}
    if odd:
        raise ValueError(f"missing or unknown fields: {', '.join(sorted(map(repr, odd)))}")
    target = _target_from_document(document)
    for name in ("layout_id", "geometry_id"):
        if str(document[name]).lower() != getattr(target, name):
            raise ValueError(
                f"{name} {document[name]!r} does not fit the numbers ({getattr(target, name)}): the file was changed "
                "by hand; design the target again instead"
            )
    return target


def _target_from_document(document: Mapping[str, object]) -> TargetGeometry:
    """Build the target from a document with all fields present."""
    spec, source = document["spec"], document["source"]
    if spec is not None and not isinstance(spec, dict):
        raise ValueError("spec must be an object or null")
    try:
        for name in (name for name, (dtype, _) in _ARRAYS.items() if dtype != "bool"):
            if _holds_truth_value(document.get(name)):
                raise ValueError(f"{name} holds true or false; it must hold numbers")
        return TargetGeometry(
            source=cast("Source", source),  # checked by TargetGeometry
            spec=None if spec is None else spec_from_mapping(spec),
            **{name: np.asarray(document[name]) for name in _REQUIRED},
            **{name: np.asarray(document[name]) for name in _OPTIONAL if document.get(name) is not None},
            build=_build_of(document.get("build")),
            has_lip=document.get("has_lip") is True,
            marks=_marks_of(document.get("marks")),
        )
    except (TypeError, OverflowError, RecursionError) as error:
        raise ValueError(f"a value of the wrong type: {error}") from error


def _marks_of(values: object) -> tuple[FaceMarks, ...] | None:
    """The marks of each face, if the document has any."""
    if values is None:
        return None
    if not isinstance(values, list) or not all(isinstance(one, dict) for one in values):
        raise ValueError("marks must be a list with an object for each face")
    return tuple(marks_from_mapping(one, f"marks[{face}]") for face, one in enumerate(values))


def _build_of(name: object) -> str | None:
    """A build's name of today."""
    if name is None:
        return None
    try:
        return build_name(str(name))
    except ValueError as error:
        raise ValueError(f"build is {name!r}; it {error}") from None


def _holds_truth_value(values: object) -> bool:
    """Whether nested lists hold true or false, which numpy would take for 1 and 0."""
    if isinstance(values, list):
        return any(map(_holds_truth_value, values))
    return isinstance(values, bool)


def _refuse_constant(name: str) -> float:
    raise ValueError(f"the number {name} is not finite")


def load_target(path: str | PathLike[str], needs: Needs = "points") -> TargetGeometry:
    """Read a target file: `load_target("ico.target.json")`.

    Args:
        path: the file.
        needs: what its features must be: points without marks cannot be drawn, dots alone cannot be detected.

    Raises:
        InputError: the file cannot be read or is no valid target file; the message names it.
    """
    path = place_of(path, "a target file (NAME.target.json)")
    text = read_small_text(path, MAX_FILE_BYTES, "a target file (NAME.target.json)")
    try:
        target = target_from_json(text)
    except json.JSONDecodeError as error:
        raise InputError(f"{path}: line {error.lineno}, column {error.colno}: {error.msg}; not valid JSON") from None
    except ValueError as error:
        raise InputError(f"{path}: {error}") from None
    if needs == "marks" and not target.has_marks:
        raise InputError(
            f"{path}: holds points without marks, so there is nothing to draw; make it with `calib target --diameter`"
        )
    if needs == "rings" and target.is_dot.all() and target.marks is None:
        what = "dots without rings" if target.has_marks else "points without marks"
        raise InputError(
            f"{path}: holds {what}, which are not detected here; give what was seen to `calib solve` as a table, "
            "image,u,v,id"
        )
    return target


def target_of_marks(
    marks: Sequence[FaceMarks], target_from_face: Array, margin_mm: float | None = None
) -> TargetGeometry:
    """A target whose faces carry other makers' marks.

    Args:
        marks: of each face.
        target_from_face: frames in the middle of the marks, x right, y up, z outward.  # (F, 4, 4)
        margin_mm: of white around the marks; None: as much as they need to be found.

    Raises:
        ValueError: two faces that photos cannot tell apart.
    """
    count = [len(one.index) for one in marks]
    face = np.repeat(np.arange(len(marks)), count)
    at = np.concatenate([one.position_mm for one in marks])
    frame = np.round(target_from_face, _FRAME_DECIMALS)
    margin = [one.quiet_mm if margin_mm is None else margin_mm for one in marks]
    size = np.array([one.size_mm for one in marks])[:, None] / 2 + np.array(margin)[:, None, None]
    outline = size * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    radius = np.repeat([one.radius_mm for one in marks], count)
    return TargetGeometry(
        source="nominal",
        spec=None,
        ring_face=face,
        ring_index=np.concatenate([one.index for one in marks]),
        center_mm=np.round(np.einsum("rij,rj->ri", frame[face][:, :3, :2], at) + frame[face][:, :3, 3], _DECIMALS),
        radius_outer_mm=radius,
        radius_inner_mm=np.zeros(len(face)),
        is_dot=np.ones(len(face), dtype=np.bool_),
        target_from_face=frame,
        outline_mm=outline,
        window_mm=outline,
        face_code=np.full(len(marks), -1),
        lattice_mm=np.array([np.diag(one.step_mm) for one in marks]),
        marks=tuple(marks),
    )


def corners_mm(target: TargetGeometry) -> Array:
    """Corners of the faces' outlines in the target's frame.  # (F, K, 3)"""
    frame = target.target_from_face
    placed: Array = np.einsum("fij,fkj->fki", frame[:, :3, :2], target.outline_mm)
    return placed + frame[:, None, :3, 3]


def bounding_radius_mm(target: TargetGeometry) -> float:
    """Largest distance of an outline corner from the target's origin."""
    return math.sqrt(float((corners_mm(target) ** 2).sum(axis=2).max()))
