"""Runs mrcal for `bench_rig_peers`, in the Python that mrcal is installed for: `mrcal_pair.py IN.npz OUT.json`.

The steps are those of the tool mrcal-calibrate-cameras (2.2): a stereographic seed from a given focal length, geometry
alone, geometry and core, then everything with LENSMODEL_OPENCV5 and its default regularisation. Rejection of outliers,
of which there are none, is off. Reading, importing and writing are not timed.
"""

import json
import sys
import time

import mrcal
import numpy as np

data = np.load(sys.argv[1])
observations, sizes = (
    data["observations"],
    np.repeat(data["image_size"][None], 2, axis=0),
)  # (V * 2, H, W, 3) u v weight
count = len(observations) // 2
frames = np.column_stack([np.repeat(np.arange(count), 2), np.tile([0, 1], count)]).astype(np.int32)
cameras = np.column_stack([frames, frames[:, 1] - 1]).astype(np.int32)

begin = time.perf_counter()
intrinsics, extrinsics, poses = mrcal.seed_stereographic(
    imagersizes=sizes, focal_estimate=float(data["focal_px"]), indices_frame_camera=frames, observations=observations,
    object_spacing=float(data["spacing_mm"]),
)  # fmt: skip
for lens, core, everything in (
    ("LENSMODEL_STEREOGRAPHIC", False, False),
    ("LENSMODEL_STEREOGRAPHIC", True, False),
    ("LENSMODEL_OPENCV5", True, True),
):
    if everything:
        start = 1e-6 * np.random.default_rng(0).uniform(-1, 1, (2, 5))
        intrinsics = np.concatenate([intrinsics, start], axis=1)
    mrcal.optimize(
        intrinsics, extrinsics, poses, None, observations, cameras, None, None, lens, imagersizes=sizes,
        do_optimize_intrinsics_core=core, do_optimize_intrinsics_distortions=everything,
        do_optimize_calobject_warp=False, calibration_object_spacing=float(data["spacing_mm"]),
        do_apply_outlier_rejection=False, do_apply_regularization=everything, verbose=False,
    )  # fmt: skip
seconds = time.perf_counter() - begin
with open(sys.argv[2], "w", encoding="utf-8") as file:
    json.dump({"seconds": seconds, "rt_cam_ref": extrinsics[0].tolist()}, file)
