"""One camera of a solved rig, as a calibration of its own: what is evaluated, judged and kept of single cameras."""

import numpy as np

from calib.cameras import parameter_names
from calib.rigs.result import RigCalibration
from calib.solver.calibration import Calibration


def camera_alone(found: RigCalibration, camera: int) -> Calibration:
    """A camera with its views: `calib.evaluate(camera_alone(found, 0))`.

    Its poses are those of the joint solution. Their covariances are known of the camera whose frame the rig's is; of
    others they would need those between camera and frame, and are nan.
    """
    rig, one = found.rig, found.cameras[camera]
    frames, views = found.observations.frame[camera], found.observations.sightings[camera].view_count
    rows = rig.params_rows(camera)
    return Calibration(
        camera=one,
        observations=found.observations.sightings[camera],
        cam_from_target=found.cam_from_rig[camera] @ found.rig_from_target[frames],
        residual_px=found.residual_px[camera],
        is_outlier=found.is_outlier[camera],
        scale=float(found.scale[camera]),
        param_covariance=found.stated_covariance[rows, rows],
        pose_covariance=found.frame_covariance[frames] if camera == found.reference else np.full((views, 6, 6), np.nan),
        fixed=() if found.is_refined[camera] else parameter_names(one.model),
        weighted=found.weighted,
        status=found.status,
        remarks=(),
        iterations=found.iterations,
        seconds=found.seconds,
    )
