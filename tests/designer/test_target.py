"""The target geometry and its file."""

import copy
import hashlib
import json
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import cache
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import designer.target
from designer.base.errors import InputError
from designer.kinds.board import BoardSpec
from designer.kinds.ico import IcoSpec
from designer.kinds.layout import lay_out
from designer.spec.build import BUILDS
from designer.target import TargetGeometry, bounding_radius_mm, load_target, target_from_json, target_to_json

Document = dict[str, object]

ICO = IcoSpec(60.0, 5, 7.0, 0.45, 10.0, 1.0, 0.5)
BOARD = BoardSpec((90.0, 60.0), 5.0, 7, 5, "triangular", 7.0, 0.45, 10.0, 1.0, 4.0, dots=True)
# Written out here a second time, as the schema tells it to people who write such files.
ARRAYS = {
    "ring_face": "<i8",
    "ring_index": "<i8",
    "center_mm": "<f8",
    "radius_outer_mm": "<f8",
    "radius_inner_mm": "<f8",
    "is_dot": "|b1",
    "target_from_face": "<f8",
    "outline_mm": "<f8",
    "window_mm": "<f8",
    "face_code": "<i8",
    "lattice_mm": "<f8",
    "face_covariance": "<f8",
    "mode_mm": "<f8",
}
LAYOUT_ARRAYS = ("ring_face", "ring_index", "is_dot", "face_code")


def made_by_others() -> TargetGeometry:
    """Two faces with three features each and odd numbers, all optional fields present."""
    turn = np.array([[0.6, -0.8, 0, 3], [0.8, 0.6, 0, -4], [0, 0, 1, 0.1], [0, 0, 0, 1]])
    square = 50.0 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    return TargetGeometry(
        source="measured",
        spec=None,
        ring_face=np.array([0, 0, 0, 1, 1, 1]),
        ring_index=np.array([[0, 0], [1, 0], [0, 1], [0, 2], [-1, 5], [7, -7]]),
        center_mm=np.arange(18).reshape(6, 3) / 7,
        radius_outer_mm=np.array([3.5, 3.5, 3.5, 3.1, 1 / 3, 1e-9]),
        radius_inner_mm=np.array([0, 1.5, 1.6, 0, 0.1, 1e-10]),
        is_dot=np.array([True, False, False, True, False, False]),
        target_from_face=np.stack([np.eye(4), turn]),
        outline_mm=np.stack([square, 0.1 * square]),
        window_mm=np.stack([0.9 * square, 0.1 * square]),
        face_code=np.array([-1, 19]),
        lattice_mm=np.array([[[10, 0], [0, 10]], [[10, 0], [5, 8.660254037844386]]]),
        face_covariance=np.stack([1e-6 * np.eye(6), 1e-3 * np.eye(6)]),
        mode_mm=np.arange(36).reshape(2, 6, 3) / 700,
    )


def in_pieces() -> TargetGeometry:
    """A board in two halves."""
    whole = lay_out(BOARD)
    return replace(whole, build="tiles", ring_piece=(whole.center_mm[:, 0] > 1).astype(int))


TARGETS: dict[str, Callable[[], TargetGeometry]] = {
    "ico": cache(lambda: lay_out(ICO)),
    "board": cache(lambda: lay_out(BOARD)),
    "others": cache(made_by_others),
    "pieces": cache(in_pieces),
}
SCHEMA = jsonschema.Draft202012Validator(
    json.loads((Path(designer.target.__file__).parent / "target.schema.json").read_text())
)


@pytest.fixture(params=TARGETS)
def target(request: pytest.FixtureRequest) -> TargetGeometry:
    return TARGETS[request.param]()


def arrays_of(target: TargetGeometry) -> dict[str, np.ndarray]:
    return {name: getattr(target, name) for name in ARRAYS if getattr(target, name) is not None}


def with_ids(document: Document) -> Document:
    """The document with ids that fit its numbers, computed as the schema describes it."""

    def digest(names: Iterable[str], tail: str = "") -> str:
        content = bytes.fromhex("72696e67666f7267652e7461726765742031")
        for name in names:
            array = np.array(document[name], dtype=ARRAYS[name])
            array = array + 0.0 if array.dtype == np.float64 else array
            content += f"{name} {array.shape} {ARRAYS[name]}".encode() + array.tobytes()
        return hashlib.sha256(content + tail.encode()).hexdigest()[:16]

    present = [name for name in ARRAYS if document.get(name) is not None]
    tail = f"{document['source']} {json.dumps(document['spec'], sort_keys=True)}"
    return {**document, "layout_id": digest(LAYOUT_ARRAYS), "geometry_id": digest(present, tail)}


