"""Error models in text: templates, files, overrides and quantities."""

import contextlib
import math
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from designer.base.errors import InputError
from designer.kinds.presets import preset_names
from designer.make.bed import printed_size_mm
from designer.spec.build import BUILDS
from designer.tolerance.effort import TargetSize, parse_effort, size_of
from designer.tolerance.error_file import error_model, parse_amount, parse_expansion
from designer.tolerance.source import KINDS, Amount, Kind, format_quantity
from designer.tolerance.sources import SOURCES
from tests.support.designs import small
from tests.support.perturbed_targets import MOTIONS

OF_UNIT = {"mm": "face_offset", "rad": "face_tilt", "1": "scale", "K": "thermal"}
GOOD = """
title = "mine"
material = "PLA"
expansion = {amount = "60ppm/K", source = "a table"}
layer_height = {amount = 0.2, source = "the slicer"}

[errors.face_tilt]
amount = "uniform 0.2deg"
source = "a measurement"

[errors.face_offset]
amount = 0.1
source = "assumption: none better"
"""


def written(folder: Path, content: str) -> str:
    path = folder / "mine.toml"
    path.write_text(content, encoding="utf-8")
    return str(path)


def refusal(name: str, *overrides: str) -> str:
    """The one line that bad input ends in."""
    with pytest.raises(InputError) as caught:
        error_model(name, overrides)
    line = str(caught.value)
    assert "\n" not in line
    return line


# --- templates --------------------------------------------------------------------------------------------------------


def test_the_ways_of_making_are_there() -> None:
    """Each way of making that the commands name is a template."""
    assert preset_names("errors") == [
        "fdm-board", "fdm-board-tiles", "fdm-board-two-sided", "fdm-dual", "fdm-dual-calibrated", "fdm-relief",
        "fdm-tiles", "hand-stickers", "laser-engraved", "lip-stickers", "machined", "pcb", "resin", "sheet-print",
        "sheet-two-sided", "sls", "uv-composite", "waterslide",
    ]  # fmt: skip


@pytest.mark.parametrize("name", preset_names("errors"))
def test_each_number_of_a_template_says_where_it_comes_from(name: str) -> None:
    """All numbers have a source: a publication, or an assumption with its reason; no web addresses."""
    model = error_model(name)
    assert model.name == name
    assert model.title
    notes = dict(model.notes)
    assert set(notes) - {"expansion", "layer_height", "price", "hours"} == set(model.sources)
    assert {"expansion", "price", "hours"} <= set(notes)
    for source, note in notes.items():
        assert len(note) > 25, source
        assert "http" not in note, source
        assert not note.startswith("assumption") or note.startswith("assumption: "), source
    assert all(amount.sigma > 0 for _, amount in model.amounts)
    assert 1e-5 < model.expansion_per_kelvin < 2e-4


def test_templates_keep_the_order_that_is_known_of_them() -> None:
    """Measuring the printer makes it better in every way; milling beats printing; stickers are worst by hand."""
    raw, tuned, milled, stuck = (
        error_model(n) for n in ("fdm-dual", "fdm-dual-calibrated", "machined", "hand-stickers")
    )
    for name in raw.sources:
        if name != "stair_steps":
            assert tuned.amount(name).sigma < raw.amount(name).sigma, name
            assert milled.amount(name).sigma <= raw.amount(name).sigma, name
    for name in ("face_shift", "face_rotation", "face_offset"):
        assert stuck.amount(name).sigma > raw.amount(name).sigma, name


def test_templates_say_nothing_that_has_no_effect() -> None:
    """Bodies have no warp, boards no errors of faces but of their pieces, what is not printed in layers no stairs."""
    bends = {"warp", "bow_twist"}
    for name in preset_names("errors"):
        model = error_model(name)
        used = set(model.sources)
        if set(model.suits) == {"plate"}:
            of_faces = {source for source in used if SOURCES[source].scope in ("face", "piece")}
            of_pieces = set(MOTIONS) if name == BUILDS["tiles"].errors["plate"] else set()
            assert of_faces == of_pieces, name
        elif "two-sided plate" in model.suits:  # a board whose back is put there by hand, or by other layers
            assert {"face_offset", "face_shift"} <= used, name
        assert bool(bends & used) == ("solid" not in model.suits), name
        assert ("stair_steps" in used) == (name in ("fdm-dual", "fdm-dual-calibrated", "resin", "sls")), name


@pytest.mark.parametrize(
    ("text", "expected"),
    [("12EUR", 12), ("1EUR + 2EUR/dm2", 9), ("3EUR/face+0.5EUR/cm3 + 2 EUR/cm", 12 + 50 + 6), ("0EUR", 0)],
)
def test_an_effort_grows_with_the_size(text: str, expected: float) -> None:
    """Each term counts as often as there is of what it is of."""
    assert parse_effort(text, "EUR").of(TargetSize(face=4, dm2=4, cm3=100, cm=3)) == pytest.approx(expected)


