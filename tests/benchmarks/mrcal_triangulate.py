"""Runs mrcal for `bench_budget`, in the Python that mrcal is installed for: `mrcal_triangulate.py IN.npz OUT.npz`.

Solves a stereo pair from a given start, LENSMODEL_OPENCV5 without regularisation, and propagates the noise of the
calibration and of the sightings to points, in the coordinates of the first camera.
"""

import sys
import time

import mrcal
import numpy as np

data = np.load(sys.argv[1])
solved = {
    "intrinsics": data["intrinsics"].copy(), "extrinsics_rt_fromref": data["extrinsics"].copy(),
    "frames_rt_toref": data["frames"].copy(), "points": None, "observations_board": data["observations"].copy(),
    "indices_frame_camintrinsics_camextrinsics": data["indices"].astype(np.int32), "observations_point": None,
    "indices_point_camintrinsics_camextrinsics": None, "lensmodel": "LENSMODEL_OPENCV5",
    "imagersizes": data["image_sizes"].astype(np.int32), "calobject_warp": None,
    "do_optimize_intrinsics_core": True, "do_optimize_intrinsics_distortions": True, "do_optimize_extrinsics": True,
    "do_optimize_frames": True, "do_optimize_calobject_warp": False,
    "calibration_object_spacing": float(data["spacing_mm"]), "do_apply_outlier_rejection": False,
    "do_apply_regularization": False, "verbose": False,
}  # fmt: skip
mrcal.optimize(**solved)
models = [mrcal.cameramodel(optimization_inputs=solved, icam_intrinsics=camera) for camera in (0, 1)]
noise = float(data["noise_px"])
begin = time.perf_counter()
found = [
    mrcal.triangulate(
        pixels, models, q_calibration_stdev=noise, q_observation_stdev=noise, method=mrcal.triangulate_geometric,
        stabilize_coords=False,
    )
    for pixels in data["pixels"]
]  # fmt: skip
seconds = time.perf_counter() - begin
position, calibration, observation = (np.array([one[part] for one in found]) for part in range(3))
np.savez(sys.argv[2], position=position, calibration=calibration, observation=observation, seconds=seconds)