# --- the type -----------------------------------------------------------------------------------------------------


def test_arrays_are_contiguous_and_read_only(target: TargetGeometry) -> None:
    """Every array, the derived ones too, is C-contiguous, of its declared type, and cannot be written to."""
    for name, array in {**arrays_of(target), "center_in_face_mm": target.center_in_face_mm}.items():
        assert array.flags.c_contiguous, name
        assert not array.flags.writeable, name
        assert array.dtype == np.dtype(ARRAYS.get(name, "<f8")), name


def test_arrays_are_copied() -> None:
    """Writing into the caller's array afterwards changes nothing."""
    given_radius = np.full(35 - 2, 3.5)
    target = lay_out(BOARD)
    own = replace(target, radius_outer_mm=given_radius)
    given_radius[0] = 99.0
    assert own.radius_outer_mm[0] == 3.5


def test_ids_change_with_every_number() -> None:
    """Changing any single entry, by the least step, changes geometry_id; layout_id only with what a detector needs."""
    target = made_by_others()
    seen = {target.geometry_id}
    for name, array in arrays_of(target).items():
        for place in np.ndindex(array.shape):
            if name == "target_from_face" and place[1] == 3:
                continue  # the last row is fixed
            changes = {name: array.copy()}
            if name == "is_dot":  # a dot has no white centre, so this takes two fields
                changes["radius_inner_mm"] = target.radius_inner_mm.copy()
                changes["radius_inner_mm"][place] = 0.0 if not array[place] else 0.2
                changes[name][place] = not array[place]
            elif name == "radius_inner_mm" and target.is_dot[place]:
                continue
            elif name in ("ring_face", "face_code"):
                changes[name][place] = {0: 1, 1: 0, -1: 3, 19: 18}[int(array[place])]
            elif name == "ring_index":
                changes[name][place] += 100
            else:
                changes[name][place] = np.nextafter(array[place], np.inf)
            changed = replace(target, **changes)
            assert changed.geometry_id not in seen, (name, place)
            seen.add(changed.geometry_id)
            assert (changed.layout_id != target.layout_id) == (name in LAYOUT_ARRAYS), (name, place)


def test_ids_depend_on_source_spec_and_covariance() -> None:
    """Source, every field of the spec, and the presence of a covariance are part of geometry_id, not of layout_id."""
    target = lay_out(ICO)
    others = [
        replace(target, source="measured"),
        replace(target, spec=None),
        replace(target, spec=replace(ICO, margin_mm=0.25)),
        replace(target, face_covariance=np.zeros((20, 6, 6))),
    ]
    assert len({target.geometry_id, *(other.geometry_id for other in others)}) == 5
    assert {other.layout_id for other in others} == {target.layout_id}


def test_pieces_are_kept_and_told_by_no_id() -> None:
    """They say how a board is made, as the build does; only boards with one face have some, each with a ring."""
    made = in_pieces()
    kept = target_from_json(target_to_json(made))
    assert kept.ring_piece is not None
    assert np.array_equal(kept.ring_piece, made.ring_piece)
    assert made.geometry_id == lay_out(BOARD).geometry_id
    for target, piece in ((lay_out(BOARD), 2 * made.ring_piece), (lay_out(BOARD), -made.ring_piece),
                          (lay_out(ICO), np.zeros(lay_out(ICO).ring_count, dtype=int))):  # fmt: skip
        with pytest.raises(ValueError, match="ring_piece must number the pieces"):
            replace(target, ring_piece=piece)


def test_equal_numbers_have_equal_ids() -> None:
    """Negative zeros, whole numbers and memory order make no difference; equality and hash follow the id."""
    target = lay_out(BOARD)
    same = replace(
        target,
        center_mm=np.asfortranarray(np.where(target.center_mm == 0, -0.0, target.center_mm)),
        spec=replace(BOARD, thickness_mm=5),
    )
    assert same.geometry_id == target.geometry_id
    assert same == target
    assert hash(same) == hash(target)
    assert replace(target, source="perturbed") != target


