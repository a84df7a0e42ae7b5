"""Spec files: what people write, and what is written next to the outputs."""

import math
from pathlib import Path
from typing import get_args

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from designer.base.errors import InputError
from designer.base.files import MAX_TOML_BYTES
from designer.kinds.board import AskedBoard
from designer.kinds.ico import KIND
from designer.kinds.presets import PresetKind, preset_names, preset_or_file
from designer.kinds.sizing import printer_of, size_job
from designer.kinds.spec_file import (
    FORMATS,
    RawValue,
    parse_printing,
    parse_spec,
    read_printer_file,
    read_spec_file,
    replaced,
    spec_to_toml,
)
from designer.make.printability import check_printability
from designer.spec.build import BUILDS
from designer.spec.kind import kinds
from designer.spec.options import AskedPrinting, options_of
from designer.spec.spec import Job

KEYS = sorted({name for kind in kinds() for name in options_of(kind.asked)})
ICO = {"kind": "ico", "edge": "20mm"}
OF_EDGE = " or ".join(repr(kind.name) for kind in kinds() if "edge" in options_of(kind.asked))


def written(folder: Path, content: str | bytes) -> Path:
    path = folder / "my.toml"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def job_of(values: dict[str, RawValue]) -> Job:
    return size_job(parse_spec(values, "my.toml")).job


# --- reading --------------------------------------------------------------------------------------------------------


def test_every_key_is_read(tmp_path: Path) -> None:
    """A file with all keys of an icosahedron gives all values, quantities in millimetres."""
    path = written(
        tmp_path,
        """
        kind = "ico"
        name = "my-ico"
        edge = "10cm"
        rings_per_side = 7
        ring_diameter = "7mm"
        pitch = 10
        ring_ratio = 0.4
        border = "0.1in"
        margin = 2.5
        formats = ["step", "glb"]
        page = "A3"
        printer = "prusa-mk4"
        nozzle = "0.4mm"
        line_width = "0.42mm"
        layer_height = "150um"
        bed = "25x21x22cm"
        build = "solid"
        inlay_depth = "0.9mm"
        ink_offset = "-0.05mm"
        shrink_compensation = "0.4%"
        skew_compensation = "xy 0.02deg, XZ -2mrad"
        sticker_thickness = "0.2mm"
        body_colour = "#FFEEDD"
        ink_colour = "#001122"
        labels = false
        stand = true
        chord_error = "10um"
        """,
    )
    asked = parse_spec(read_spec_file(path), str(path))
    assert asked == KIND.asked(
        name="my-ico", edge=100.0, rings_per_side=7, ring_diameter=7.0, pitch=10.0, ring_ratio=0.4,
        border=2.54, margin=2.5, formats=["step", "glb"], page="A3", printer="prusa-mk4", nozzle=0.4, line_width=0.42,
        layer_height=0.15, bed=(250.0, 210.0, 220.0), build="one-piece", inlay_depth=0.9, ink_offset=-0.05,
        shrink_compensation=0.4, skew_compensation=(math.radians(0.02), -0.002, 0.0), sticker_thickness=0.2,
        body_colour="#ffeedd", ink_colour="#001122", labels=False, stand=True, chord_error=0.01,
    )  # fmt: skip


def test_a_board_reads_its_own_keys() -> None:
    """Size, thickness, columns, rows, lattice and dots; as text, as the command line gives them, too."""
    asked = parse_spec(
        {"kind": "board", "size": "22x20cm", "thickness": "5", "columns": "9", "rows": 7, "lattice": "triangular"}, ""
    )
    assert isinstance(asked, AskedBoard)
    assert (asked.size, asked.thickness, asked.columns, asked.rows) == ((220.0, 200.0), 5.0, 9, 7)
    assert (asked.lattice, asked.dots) == ("triangular", None)