@pytest.mark.parametrize(
    "text", ["", "12", "12h", "-1EUR", "1EUR/mm", "1EUR + 2EUR", "1EUR/dm2/cm", "nanEUR", "1e9EUR"]
)
def test_an_effort_is_refused_with_an_example(text: str, tmp_path: Path) -> None:
    """Another unit, a term twice or no number: one line that shows how to write it."""
    said = refusal(written(tmp_path, f'{GOOD}\n[price]\namount = "{text}"\nsource = "a maker"'))
    assert "expected a sum such as 2EUR + 0.5EUR/dm2" in said
    assert "price" in said


def test_a_way_of_making_says_what_it_suits(tmp_path: Path) -> None:
    """A template is of some shapes; a file that does not say is of all."""
    solid, flat = small("ico").target, small("board").target
    assert error_model("sls").suits_target(solid)
    assert not error_model("sls").suits_target(flat)
    assert error_model("pcb").suits_target(flat)
    assert not error_model("pcb").suits_target(solid)
    assert all(error_model(written(tmp_path, GOOD)).suits_target(target) for target in (solid, flat))
    assert "suits" in refusal(written(tmp_path, 'suits = ["cup"]\n' + GOOD))


def test_the_size_of_a_target_is_that_of_its_mesh() -> None:
    """Area, volume and height from the faces' frames are those of the body as it is printed, and lies."""
    design = small("ico")
    size, mesh = size_of(design.target), design.part.body
    assert design.part.ink is not None
    assert size.cm3 == pytest.approx((mesh.volume_mm3 + design.part.ink.volume_mm3) / 1000, rel=1e-3)
    assert size.dm2 == pytest.approx(20 * math.sqrt(3) / 4 * 0.2**2, rel=1e-6)
    assert 10 * size.cm == pytest.approx(printed_size_mm(design.target, design.job.printing)[2], rel=1e-6)
    board = size_of(small("board").target)
    assert (board.face, board.dm2, board.cm3, board.cm) == pytest.approx((1, 0.36, 14.4, 0.4))


# --- files ------------------------------------------------------------------------------------------------------------


def test_a_file_is_read_with_its_units(tmp_path: Path) -> None:
    """Amounts, expansion and layer height come in radians, millimetres and per kelvin, with their notes."""
    model = error_model(written(tmp_path, GOOD))
    assert model.name == "mine"
    assert model.amounts == (
        ("face_tilt", Amount("uniform", math.radians(0.2))),
        ("face_offset", Amount("normal", 0.1)),
    )
    assert model.expansion_per_kelvin == pytest.approx(60e-6)
    assert model.layer_height_mm == 0.2
    assert dict(model.notes)["layer_height"] == "the slicer"
    assert model.amount("scale") == Amount("normal", 0.0)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("material", "materail", ["unknown key 'materail'", "did you mean 'material'?"]),
        ('material = "PLA"', "", ["material is missing"]),
        ("errors.face_tilt", "face_tilt", ["unknown key 'face_tilt'", "[errors.face_tilt]"]),
        ('source = "a measurement"', 'origin = "me"', ["unknown key 'errors.face_tilt.origin'", "amount, source"]),
        ('source = "a measurement"', "", ["errors.face_tilt.source is missing", "assumption: "]),
        ('source = "a measurement"', 'source = ""', ["errors.face_tilt.source ''", "must not be empty"]),
        ("uniform 0.2deg", "uniform 0.2mm", ["face_tilt 'uniform 0.2mm'", "unit 'mm'", "0.1deg"]),
        ("amount = 0.1", "amount = true", ["errors.face_offset.amount True", "must be a quantity"]),
        ("amount = 0.1", "amount = nan", ["face_offset 'nan'", "not a finite number"]),
        ("60ppm/K", "60ppm", ["expansion '60ppm'", "68e-6/K"]),
        ("60ppm/K", "0/K", ["expansion '0/K'", "more than zero"]),
        ("amount = 0.2,", 'amount = "-0.2mm",', ["layer_height '-0.2mm'", "more than zero"]),
        (GOOD, GOOD + "face_bow = 3", ["errors.face_offset.face_bow", "amount, source"]),
        (GOOD, "errors = 3\n" + GOOD.partition("[errors")[0], ["errors 3", "with keys"]),
    ],
)
def test_a_mistake_in_a_file_is_told_with_its_remedy(tmp_path: Path, old: str, new: str, words: list[str]) -> None:
    """Misspelt keys and sources, wrong units and numbers that cannot be: one line that names the file."""
    path = written(tmp_path, GOOD.replace(old, new))
    line = refusal(path)
    assert line.startswith(f"{path}: ")
    for word in words:
        assert word in line