def changed_entry(name: str, place: tuple[int, ...], value: float) -> dict[str, np.ndarray]:
    array = getattr(made_by_others(), name).copy()
    array[place] = value
    return {name: array}


BROKEN: dict[str, dict[str, object]] = {
    "wrong shape": {"center_mm": np.zeros((6, 2))},
    "too few": {"radius_outer_mm": np.ones(5)},
    "not finite": changed_entry("center_mm", (0, 0), np.nan),
    "infinite": changed_entry("outline_mm", (0, 0, 0), np.inf),
    "numbers for truth values": {"is_dot": np.array([1, 0, 0, 1, 0, 0])},
    "text": {"radius_outer_mm": np.array(["1"] * 6)},
    "no features": {"ring_face": np.empty(0, dtype=int)},
    "face out of range": changed_entry("ring_face", (0,), 2),
    "one index twice": changed_entry("ring_index", (1, 0), 0),
    "inner radius too large": changed_entry("radius_inner_mm", (1,), 3.5),
    "dot with a hole": changed_entry("radius_inner_mm", (0,), 1.0),
    "ring without a hole": changed_entry("radius_inner_mm", (1,), 0.0),
    "stretched frame": changed_entry("target_from_face", (0, 0, 0), 1.001),
    "mirrored frame": changed_entry("target_from_face", (0, 0, 0), -1.0),
    "frame that overflows": {
        "target_from_face": np.array([[[1e200, -1e200, 0, 0], [1e200, 1e200, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]] * 2)
    },
}


@pytest.mark.parametrize("changes", BROKEN.values(), ids=BROKEN)
@pytest.mark.filterwarnings("ignore:(overflow|invalid value) encountered:RuntimeWarning")
def test_broken_rules_are_refused(changes: dict[str, object]) -> None:
    """Arrays that cannot describe a target raise ValueError with one line."""
    with pytest.raises(ValueError, match=r".") as raised:
        replace(made_by_others(), **changes)
    assert "\n" not in str(raised.value)


def test_bounding_radius_is_the_farthest_corner() -> None:
    """For an icosahedron of edge a it is the circumradius, a sin 72 deg."""
    assert bounding_radius_mm(lay_out(ICO)) == pytest.approx(60 * np.sin(2 * np.pi / 5))


# --- the file -----------------------------------------------------------------------------------------------------


def test_round_trip_is_exact(target: TargetGeometry, tmp_path: Path) -> None:
    """A written file reads back to the same numbers, bit for bit, and writes to the same bytes."""
    path = tmp_path / "a.target.json"
    path.write_text(target_to_json(target), encoding="utf-8")
    read = load_target(path)
    assert (read.source, read.spec) == (target.source, target.spec)
    assert arrays_of(read).keys() == arrays_of(target).keys()
    for name, array in arrays_of(target).items():
        assert arrays_of(read)[name].tobytes() == array.tobytes(), name
        assert arrays_of(read)[name].shape == array.shape, name
    assert (read.geometry_id, read.layout_id) == (target.geometry_id, target.layout_id)
    assert target_to_json(read).encode() == path.read_bytes()


def test_files_validate_against_the_schema(target: TargetGeometry) -> None:
    """What the program writes, the published schema accepts; the schema itself is valid."""
    SCHEMA.check_schema(SCHEMA.schema)
    for build in BUILDS:
        SCHEMA.validate(json.loads(target_to_json(replace(target, build=build))))


def test_ids_are_computed_as_the_schema_describes(target: TargetGeometry) -> None:
    """Another program that follows the schema's description of the digests arrives at the same ids."""
    document = json.loads(target_to_json(target))
    assert with_ids({**document, "layout_id": "", "geometry_id": ""}) == document


def test_schema_and_type_have_the_same_fields() -> None:
    """Every array of the type is described in the schema, with its shape, and nothing else is."""
    optional = {"build", "has_lip", "marks", "ring_piece"}
    head = {"format", "version", "layout_id", "geometry_id", "source", "unit", "spec"} | optional
    properties = SCHEMA.schema["properties"]
    assert properties.keys() == head | ARRAYS.keys()
    assert set(SCHEMA.schema["required"]) == properties.keys() - {"face_covariance", "mode_mm"} - optional
    assert all(properties[name]["description"][0] in "RFS" for name in ARRAYS)


def edited(change: Callable[[Document], object]) -> Document:
    """A sound document, changed."""
    document = json.loads(target_to_json(lay_out(BOARD)))
    change(document)
    return document


UNSOUND: dict[str, Callable[[Document], object]] = {
    "field missing": lambda d: d.pop("spec"),
    "field unknown": lambda d: d.update(extra=1),
    "another format": lambda d: d.update(format="other"),
    "another version": lambda d: d.update(version=2),
    "another unit": lambda d: d.update(unit="cm"),
    "another source": lambda d: d.update(source="guessed"),
    "id of another shape": lambda d: d.update(layout_id="0"),
    "spec as text": lambda d: d.update(spec="board"),
    "spec with truth for a number": lambda d: d["spec"].update(pitch_mm=True),
    "point with two numbers": lambda d: d["center_mm"][0].pop(),
    "null": lambda d: d.update(center_mm=None),
    "text in an array": lambda d: d["center_mm"][0].__setitem__(0, "1"),
    "truth in a number array": lambda d: d["center_mm"][0].__setitem__(0, True),
    "number in a truth array": lambda d: d["is_dot"].__setitem__(0, 0),
    "index beyond int64": lambda d: d["ring_index"][0].__setitem__(0, 2**63),
    "negative face": lambda d: d["ring_face"].__setitem__(0, -1),
    "code out of range": lambda d: d.update(face_code=[224]),
    "projective frame": lambda d: d["target_from_face"][0][3].__setitem__(0, 0.5),
    "frame with three rows": lambda d: d["target_from_face"][0].pop(),
    "outline with two corners": lambda d: d.update(outline_mm=[[[0, 0], [1, 1]]], window_mm=[[[0, 0], [1, 1]]]),
    "another build": lambda d: d.update(build="glued"),
    "covariance with five rows": lambda d: d.update(face_covariance=[[[0.0] * 6] * 5]),
}


UNSOUND_SPECS: dict[str, Callable[[Document], object]] = {
    "spec of unknown kind": lambda d: d["spec"].update(kind="cube"),
    "spec field missing": lambda d: d["spec"].pop("dots"),
    "spec field unknown": lambda d: d["spec"].update(colour="red"),
    "spec with text for a number": lambda d: d["spec"].update(size_mm=["90", "60"]),
    "spec with a fraction for a count": lambda d: d["spec"].update(rows=2.5),
}


@pytest.mark.parametrize("change", UNSOUND_SPECS.values(), ids=UNSOUND_SPECS)
def test_a_spec_is_that_of_its_kind(change: Callable[[Document], object], tmp_path: Path) -> None:
    """Fields that are a kind's own are held to it: the program names the file, in one line."""
    path = tmp_path / "a.target.json"
    path.write_text(json.dumps(edited(change)), encoding="utf-8")
    with pytest.raises(InputError, match=r"a\.target\.json: .*spec") as raised:
        load_target(path)
    assert len(str(raised.value).splitlines()) == 1


@pytest.mark.parametrize("change", UNSOUND.values(), ids=UNSOUND)
def test_unsound_files_are_refused_by_schema_and_program(change: Callable[[Document], object], tmp_path: Path) -> None:
    """Both refuse a wrong field, type, shape or range; the program names the file, in one line."""
    document = edited(change)
    assert not SCHEMA.is_valid(document)
    path = tmp_path / "a.target.json"
    path.write_text(json.dumps(document), encoding="utf-8")
    with pytest.raises(InputError, match=r"a\.target\.json") as raised:
        load_target(path)
    assert len(str(raised.value).splitlines()) == 1


def test_true_is_not_one(tmp_path: Path) -> None:
    """A truth value in place of the number 1 (or 0) is refused, though the ids would fit."""
    text = target_to_json(made_by_others())
    for number, truth in (
        ("[[[1.0, 0.0", "[[[true, 0.0"),
        ("[1.0, 0.0, 0.0", "[1.0, false, 0.0"),
        ("[1, 0]", "[true, 0]"),
    ):
        assert number in text
        assert load_text(text.replace(number, truth, 1), tmp_path / "a.target.json") is None


json_values = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.sampled_from([2**63, -(2**63), 2**64 - 1, 10**400, float("nan"), float("inf"), 1e308, -1e308, 5e-324, "\n"])
    | st.floats(allow_nan=False, allow_infinity=False)
    | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=8,
)


