"""Laws of all kinds of files that are read back: each is read bit for bit, or refused in a line that names it."""

import dataclasses
import importlib
import json
import math
import re
from functools import cache
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from designer.base.arrays import Array, Flags, Rows
from designer.base.errors import InputError
from designer.base.file_kind import FileKind
from designer.base.marks import OR_NULL, AtLeast, Gap, Shape
from tests.support.file_examples import EXAMPLES, same

ROOT = Path(__file__).parents[2]


@cache
def kinds() -> dict[str, FileKind[object]]:
    """All kinds of files by their formats, wherever they are declared."""
    found: dict[str, FileKind[object]] = {}
    for path in sorted([*ROOT.glob("calib/**/*.py"), *ROOT.glob("designer/**/*.py")]):
        if "= FileKind(" not in path.read_text():
            continue
        module = importlib.import_module(".".join(path.relative_to(ROOT).with_suffix("").parts))
        for value in vars(module).values():
            if isinstance(value, FileKind) and found.setdefault(value.format, value) is not value:
                raise AssertionError(f"{value.format} is declared twice")
    return found


def test_each_kind_has_an_example_and_a_format_of_its_own() -> None:
    """A kind of file is declared once, and held to these laws by an example."""
    assert kinds().keys() == EXAMPLES.keys()


@pytest.mark.parametrize("name", EXAMPLES)
def test_what_is_written_is_read_bit_for_bit(name: str, tmp_path: Path) -> None:
    """A file holds all of a value: arrays with their gaps, numbers to the last digit, texts; its format comes first."""
    kind, value = kinds()[name], EXAMPLES[name]()
    path = tmp_path / "file.json"
    path.write_bytes(kind.text(value))
    assert path.read_bytes().startswith(b'{\n "format": "' + name.encode())
    assert same(kind.read(path), value)


@pytest.mark.parametrize("name", EXAMPLES)
def test_other_formats_and_versions_are_named(name: str, tmp_path: Path) -> None:
    """A file of another kind or version is told by that, before anything else that may be wrong with it."""
    kind, path = kinds()[name], tmp_path / "file.json"
    for head, words in (
        ('{"format": "somebody.else", "version": 1}', f'it must hold "format": "{name}"'),
        (f'{{"format": "{name}"}}', f"version None; this program reads version {kind.version}"),
        (f'{{"format": "{name}", "version": 99}}', f"version 99; this program reads version {kind.version}"),
        (f'{{"format": "{name}", "version": true}}', "version True"),
    ):
        path.write_text(head)
        with pytest.raises(InputError, match=r"^\S") as refused:
            kind.read(path)
        assert words in str(refused.value)


ODD = st.one_of(
    st.none(), st.booleans(), st.integers(-(10**25), 10**25), st.floats(), st.text(max_size=5),
    st.sampled_from([{}, [], [[]], [[[]]], {"format": 1}, "x" * 5000, 1e308, 10**400, "\ud800\x1b[2J\n", -0.0]),
)  # fmt: skip


@cache
def places(name: str) -> tuple[tuple[str | int, ...], ...]:
    """The places of all values in an example, the first few of each list."""

    def inner(value: object, at: tuple[str | int, ...]) -> list[tuple[str | int, ...]]:
        parts = value.items() if isinstance(value, dict) else enumerate(value[:4]) if isinstance(value, list) else ()
        return [at, *(place for key, one in parts for place in inner(one, (*at, key)))]

    return tuple(inner(kinds()[name].document(EXAMPLES[name]()), ()))


def read_or_refuse(kind: FileKind[object], path: Path) -> None:
    """A file gives a value that can be written again, or one line that names it."""
    try:
        value, fault = kind.read(path), None
    except InputError as error:
        value, fault = None, str(error)
    if fault is not None:
        assert fault.startswith(str(path))
        assert "\n" not in fault
        assert len(fault) < len(str(path)) + 600
    else:
        assert same(kind.of(json.loads(kind.text(value)), "again"), value)


@pytest.mark.parametrize("name", EXAMPLES)
def test_null_in_the_place_of_any_value_reads_or_is_refused(name: str, tmp_path: Path) -> None:
    """Null for a number, a whole array, an object: a value of the type, or one line."""
    kind, path = kinds()[name], tmp_path / "file.json"
    example = kind.text(EXAMPLES[name]())
    for *above, last in places(name)[1:]:
        document = json.loads(example)
        parent: object = document
        for key in above:
            parent = parent[key]
        parent[last] = None
        path.write_text(json.dumps(document))
        read_or_refuse(kind, path)


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_a_tampered_file_reads_or_is_refused_in_one_line(tmp_path: Path, data: st.DataObject) -> None:
    """Any value put anywhere, or a key taken out or put in: a value of the type, or one line; never a traceback."""
    name = data.draw(st.sampled_from(sorted(EXAMPLES)))
    document = kinds()[name].document(EXAMPLES[name]())
    *above, last = data.draw(st.sampled_from(places(name)[1:]))
    parent: object = document
    for key in above:
        parent = parent[key]
    match data.draw(st.sampled_from(["put", "put", "put", "take", "add"])), parent:
        case "add", dict():
            parent["odd"] = data.draw(ODD)
        case "take", _:
            del parent[last]
        case _:
            parent[last] = data.draw(ODD)
    path = tmp_path / "file.json"
    path.write_text(json.dumps(document))
    read_or_refuse(kinds()[name], path)


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_a_truncated_file_is_refused_in_one_line(tmp_path: Path, data: st.DataObject) -> None:
    """A file that ends too early is refused, wherever it ends."""
    name = data.draw(st.sampled_from(sorted(EXAMPLES)))
    content = kinds()[name].text(EXAMPLES[name]())
    path = tmp_path / "file.json"
    path.write_bytes(content[: data.draw(st.integers(0, len(content) - 3))])
    with pytest.raises(InputError, match=r"^\S") as refused:
        kinds()[name].read(path)
    assert "\n" not in str(refused.value)


