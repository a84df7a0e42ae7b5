"""The limits, as templates and as a person's own file."""

from pathlib import Path

import pytest

from calib.judge.criteria import read_criteria
from calib.judge.verdict import Criteria, Limits
from designer.base.errors import InputError
from designer.kinds.presets import preset_names


def _limits(criteria: Criteria) -> dict[str, Limits]:
    return dict(criteria.limits)


def test_templates_have_a_reason_for_each_number() -> None:
    """All templates read, and each limit says where it comes from."""
    assert preset_names("criteria") == ["metrology", "robotics", "standard"]
    for name in preset_names("criteria"):
        criteria = read_criteria(name)
        assert criteria.name == name
        assert all(len(limits.source) > 10 for limits in _limits(criteria).values())


def test_the_standard_limits_are_those_promised() -> None:
    """95 % of the image to 0.1 px by two standard deviations, 70 % covered, halves within 2 sigma."""
    criteria = read_criteria()
    assert 2 * criteria["uncertainty"].good == 0.1
    assert criteria["coverage"].good == 70
    assert criteria["halves"].good == 2


def test_metrology_is_stricter_and_robotics_is_not() -> None:
    """No limit of metrology is wider than that of standard, none of robotics narrower."""
    strict, standard, wide = (_limits(read_criteria(name)) for name in ("metrology", "standard", "robotics"))
    for name, middle in standard.items():
        sign = -1 if name == "coverage" else 1
        for one in ("good", "usable"):
            low, mid, high = (sign * getattr(limits, one) for limits in (strict[name], middle, wide[name]))
            assert low <= mid <= high, (name, one)


def _own(folder: Path, text: str) -> str:
    path = folder / "own.toml"
    path.write_text(text)
    return str(path)


def test_an_own_file_holds_what_differs(tmp_path: Path) -> None:
    """What a person's file leaves out is as in the standard; units may be written or left out."""
    text = 'title = "ours"\n[coverage]\ngood = 80\nusable = "60 %"\n[halves]\ngood = "1.5 sigma"\nusable = "3sigma"\n'
    own, standard = read_criteria(_own(tmp_path, text)), read_criteria()
    assert (own.title, own.name) == ("ours", "own")
    assert own["coverage"] == Limits(80, 60, "")
    assert own["halves"] == Limits(1.5, 3, "")
    assert own["uncertainty"] == standard["uncertainty"]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[coverag]\ngood = 1\nusable = 0\n", "did you mean"),
        ("[coverage]\ngod = 1\nusable = 0\n", "did you mean"),
        ("[coverage]\ngood = 80\n", "coverage.usable is missing"),
        ("[coverage]\ngood = 40\nusable = 60\n", "must not be less than usable"),
        ("[uncertainty]\ngood = 0.4\nusable = 0.3\n", "must not be more than usable"),
        ('[uncertainty]\ngood = "0.1%"\nusable = "0.3px"\n', "must be a number of px"),
        ('[uncertainty]\ngood = "a lot"\nusable = 1\n', "must be a number of px"),
        ("[uncertainty]\ngood = -1\nusable = 1\n", "must be from 0 to 1000px"),
        ("[uncertainty]\ngood = nan\nusable = 1\n", "must be from 0"),
        ("[uncertainty]\ngood = true\nusable = 1\n", "must be from 0"),
        ("[outliers]\ngood = 1\nusable = 101\n", "must be from 0 to 100%"),
        ("uncertainty = 3\n", "uncertainty"),
        ('title = ""\n', "title"),
        ("[coverage\n", "not valid TOML"),
    ],
)
def test_faults_are_one_line(tmp_path: Path, text: str, said: str) -> None:
    """A fault in a file is told in one line with the file, the key and the rule."""
    with pytest.raises(InputError) as caught:
        read_criteria(_own(tmp_path, text))
    message = str(caught.value)
    assert "own.toml" in message
    assert said in message
    assert "\n" not in message
    assert "pydantic" not in message


def test_an_unknown_template_names_the_nearest() -> None:
    """A misspelt template is answered with the right one."""
    with pytest.raises(InputError, match="metrology"):
        read_criteria("metrolgy")
    with pytest.raises(InputError, match="no such file"):
        read_criteria("nowhere.toml")