@st.composite
def corrupted(draw: st.DrawFn) -> tuple[Document, Document]:
    """A sound document and the same one with something replaced, removed, doubled or added."""
    sound = json.loads(target_to_json(TARGETS[draw(st.sampled_from(["board", "others"]))]()))
    document = copy.deepcopy(sound)
    holder: object = document
    while True:
        places = list(holder) if isinstance(holder, dict) else list(range(len(holder)))
        place = draw(st.sampled_from(places))
        inner = holder[place]
        if not isinstance(inner, (dict, list)) or not inner or draw(st.integers(0, 3)) == 0:
            break
        holder = inner
    match draw(st.sampled_from(["replace", "remove", "double"])):
        case "replace":
            holder[place] = draw(json_values)
        case "remove":
            del holder[place]
        case "double" if isinstance(holder, list):
            holder.append(holder[place])
        case _:
            holder[draw(st.text(max_size=5))] = holder[place]
    return sound, document


def load_text(text: str, path: Path) -> TargetGeometry | None:
    """The target in a file with this text; None if it is refused in one line that names the file."""
    path.write_text(text, encoding="utf-8", errors="surrogatepass")
    try:
        return load_target(path)
    except InputError as error:
        message = str(error)
    assert message.startswith(str(path))
    assert len(message.splitlines()) == 1
    return None