@pytest.mark.parametrize(
    ("text", "place"),
    [
        ("edge = \n", "line 1, column 8"),
        ('kind = "ico"\nedge = 20mm\n', "line 2, column 10"),
        ('kind = "ico', "at its end"),
        ('edge = "1mm"\nedge = "2mm"', "line 2, column 13|at its end"),
        ("edge = 2020-13-45", "line 1"),
    ],
)
def test_syntax_errors_name_line_and_column(text: str, place: str, tmp_path: Path) -> None:
    """Malformed TOML is refused in one line with file, line and column."""
    path = written(tmp_path, text)
    with pytest.raises(InputError, match=rf"my\.toml: ({place}).*not valid TOML") as raised:
        read_spec_file(path)
    assert len(str(raised.value).splitlines()) == 1


@pytest.mark.parametrize(
    "content",
    [b"\xff\xfe", b"\x00", b"edge = " + b"1" * 5000, b"edge = " + b"[" * 9000, b"#" * (MAX_TOML_BYTES + 1), b"\x7fELF"],
    ids=["not UTF-8", "NUL", "long number", "deep", "large", "binary"],
)
def test_other_files_are_refused(content: bytes, tmp_path: Path) -> None:
    """Binary, deep and large files and numbers of thousands of digits are refused in one line that names the file."""
    with pytest.raises(InputError, match=r"my\.toml: ") as raised:
        read_spec_file(written(tmp_path, content))
    assert len(str(raised.value).splitlines()) == 1
    assert len(str(raised.value)) < 500
    assert (f"more than {MAX_TOML_BYTES} bytes" in str(raised.value)) == (len(content) > MAX_TOML_BYTES)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"kind": "ico", "edg": "20mm"}, "unknown key 'edg'; did you mean 'edge'"),
        ({**ICO, "ring_diametre": 7}, "unknown key 'ring_diametre'; did you mean 'ring_diameter'"),
        ({**ICO, "color": "#ffffff"}, "unknown key 'color'"),
        ({"kind": "board", "edge": 20}, f"edge is for kind {OF_EDGE}; leave it out, or change the kind"),
        ({"edge": 20}, "kind is missing; write kind = 'ico' or 'board'"),
        ({"kind": "ball"}, "kind 'ball' is unknown; write kind = 'ico' or 'board' or 'cube'"),
        ({"kind": "ico"}, "edge is missing; give the edge length, such as 100mm"),
        ({**ICO, "edge": 0}, "edge 0: must be more than zero"),
        ({**ICO, "pitch": 1e-310}, "pitch 1e-310: must be at least"),
        ({**ICO, "edge": "20 furlong"}, "edge '20 furlong': unknown unit of length 'furlong'; use mm, cm"),
        ({**ICO, "border": "-1mm"}, "border '-1mm': must not be negative"),
        ({**ICO, "rings_per_side": 0}, "rings_per_side 0: must be a whole number above zero"),
        ({**ICO, "rings_per_side": 5.5}, "rings_per_side 5.5: must be a whole number"),
        ({**ICO, "ring_ratio": 0.9}, "ring_ratio 0.9: must be a number from 0.2 to 0.8"),
        ({**ICO, "formats": ["stp"]}, "formats .*: unknown format 'stp'; did you mean 'step'"),
        ({**ICO, "formats": ["step", 5]}, "formats .*: "),
        ({**ICO, "shrink_compensation": "30%"}, "shrink_compensation '30%': .*20"),
        ({**ICO, "body_colour": "white"}, "body_colour 'white': must be a colour such as #ffffff"),
        ({**ICO, "build": "printd"}, "build 'printd': "),
        ({**ICO, "labels": "maybe"}, "labels 'maybe': must be true or false"),
        ({**ICO, "chord_error": "1mm"}, "chord_error '1mm': must be from 0.0005mm to 0.5mm"),
        ({**ICO, "page": "A4\nA5"}, r"page 'A4\\nA5': "),
        ({"kind": "board", "size": "220"}, "size '220': expected 2 lengths joined by x, such as 220x220mm"),
        ({"kind": "board", "lattice": "hexagonal"}, "lattice 'hexagonal': .*'square' or 'triangular'"),
        ({**ICO, "edge": 0, "pitch": 0, "margin": -1}, r"edge 0: must be more than zero"),
    ],
)
def test_bad_values_are_named_with_rule_and_remedy(values: dict[str, RawValue], message: str) -> None:
    """One line: the file, the key, the value as given, the rule."""
    with pytest.raises(InputError, match=rf"^my\.toml: {message}") as raised:
        job_of(values)
    assert len(str(raised.value).splitlines()) == 1