def test_what_is_larger_or_deeper_than_any_is_not_parsed(tmp_path: Path) -> None:
    """A file beyond its kind's size is refused before it is read as JSON, and one nested without end in one line."""
    path = tmp_path / "file.json"
    path.write_bytes(b"[" * 50_000)
    for kind in kinds().values():
        with pytest.raises(InputError, match=r"nested too deep"):
            kind.read(path)
    small = dataclasses.replace(next(iter(kinds().values())), largest_bytes=10)
    with pytest.raises(InputError, match=r"more than 10 bytes"):
        small.read(path)


@dataclasses.dataclass(frozen=True, eq=False)
class Sample:
    """All that a field may be."""

    number: float
    gap: Gap
    count: Annotated[int, AtLeast(0)]
    names: Annotated[tuple[str, ...], Shape("V")]
    matrix: Annotated[Array, Shape("V", 2), OR_NULL]
    is_seen: Annotated[Flags, Shape("V")]
    row: Annotated[Rows, Shape("V"), AtLeast(0)]
    word: Literal["a", "b"] | None = None


SAMPLE = FileKind(Sample, "sample", "a sample", "try again")
VALUE = Sample(
    1.0, math.nan, 3, ("x", "y"), np.array([[1.0, math.nan], [5e-324, -0.0]]), np.array([True, False]),
    np.array([0, 2**62]),
)  # fmt: skip


def test_every_type_reads_back_bit_for_bit() -> None:
    """The smallest number, minus zero, gaps, truth values and large whole numbers are the same after a round trip."""
    assert same(SAMPLE.of(json.loads(SAMPLE.text(VALUE)), "here"), VALUE)


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("number", True, "number True: must be a finite number"),
        ("number", "1", "number '1': must be a finite number"),
        ("number", math.inf, "number inf: must be a finite number"),
        ("count", 1.0, "count 1.0: must be a whole number"),
        ("count", -1, "count -1: must be 0 or more"),
        ("names", ["x"], "matrix has 2 items where it must have 1"),
        ("matrix", [[1.0, 2.0], [3.0]], "matrix must be some rows of 2 numbers"),
        ("matrix", [[1.0, 2.0], [3.0, "4"]], "matrix.1.1 '4': must be a finite number"),
        ("is_seen", [1, 0], "is_seen.0 1: must be true or false"),
        ("row", [1, -1], "row.1 -1: must be 0 or more"),
        ("row", [1, 10**25], "row: a number is too long"),
        ("word", "c", "word 'c': must be 'a' or 'b'"),
        ("wrod", "a", "unknown key 'wrod'; did you mean 'word'?"),
    ],
)
def test_a_rule_is_told_with_its_place_and_value(key: str, value: object, message: str) -> None:
    """The line on a broken rule names the place, the value and the rule, and ends with what to do."""
    with pytest.raises(InputError, match=r"^\S") as refused:
        SAMPLE.of({**SAMPLE.document(VALUE), key: value}, "file.json")
    assert str(refused.value) == f"file.json: {message}; try again"


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("sigma_px_after", -1.0, "must be 0 or more"),
        ("cam_from_target", [[2.0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]], "no rotation"),
        ("outline_px", [[[1e300, 0], [0, 0]]], "outline_px.0.0.0 1e+300: "),
        ("outline_px", [[[0.0, 0.0], [1.0, 1.0]]] * 1001, "1001 items"),
        ("sentence", "x" * 501, "501 characters"),
    ],
)
def test_a_value_that_no_photo_has_is_refused(key: str, value: object, message: str) -> None:
    """By the marks of its field: bounds, motions, lengths."""
    kind = kinds()["ringsolid.next_views"]
    document = kind.document(EXAMPLES["ringsolid.next_views"]())
    document["views"][0][key] = value  # type: ignore[index, call-overload]
    with pytest.raises(InputError, match=re.escape(message)):
        kind.of(document, "file.json")


def test_a_text_of_a_file_steers_no_terminal() -> None:
    """What could is taken out where it is read."""
    kind = kinds()["ringsolid.next_views"]
    document = kind.document(EXAMPLES["ringsolid.next_views"]())
    document["views"][0]["sentence"] = "a\x1b[31mb\u202ec"  # type: ignore[index, call-overload]
    sentence = kind.of(document, "file.json").views[0].sentence  # type: ignore[attr-defined]
    assert sentence.isprintable()


def test_a_value_of_a_subclass_is_no_value_of_the_class() -> None:
    """What a file would lose is not written."""

    @dataclasses.dataclass(frozen=True, eq=False)
    class More(Sample):
        more: int = 0

    with pytest.raises(TypeError, match="a More where files hold a Sample"):
        SAMPLE.text(More(**vars(VALUE)))