def same_json(a: object, b: object) -> bool:
    """Whether two JSON values are the same; 1 and 1.0 are, true is neither."""
    if isinstance(a, bool) or isinstance(b, bool):
        return a is b
    if isinstance(a, list) and isinstance(b, list):
        return len(a) == len(b) and all(map(same_json, a, b))
    if isinstance(a, dict) and isinstance(b, dict):
        return a.keys() == b.keys() and all(same_json(a[key], b[key]) for key in a)
    return a == b


@pytest.fixture(scope="module")
def scratch(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("target") / "a.target.json"


@given(documents=corrupted())
@settings(max_examples=150, deadline=2000)
@pytest.mark.filterwarnings("ignore:(overflow|invalid value) encountered:RuntimeWarning")
def test_changed_documents_are_refused_or_sound(scratch: Path, documents: tuple[Document, Document]) -> None:
    """A document in which anything was changed does not load, and the refusal is one line.

    With ids that fit, what loads obeys the schema and writes a file that loads again.
    """
    sound, document = documents
    assert load_text(json.dumps(document), scratch) is None or same_json(document, sound)
    try:
        document = with_ids(document)
    except (ValueError, TypeError, KeyError, OverflowError):
        return  # another program could not have written it either
    loaded = load_text(json.dumps(document), scratch)
    if loaded is not None:
        SCHEMA.validate(document)
        assert target_from_json(target_to_json(loaded)) == loaded


@given(data=st.data())
@settings(max_examples=100, deadline=2000)
def test_corrupted_text_is_refused(scratch: Path, data: st.DataObject) -> None:
    """Text that was cut off, or in which a stretch was overwritten, does not load as another target."""
    target = TARGETS["others"]()
    text = target_to_json(target)
    start = data.draw(st.integers(0, len(text) - 1))
    end = data.draw(st.sampled_from([start, start + 1, start + 5, len(text)]))
    put = data.draw(st.sampled_from(["", "NaN", "Infinity", "1e999", "-", "[", "}", '"', "\\u", "\x00", "9" * 5000]))
    loaded = load_text(text[:start] + put + text[end:], scratch)
    assert loaded is None or loaded == target


@pytest.mark.parametrize("depth", [40, 950, 980, 100_000])
def test_deep_nesting_is_refused(depth: int, scratch: Path) -> None:
    """Lists nested to any depth, also just below the interpreter's limit, are refused like other nonsense."""
    for field in ("version", "source", "layout_id", "spec", "center_mm", "is_dot", "extra"):
        document = json.loads(target_to_json(TARGETS["board"]()))
        text = json.dumps({**document, field: "HERE"}).replace('"HERE"', "[" * depth + "]" * depth)
        assert load_text(text, scratch) is None
    assert load_text("[" * depth, scratch) is None
