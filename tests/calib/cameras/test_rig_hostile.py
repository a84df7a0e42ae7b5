"""Broken and hostile rig files: one clear line, at once, and never anything else."""

from contextlib import suppress
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from calib.cameras.formats import RIG_FORMATS
from calib.cameras.formats.json import covariance_fault
from calib.cameras.formats.reading import open_rig
from designer.base.errors import InputError
from tests.support.foreign_rigs import BROWN, read_texts, rig_texts, stereo

TOML = ("anipose", "caliscope")


@cache
def texts_of(name: str) -> dict[str, str]:
    """The files of a pair."""
    return rig_texts(name, stereo(BROWN))


@pytest.mark.parametrize("name", RIG_FORMATS)
@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(data=st.data())
def test_damaged_files_are_read_or_refused(name: str, data: st.DataObject) -> None:
    """Files with some characters lost, doubled or changed give a rig or an InputError, nothing else."""
    texts = dict(texts_of(name))
    place = data.draw(st.sampled_from(sorted(texts)))
    text = texts[place]
    for _ in range(data.draw(st.integers(1, 4))):
        start = data.draw(st.integers(0, len(text)))
        end = data.draw(st.integers(start, min(len(text), start + 30)))
        text = text[:start] + data.draw(st.text("0.-e[]{}<>:,'\"!&*#\n\t x\x00é\U0001f600", max_size=8)) + text[end:]
    with suppress(InputError):
        assert len(read_texts(name, {**texts, place: text}).names) in (1, 2)


@pytest.mark.parametrize("name", RIG_FORMATS)
@pytest.mark.parametrize(
    "bomb",
    ["", "3", "[" * 50_000, "{" * 50_000, "a = " + "[" * 50_000, "a" * 100_000, "[cameras.0]\n[cam_0]\nmatrix = 3\n"],
)
def test_bombs_are_refused_at_once(name: str, bomb: str) -> None:
    """Nested, endless and empty content ends in one short line that names the file."""
    with pytest.raises(InputError) as caught:
        read_texts(name, dict.fromkeys(texts_of(name), bomb))
    message = str(caught.value)
    assert message.startswith("f.x")
    assert len(message.splitlines()) == 1
    assert len(message) < 300


@pytest.mark.parametrize(
    ("name", "change", "rule"),
    [
        ("kalibr", ("T_cn_cnm1", "T_other"), "cam1 has no T_cn_cnm1, so where it stands is not known"),
        ("kalibr", ("cam1:", "cam2:"), "must hold cam0, cam1, ... without a gap"),
        ("kalibr", ("[0.0, 0.0, 0.0, 1.0]", "[0.0, 0.0, 0.0, 2.0]"), "must end with the row 0 0 0 1"),
        ("opencv", ("0.9980008165332894", "-0.9980008165332894"), "R: has no rotation in it|R: mirrors"),
        ("opencv", ("T: ", "V: "), "T is missing; if it stands in another file, such as extrinsics"),
        ("colmap", ('"cam_from_rig_rotation": [', '"cam_from_rig_rotation": [9, '), "has 5 numbers; it must have 4"),
        ("colmap", ('"image_prefix": "right/"', '"image_prefix": "left/"'), "two cameras are named 'left'"),
        ("anipose", ('name = "right"', 'name = "left"'), "two cameras are named 'left'"),
        ("anipose", ("rotation = [", "rotation = [400.0, "), "rotation has 4 numbers; it must have 3"),
        (
            "caliscope",
            ("translation = [", "translation = [1e9, 0.0, 0.0] #"),
            "is 1e[+]09 m away: must be at most 10000 m",
        ),
        ("mrcal", ("'extrinsics': [ ", "'extrinsics': [ 900., "), "has 7 numbers; it must have 6"),
    ],
)
def test_what_is_wrong_is_said(name: str, change: tuple[str, str], rule: str) -> None:
    """The place, the rule, and what to do."""
    texts = {place: text.replace(*change) for place, text in texts_of(name).items()}
    assert texts != texts_of(name)
    with pytest.raises(InputError, match=rule):
        read_texts(name, texts)


def test_a_transform_that_mirrors_is_named_as_such() -> None:
    """A left-handed matrix is the classical mistake of programs whose y points up."""
    text = next(iter(texts_of("kalibr").values()))
    row = next(line for line in text.splitlines() if line.startswith("  - [0.99"))
    turned = "  - [" + ", ".join(str(-float(one)) for one in row.strip(" -[]").split(",")) + "]"
    with pytest.raises(InputError, match="T_cn_cnm1: mirrors; its determinant is -1"):
        read_texts("kalibr", {"camchain.yaml": text.replace(row, turned)})


@pytest.mark.parametrize(
    ("row", "column", "value", "rule"),
    [
        (3, 3, -1.0, "has a variance of -1; it must be 0 or more"),
        (3, 3, 1e300, "has a variance of 1e[+]300; it must be 1e[+]100 or less"),
        (0, 5, 0.5, "is not symmetric"),
    ],
)
def test_a_covariance_that_is_none_is_refused(row: int, column: int, value: float, rule: str, tmp_path: Path) -> None:
    """No budget and no sigma comes of a rig.json that somebody's program has spoilt."""
    rig = stereo(BROWN)
    covariance = np.eye(rig.first_row[-1])
    replace(rig, covariance=covariance).save(tmp_path / "rig.json")
    assert open_rig(tmp_path / "rig.json").read.rig.covariance is not None
    covariance[row, column] = value
    replace(rig, covariance=covariance).save(tmp_path / "rig.json")
    with pytest.raises(InputError, match=rf"rig\.json: covariance {rule}; solve the rig again"):
        open_rig(tmp_path / "rig.json")


def test_correlations_beyond_one_are_refused() -> None:
    """Symmetric, and still no covariance; one of fixed and of equal unknowns is one."""
    assert covariance_fault(np.array([[1.0, 1.5], [1.5, 1.0]])) == "has a correlation beyond 1"
    assert covariance_fault(np.array([[1.0, 1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, 0.0]])) is None


def test_a_mirrored_pose_is_named_in_our_file() -> None:
    """As in files of other tools."""
    poses = np.array(stereo(BROWN).cam_from_rig)
    poses[1, 0, :3] *= -1
    with pytest.raises(InputError, match="has no rotation in it but a mirror: one of its axes is reversed"):
        replace(stereo(BROWN), cam_from_rig=poses)


def test_ignored_and_unplaced_cameras_are_left_out() -> None:
    """Caliscope's own words for them."""
    text = next(iter(texts_of("caliscope").values()))
    assert read_texts("caliscope", {"c": text.replace("ignore = false", "ignore = true", 1)}).names == ("1",)
    assert read_texts("caliscope", {"c": text.replace("rotation = ", "turned = ", 1)}).names == ("1",)


def test_folders_that_are_no_rig(tmp_path: Path) -> None:
    """An empty folder, one with a single model, and one with thousands: a line each."""
    with pytest.raises(InputError, match=r"not a rig file of a known kind; there are rig\.json, .*Kalibr camchain"):
        open_rig(tmp_path)
    with pytest.raises(InputError, match="no file of mrcal camera models; it has"):
        open_rig(tmp_path, "mrcal")
    for number in range(300):
        (tmp_path / f"{number}.cameramodel").touch()
    with pytest.raises(InputError, match="300 files of mrcal camera models; a rig has at most 256 cameras"):
        open_rig(tmp_path)
    with suppress(InputError):
        open_rig(Path("/dev/zero"))
