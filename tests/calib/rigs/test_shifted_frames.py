"""Photos of one camera that are counted from another frame on than those of the others."""

from dataclasses import replace

import pytest

from calib.core.types import RigObservations, keep_views
from calib.rigs.problem import CameraChoice
from calib.rigs.solve import solve_rig
from designer.base.errors import InputError
from tests.support import rig_views


def _shifted(observations: RigObservations, camera: int, by: int) -> RigObservations:
    """One camera's photos in other frames than they were taken in."""
    frame = observations.frame[camera]
    kept = (frame - by >= 0) & (frame - by < observations.frame_count)
    sightings, frames = list(observations.sightings), list(observations.frame)
    sightings[camera], frames[camera] = keep_views(sightings[camera], kept), frame[kept] - by
    return replace(observations, sightings=tuple(sightings), frame=tuple(frames))


@pytest.mark.parametrize(("scene", "camera", "by"), [(rig_views.stereo_pair(), 1, 3), (rig_views.ring(), 0, -2)])
def test_frames_that_are_shifted_are_named_with_the_shift(scene: rig_views.RigScene, camera: int, by: int) -> None:
    """A list that lacks its first three photos is told by what fits; of many cameras the odd one, be it the first."""
    known = [CameraChoice(one.model, given=one, is_refined=False) for one in scene.cameras]
    name, frame = scene.observations.camera_names[camera], max(-by, 0)
    pair = f"in frame{frame:03d} the others show in frame{frame + by:03d}"
    with pytest.raises(InputError, match=f"camera {name}: its frames fit if shifted by {by}: .* {pair}"):
        solve_rig(_shifted(scene.observations, camera, by), known)