@pytest.mark.parametrize(
    "name", ["../x", "a/b", "a\\b", "", ".", "..", ".hidden", "-o", "a\0b", "a b", "x" * 65, "a\n", "ä", 5, True, ["a"]]
)
def test_hostile_names_are_refused(name: RawValue) -> None:
    """A name is a plain file name: no path, no control character, not hidden, no option, not long."""
    with pytest.raises(InputError, match="name ") as raised:
        job_of({**ICO, "name": name})
    assert len(str(raised.value).splitlines()) == 1


@pytest.mark.parametrize(
    ("asked", "formats"),
    [
        (None, None),
        ("step", ["step"]),
        ("glb, STEP", ["step", "glb"]),
        (["pdf", "svg", "pdf"], ["pdf", "svg"]),
        ("all", list(FORMATS)),
        (["all", "step"], list(FORMATS)),
        ([], []),
    ],
)
def test_formats_come_in_one_order(asked: RawValue | None, formats: list[str] | None) -> None:
    """Lists and comma-separated text, any case and order, doubles and `all` give one list in one order."""
    assert parse_spec({**ICO, **({"formats": asked} if asked is not None else {})}, "").formats == formats


def test_options_replace_a_files_values() -> None:
    """An option takes the place of the file's value; a new printer or nozzle also drops what belonged to the old."""
    file = {**ICO, "printer": "bambu-p1s", "nozzle": "0.4mm", "bed": "1x1x1m", "line_width": 0.45, "layer_height": 0.2}
    assert replaced(file, {"edge": "30mm"}) == {**file, "edge": "30mm"}
    assert replaced(file, {"nozzle": "0.2mm"}) == {**ICO, "printer": "bambu-p1s", "bed": "1x1x1m", "nozzle": "0.2mm"}
    assert replaced(file, {"printer": "prusa-xl"}) == {**ICO, "printer": "prusa-xl", "nozzle": "0.4mm"}


toml_values = st.recursive(
    st.one_of(
        st.text(max_size=12),
        st.integers(),
        st.sampled_from([10**400, -(10**400)]),
        st.floats(),
        st.booleans(),
        st.dates(),
        st.builds("{}{}".format, st.floats(), st.sampled_from(["", "mm", "cm", "in", "%", "x1mm", "kg"])),
        st.sampled_from(
            ["ico", "board", "square", "one-piece", "all", "bambu-p1s", "#ffffff", "A4", "x.toml", "../x.toml"]
        ),
    ),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner, max_size=2),
    max_leaves=4,
)


@given(
    st.dictionaries(st.sampled_from([*KEYS, "kind", "edgee"]) | st.text(max_size=5), toml_values, max_size=4),
    st.sampled_from(["ico", "board", None]),
)
@settings(max_examples=200, deadline=2000)
def test_any_values_give_a_job_or_a_one_line_error(values: dict[str, RawValue], kind: str | None) -> None:
    """Nothing that TOML can hold makes anything but a job or an InputError of one line."""
    whole = {**values, **({"kind": kind} if kind else {})}
    whole.setdefault("edge" if kind == "ico" else "size", "100mm" if kind == "ico" else "100x100mm")
    try:
        message = job_of(whole).name
    except InputError as error:
        message = str(error)
    assert len(message.splitlines()) == 1