def test_an_effect_needs_what_it_comes_from(tmp_path: Path) -> None:
    """Layers without a height and warmth without an expansion would do nothing in silence: they are refused."""
    bare = "\n".join(line for line in GOOD.splitlines() if not line.startswith(("expansion", "layer_height")))
    path = written(tmp_path, bare)
    assert error_model(path).layer_height_mm == 0
    assert "[layer_height]" in refusal(path, "stair_steps=25%")
    assert "[expansion]" in refusal(path, "thermal=3K")
    assert error_model(path, ["thermal=0K"]).amount("thermal").sigma == 0


# --- overrides --------------------------------------------------------------------------------------------------------


def test_an_override_replaces_one_amount() -> None:
    """`SOURCE=AMOUNT` changes one source or adds it, in its place, and its note says so; the last one counts."""
    plain = error_model("fdm-dual")
    model = error_model("fdm-dual", ["face_tilt=0.3deg", "warp = uniform 0.2mm", "face_tilt=fixed -0.05deg"])
    assert model.amount("face_tilt") == Amount("fixed", math.radians(-0.05))
    assert model.amount("warp") == Amount("uniform", 0.2)
    assert dict(model.notes)["face_tilt"] == "given by hand"
    assert model.sources == (*plain.sources, "warp")
    for name in set(plain.sources) - {"face_tilt"}:
        assert model.amount(name) == plain.amount(name), name
        assert dict(model.notes)[name] == dict(plain.notes)[name], name


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("face_tilt", ["'face_tilt'", "SOURCE=AMOUNT"]),
        ("face_tlit=1deg", ["unknown error source 'face_tlit'; did you mean 'face_tilt'?"]),
        ("face_tilt=0.1mm", ["face_tilt '0.1mm'", "'mm'", "0.1deg"]),
        ("face_offset=0.1deg", ["face_offset '0.1deg'", "unit of length 'deg'", "mm"]),
        ("scale=0.1mm", ["scale '0.1mm'", "percentage", "0.4%"]),
        ("thermal=3mm", ["thermal '3mm'", "'mm'", "5K"]),
        ("skew=-1deg", ["skew '-1deg'", "must not be negative", "fixed"]),
        ("skew=nan", ["skew 'nan'", "not a finite number"]),
        ("skew=1e300deg", ["skew '1e300deg'", "too large"]),
        ("skew=gaussian 1deg", ["unknown distribution 'gaussian'", "normal, uniform, fixed"]),
        ("ring_jitter=1e9mm", ["ring_jitter", "more than 10000mm"]),
        ("face_tilt=" + "9" * 5000, ["face_tilt '999", "expected an angle"]),
    ],
)
def test_a_bad_override_is_one_line(override: str, words: list[str]) -> None:
    """An unknown source, a wrong dimension, a negative spread, what is no number: value, rule and remedy."""
    line = refusal("fdm-dual", override)
    assert len(line) < 300
    for word in words:
        assert word in line


@settings(max_examples=60, deadline=None)
@given(text=st.text(max_size=30))
def test_no_text_breaks_the_reader(text: str) -> None:
    """Any text is an amount or ends in the one exception for bad input."""
    for name in OF_UNIT.values():
        with contextlib.suppress(InputError):
            assert math.isfinite(parse_amount(text, SOURCES[name]).sigma)


@settings(max_examples=60, deadline=None)
@given(kind=st.sampled_from(KINDS), size=st.floats(0, 0.9), unit=st.sampled_from(sorted(OF_UNIT)))
def test_amounts_read_back(kind: Kind, size: float, unit: str) -> None:
    """What is printed of an amount reads back to it, to six digits."""
    source = SOURCES[OF_UNIT[unit]]
    again = parse_amount(f"{kind} {format_quantity(size, source.unit)}", source)
    assert again.kind == kind
    assert again.size == pytest.approx(size, rel=1e-5, abs=1e-12)


def test_quantities_are_read_in_their_units() -> None:
    """Units of one dimension agree; bare numbers are millimetres, degrees, percent and kelvin."""
    for name, texts, size in (
        ("face_tilt", ("0.1deg", "0.1", "0.1°", "normal 0.1 deg", "NORMAL 0.1deg"), math.radians(0.1)),
        ("face_tilt", ("2mrad", "0.002rad"), 0.002),
        ("face_offset", ("0.2", "0.2mm", "200um", "0.02cm"), 0.2),
        ("scale", ("0.3", "0.3%", "3e-1 %"), 0.003),
        ("thermal", ("5", "5K", "5°C", "5 degC"), 5.0),
    ):
        for text in texts:
            assert parse_amount(text, SOURCES[name]).size == pytest.approx(size, rel=1e-12), text
            assert parse_amount(text, SOURCES[name]).kind == "normal", text
    for text in ("68e-6/K", "68e-6", "68ppm/K", "68um/m/K"):
        assert parse_expansion(text) == pytest.approx(68e-6), text
