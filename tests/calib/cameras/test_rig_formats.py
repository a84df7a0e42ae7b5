"""What holds for every rig-file format."""

from pathlib import Path

import numpy as np
import pytest

from calib.cameras.formats import RIG_FORMATS
from calib.cameras.formats.reading import open_rig, recognise_rig, rig_format_of
from calib.cameras.rig import Rig
from calib.core.se3 import compose, invert, transform
from designer.base.errors import InputError
from tests.support.foreign_rigs import held_by, points_before, read_texts, rig_texts, ring, seen_by, stereo, write_texts

FOLDERS = [name for name in RIG_FORMATS if RIG_FORMATS[name].is_folder]


def rig_for(name: str) -> Rig:
    """A rig that a format holds, of as many cameras as it may have, whose frame is no camera's."""
    return ring() if RIG_FORMATS[name].most > 2 else ring(ring().cameras[:1] * 2)


@pytest.mark.parametrize("name", RIG_FORMATS)
def test_a_point_is_seen_where_it_was(name: str) -> None:
    """A rig that was written and read sees every point in its old pixels, whatever units and chains lie between."""
    rig, _ = held_by(name, rig_for(name))
    back = read_texts(name, rig_texts(name, rig))
    point = points_before(rig)
    if not RIG_FORMATS[name].keeps_frame:
        point = transform(compose(invert(back.cam_from_rig[0]), rig.cam_from_rig[0]), point)
    assert [camera.image_size for camera in back.cameras] == [camera.image_size for camera in rig.cameras]
    for new, old in zip(seen_by(back, point), seen_by(rig, points_before(rig)), strict=True):
        assert np.abs(new - old).max() < 1e-8


@pytest.mark.parametrize("name", [name for name in RIG_FORMATS if not RIG_FORMATS[name].has_own_unit])
def test_a_unit_that_is_written_is_read(name: str) -> None:
    """Files of tools that know no unit say it, so that metres are not taken for millimetres, and must not be told."""
    rig = rig_for(name)
    distance = np.linalg.norm(np.diff(rig.center_mm[:2], axis=0))
    for unit in ("m", "mm"):
        back = read_texts(name, rig_texts(name, rig, unit), "mm")
        assert np.linalg.norm(np.diff(back.center_mm[:2], axis=0)) == pytest.approx(distance, rel=1e-12)


@pytest.mark.parametrize("name", RIG_FORMATS)
def test_a_rig_file_is_known_by_its_content(name: str, tmp_path: Path) -> None:
    """A file, or the folder of several, is taken for its format and for no other."""
    texts = rig_texts(name, rig_for(name))
    place = write_texts(texts, tmp_path) if name in FOLDERS else tmp_path / "x"
    if name not in FOLDERS:
        place.write_text(*texts.values())
        assert recognise_rig(place.read_text()) is RIG_FORMATS[name]
    found = rig_format_of(place)
    assert found is not None
    assert found.name == name
    assert open_rig(place).read.rig.cam_from_rig.shape == rig_for(name).cam_from_rig.shape


@pytest.mark.parametrize("name", RIG_FORMATS)
def test_names_stay_within_the_folder(name: str) -> None:
    """Whatever cameras are called, files lie in the folder under plain names."""
    rig = stereo()
    strange = Rig(("../../etc/passwd", 'a"]\n[x'), rig.cameras, rig.cam_from_rig)
    for place, text in rig_texts(name, strange).items():
        assert "/" not in place
        assert ".." not in place
        assert name == "json" or ("../etc" not in text and "[x" not in text)


@pytest.mark.parametrize("name", [name for name in RIG_FORMATS if name != "json"])
def test_the_docs_say_what_a_rig_format_holds(name: str) -> None:
    """Each format has its row in the table of docs/calibrate.md."""
    page = (Path(__file__).parents[3] / "docs/calibrate.md").read_text()
    assert any(line.startswith(f"| `{name}` {RIG_FORMATS[name].title} |") for line in page.splitlines())


@pytest.mark.parametrize("name", [name for name in RIG_FORMATS if name != "json"])
@pytest.mark.parametrize("wrong", ["nan", "1e400", "x", "9e99", "[[1]]", ""])
def test_a_wrong_number_is_one_line(name: str, wrong: str) -> None:
    """A pose, a focal length or a size that is none is refused in a line that names the file."""
    texts = rig_texts(name, rig_for(name))
    for focal in ("620.0", "1024"):
        changed = {place: text.replace(focal, wrong) for place, text in texts.items()}
        assert changed != texts
        with pytest.raises(InputError) as caught:
            read_texts(name, changed)
        message = str(caught.value)
        assert message.startswith("f.x")
        assert len(message.splitlines()) == 1
        assert len(message) < 300