@given(text=st.text(max_size=60) | st.text("abk='\"[]{}.,\n0123-# \\", max_size=60))
@settings(max_examples=100, deadline=2000, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_any_text_gives_values_or_a_one_line_error(text: str, tmp_path: Path) -> None:
    """No text in a file makes anything but keys and values or an InputError of one line."""
    path = tmp_path / "my.toml"
    path.write_bytes(text.encode("utf-8", errors="surrogatepass"))
    for read in (read_spec_file, read_printer_file):
        try:
            read(path)
        except InputError as error:
            message = str(error)
            assert len(message.splitlines()) == 1  # either outcome is fine


def nested(depth: int) -> dict[str, object]:
    values: dict[str, object] = {}
    for _ in range(depth):
        values = {"a": values}
    return values


@pytest.mark.parametrize("key", [*KEYS, "kind"])
def test_deep_and_huge_values_are_refused(key: str) -> None:
    """A table nested by a thousand dots in a key, and a number too long to print, are refused like other values."""
    for value in (nested(3000), 16**6000):
        sound = ICO if key in options_of(KIND.asked) else {"kind": "board"}
        with pytest.raises(InputError, match=f"{key} ") as raised:
            job_of({**sound, key: value})
        assert len(str(raised.value).splitlines()) == 1


# --- printers and templates -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", preset_names("printers"))
@pytest.mark.parametrize("nozzle_mm", [0.2, 0.4])
def test_printer_templates_know_both_nozzles(name: str, nozzle_mm: float) -> None:
    """Every printer that travels with the program has a line for its 0.2 and its 0.4 mm nozzle."""
    profile = printer_of(AskedPrinting(printer=name, nozzle=nozzle_mm))
    assert (profile.name, profile.nozzle_mm) == (name, nozzle_mm)
    assert nozzle_mm < profile.line_width_mm < 1.2 * nozzle_mm
    assert min(profile.bed_mm) >= 180


def test_nozzles_are_found_in_any_unit() -> None:
    """A nozzle given as 400um or 0.04cm is the 0.4 mm nozzle."""
    for nozzle in ("400um", "0.04cm", "0.0004m", 0.4):
        assert job_of({**ICO, "nozzle": nozzle}) == job_of(ICO)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (
            {"printer": "bambu-ps1"},
            "unknown printer template 'bambu-ps1'; there are .*bambu-p1s.*another printer needs --bed",
        ),
        ({"printer": "../bambu-p1s"}, "unknown printer template"),
        ({"printer": "none.toml"}, "none.toml.*no such file"),
        ({"printer": "a\nb.toml"}, "no such file"),
        ({"printer": "a\0b.toml"}, "no such file"),
        ({"nozzle": 0.3}, "nozzle 0.3mm: .* has 0.2mm, 0.4mm"),
        ({"line_width": 2}, "line width 2mm does not fit a 0.4mm nozzle; use 0.24mm to 1mm"),
        ({"layer_height": 0.4}, "layer height 0.4mm is too high for a 0.4mm nozzle; use at most 0.32mm"),
    ],
)
def test_unknown_printers_and_lines_are_refused(values: dict[str, RawValue], message: str) -> None:
    """The message suggests the nearest template, or what the printer has."""
    with pytest.raises(InputError, match=message) as raised:
        job_of({**ICO, **values})
    assert len(str(raised.value).splitlines()) == 1


@pytest.mark.parametrize("kind", get_args(PresetKind))
def test_what_is_no_template_is_told_with_those_that_there_are(kind: PresetKind, tmp_path: Path) -> None:
    """Of every kind: a name that is nearly one, a path of nothing, and a file that is no TOML."""
    name, other = preset_names(kind)[0], tmp_path / "notes.txt"
    other.write_text("mine")
    for wrong, said in ((f"{name}x", "unknown"), ("none.toml", "no such file"), (other, "is no TOML file")):
        with pytest.raises(InputError, match=rf"{said}.*\b{name}\b(?!x)") as raised:
            preset_or_file(kind, str(wrong))
        assert len(str(raised.value).splitlines()) == 1


