"""A solved rig in a folder: read as it was, and refused where it is another's."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib.app.inputs import load_rig
from calib.judge.rig_folder import CAMERAS, RIG_CALIBRATION_FILE, RIG_FILE, folder_names, read_rig, write_rig
from calib.observe.calibration_file import Provenance, read_calibration
from designer.base.errors import InputError
from tests.laws.test_file_kinds import same
from tests.support.rig_views import solved_slowly, stereo_pair

PROVENANCE = Provenance("test 1")


def test_a_rig_is_read_as_it_was_written(tmp_path: Path) -> None:
    """Sightings, poses, covariances and noise come back to the last bit, and `rig.json` is the same rig."""
    found = solved_slowly(stereo_pair(frames=5))
    found = replace(found, capture_covariance=found.covariance / 3, photo_covariance=found.covariance / 7)
    write_rig(tmp_path, found, PROVENANCE)
    again, provenance = read_rig(tmp_path)
    assert same(again, found)
    assert same(provenance, PROVENANCE)
    assert same(load_rig(tmp_path / RIG_FILE).covariance, found.rig.covariance)


def test_a_camera_of_a_rig_is_a_calibration(tmp_path: Path) -> None:
    """A camera's folder reads by itself: its poses are those of the frames it saw, seen from it."""
    found = solved_slowly(stereo_pair(frames=5))
    write_rig(tmp_path, found, PROVENANCE)
    alone = read_calibration(tmp_path / CAMERAS / "right" / "calibration.json")[0]
    assert np.allclose(
        alone.cam_from_target, found.cam_from_rig[1] @ found.rig_from_target[found.observations.frame[1]]
    )
    assert np.array_equal(alone.param_covariance, found.covariance[15:24, 15:24])


def test_folders_stay_inside_whatever_cameras_are_called() -> None:
    """No name leads upwards or twice to one folder, also where letters of both sizes are one."""
    names = folder_names(("../up", "a/b", "Left", "left", "camera_0", "..", "con.", "x" * 90))
    assert all("/" not in name and not name.startswith(".") for name in names)
    assert len({name.lower() for name in names}) == len(names)
    assert names[2] == "Left"


def test_files_of_another_solution_are_refused(tmp_path: Path) -> None:
    """A camera that was solved again by itself no longer belongs to the rig, and a path upwards is none."""
    write_rig(tmp_path, solved_slowly(stereo_pair(frames=5)), PROVENANCE)
    write_rig(tmp_path / "b", solved_slowly(stereo_pair(frames=5, seed=1)), PROVENANCE)
    own, other = (place / CAMERAS / "left" for place in (tmp_path, tmp_path / "b"))
    for name in ("calibration.json", "observations.csv"):
        (own / name).write_bytes((other / name).read_bytes())
    with pytest.raises(InputError, match=r"does not belong to .*; solve the rig again"):
        read_rig(tmp_path)
    path = tmp_path / RIG_CALIBRATION_FILE
    document = json.loads(path.read_text())
    document["cameras"][0]["folder"] = "../b/cameras/left"
    path.write_text(json.dumps(document))
    with pytest.raises(InputError, match=r"must be a plain name"):
        read_rig(tmp_path)
