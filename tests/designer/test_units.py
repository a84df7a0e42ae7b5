"""Quantities in text."""

import math

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from designer.base.units import MAX_LENGTH_MM, format_mm, parse_length_mm, parse_lengths_mm, parse_percent


@pytest.mark.parametrize(
    ("text", "length_mm"),
    [
        ("20mm", 20.0),
        ("2cm", 20.0),
        ("0.8in", 20.32),
        ('0.8"', 20.32),
        ("20MM", 20.0),
        ("2CM", 20.0),
        ("1 inch", 25.4),
        ("0.02m", 20.0),
        ("5um", 0.005),
        ("5µm", 0.005),  # micro sign
        ("5μm", 0.005),  # Greek mu
        ("4thou", 0.1016),
        ("4 mil", 0.1016),
        (" 20 mm ", 20.0),
        ("20", 20.0),
        (".5mm", 0.5),
        ("5.mm", 5.0),
        ("+1e1mm", 10.0),
        ("-0.05mm", -0.05),
        ("1e-05mm", 1e-05),
        (20, 20.0),
        (0.25, 0.25),
    ],
)
def test_lengths_are_read_in_their_unit(text: str | float, length_mm: float) -> None:
    """Millimetres, centimetres, metres, micrometres, inches and thousandths of an inch; a bare number is in mm."""
    assert parse_length_mm(text) == pytest.approx(length_mm, rel=1e-15)


NO_LENGTHS = {
    "nothing": ["", "mm", " "],
    "unknown unit": ["20 parsec", "20kg", "20deg", "20%", "20M", "20'", "20µ"],
    "expression": ["20mm2", "20mm*mm", "20m/m", "20$m", "20m#", "(20mm", "20mm x", "0x10", "1_000"],
    "several points": ["1.2.3mm", "2 0mm", "1-2mm", "--1mm"],
    "not finite": ["nan", "NaNmm", "inf", "-infinity mm", "1e999", math.nan, math.inf, 10**400, 16**6000],
    "too long": ["10001mm", "1e300m", "-11m", 20000],
    "another type": [True, False, None, [], {}],
}


@pytest.mark.parametrize("values", NO_LENGTHS.values(), ids=NO_LENGTHS)
def test_other_lengths_are_refused_in_one_line(values: list[object]) -> None:
    """Unknown units, expressions, numbers that are not finite or beyond 10 m, and other types raise ValueError."""
    for value in values:
        with pytest.raises(ValueError, match=r".") as raised:
            parse_length_mm(value)
        assert len(str(raised.value).splitlines()) == 1


@given(st.floats(-MAX_LENGTH_MM, MAX_LENGTH_MM))
@example(1e-300)
def test_lengths_read_back_exactly(length_mm: float) -> None:
    """What is written with its unit reads back to the same number, bit for bit."""
    assert parse_length_mm(format_mm(length_mm)) == length_mm


@given(st.lists(st.floats(0, MAX_LENGTH_MM), min_size=2, max_size=3))
def test_sizes_read_back_exactly(lengths_mm: list[float]) -> None:
    """Two and three lengths in a row, too."""
    assert parse_lengths_mm(format_mm(*lengths_mm), len(lengths_mm)) == tuple(lengths_mm)


@pytest.mark.parametrize(
    ("text", "lengths_mm"),
    [
        ("220x220mm", (220, 220)),
        ("22x21cm", (220, 210)),
        ("22cm x 210mm", (220, 210)),
        ("220 × 210", (220, 210)),
        ("220mmX210", (220, 210)),
        ("1x1in", (25.4, 25.4)),
    ],
)
def test_last_unit_holds_for_bare_numbers(text: str, lengths_mm: tuple[float, float]) -> None:
    """A unit at the end holds for the numbers before it that have none; x, X and × join."""
    assert parse_lengths_mm(text, 2) == pytest.approx(lengths_mm)


@pytest.mark.parametrize(
    "text", ["220", "220x", "x", "1x2x3mm", "220xnan", "2x2kg", "2*2mm", "", 220, None, ["1", "2"]]
)
def test_other_sizes_are_refused_in_one_line(text: object) -> None:
    """Another count, a part that is no length, or another type."""
    with pytest.raises(ValueError, match=r".") as raised:
        parse_lengths_mm(text, 2)
    assert len(str(raised.value).splitlines()) == 1


@pytest.mark.parametrize(("text", "percent"), [("0.4%", 0.4), ("0.4 %", 0.4), ("-1", -1), (0.5, 0.5), (2, 2)])
def test_percentages(text: str | float, percent: float) -> None:
    """With or without the sign."""
    assert parse_percent(text) == percent


@pytest.mark.parametrize("text", ["0.4mm", "%", "nan%", "1e999", True, None, "0.4%%", [1]])
def test_other_percentages_are_refused(text: object) -> None:
    """Lengths, nothing, and numbers that are not finite."""
    with pytest.raises(ValueError, match=r"."):
        parse_percent(text)


hostile = st.one_of(
    st.text(max_size=30),
    st.text("0123456789.eE+-xmcui n\t\n(){}[]'\"\\#$%&*/<>=!,;:@^~|_µ", max_size=30),
    st.builds(lambda number, unit: f"{number}{unit}", st.floats(), st.text(max_size=8)),
    st.integers(),
    st.floats(),
    st.booleans(),
    st.none(),
    st.lists(st.integers(), max_size=2),
)


@given(hostile)
@settings(max_examples=500, deadline=1000)
def test_any_text_gives_a_length_or_a_one_line_error(text: object) -> None:
    """No text makes anything but a finite length within the limit or a ValueError of one line."""
    for parse in (parse_length_mm, parse_percent, lambda value: parse_lengths_mm(value, 2)):
        try:
            value = parse(text)
        except ValueError as error:
            message = str(error)
        else:
            values = value if isinstance(value, tuple) else (value,)
            assert all(math.isfinite(v) for v in values)
            message = "fine"
        assert len(message.splitlines()) == 1


@pytest.mark.parametrize("text", ["1" + " " * 10**4 + "x1", "1" * 10**4 + "..", "1" + "m" * 10**4, "1x" * 10**4])
def test_long_text_is_refused_at_once(text: str) -> None:
    """Text of any length is refused, and no pattern takes for ever."""
    for parse in (parse_length_mm, parse_percent, lambda value: parse_lengths_mm(value, 2)):
        with pytest.raises(ValueError, match=r"."):
            parse(text)