def test_an_own_printer_file_is_read(tmp_path: Path) -> None:
    """A printer of one's own is a TOML file like the templates, and single values replace its values."""
    path = written(
        tmp_path,
        'title = "mine"\nbed = "100x120x140mm"\nnozzle = "0.6mm"\n'
        'nozzles = [{ diameter = "0.6mm", line_width = "0.65mm", layer_height = "0.3mm" }]\n',
    )
    job = job_of({"kind": "ico", "edge": "60mm", "printer": str(path), "layer_height": "0.2mm"})
    profile = job.printing.printer
    assert (profile.bed_mm, profile.nozzle_mm, profile.line_width_mm) == ((100.0, 120.0, 140.0), 0.6, 0.65)
    assert profile.layer_height_mm == 0.2
    path.write_text('title = "mine"\nbed = "100x120mm"\nnozzle = 1\nnozzles = []\n')
    with pytest.raises(InputError, match=r"my\.toml: bed '100x120mm'"):
        read_printer_file(path)


@pytest.mark.parametrize(
    ("name", "size", "build", "rings"),
    [
        ("master-ico", 133.0, "stickers", 720),
        ("matt-ico", 100.0, "one-piece", 720),
        ("shiny-ico", 106.5, "one-piece", 720),
        ("alu-board", (400.0, 400.0, 3.0), "sheet", 1521),
        ("3d-board", (220.0, 220.0, 5.0), "one-piece", 441),
    ],
)
def test_target_templates_are_the_papers(name: str, size: object, build: str, rings: int) -> None:
    """Each gives a target of the size in the facts with as many rings as that holds, and breaks no design rule."""
    job = job_of(read_spec_file(preset_or_file("targets", name)))
    spec, target = job.target, job.target.lay_out()
    assert size == (spec.edge_mm if spec.kind == "ico" else (*spec.size_mm, spec.thickness_mm))
    assert (job.printing.build, target.ring_count) == (build, rings)
    assert not check_printability(target, job.printing).violations
    assert name in preset_names("targets")


# --- writing --------------------------------------------------------------------------------------------------------


def test_idle_options_are_named_and_change_nothing() -> None:
    """An option that says nothing about a build is remarked upon, and the job is the same without it."""
    plain, idle = size_job(parse_spec(ICO, "")), size_job(parse_spec({**ICO, "sticker_thickness": "0.3mm"}, ""))
    assert idle.job == plain.job
    assert [remark for remark in idle.remarks if remark not in plain.remarks] == [
        "sticker_thickness: of no effect on the build 'one-piece'"
    ]


def test_what_parts_and_stickers_are_asked_for_is_idle_for_other_builds() -> None:
    """A jig and a mount are for tiles, a lip and a thickness for stickers."""
    for way in BUILDS.values():
        wanted = {name for name, is_used in (("jig", way.is_in_parts), ("mount", way.is_in_parts),
                  ("lip", way.has_stickers), ("sticker_thickness", way.has_stickers)) if not is_used}  # fmt: skip
        assert wanted <= {*way.idle}, way.name


def test_odd_printer_paths_are_written_as_toml(tmp_path: Path) -> None:
    """Quotes, backslashes and control characters in a printer file's path survive the written spec."""
    odd = tmp_path / 'a "b" \\ \t\x7f é\n.toml'
    odd.write_bytes(preset_or_file("printers", "bambu-p1s").read_bytes())
    job = job_of({**ICO, "printer": str(odd)})
    assert job_of(read_spec_file(written(tmp_path, spec_to_toml(job)))) == job


def test_printing_options_alone() -> None:
    """`design check` takes printing options without a target, and refuses a target's."""
    assert parse_printing({"nozzle": "0.2mm"}).nozzle == 0.2
    with pytest.raises(InputError, match="unknown key 'edge'"):
        parse_printing({"edge": "20mm"})
