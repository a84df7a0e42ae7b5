"""Runs mrcal for `bench_solve`, in the Python that mrcal is installed for: `mrcal_solve.py IN.npz OUT.json`.

The steps are those of the tool mrcal-calibrate-cameras (2.2): a stereographic seed from a given focal length, the
geometry alone, geometry and core, then everything with LENSMODEL_OPENCV5 and its default regularisation. Rejection of
outliers, of which there are none, is off: it would only add time. Reading, importing and writing are not timed.
"""

import json
import sys
import time

import mrcal
import numpy as np

from designer.base.arrays import Array

data = np.load(sys.argv[1])
observations, size = data["observations"], data["image_size"]  # (V, H, W, 3) u v weight; (2,)
spacing, focal = float(data["spacing_mm"]), float(data["focal_px"])
frames = np.column_stack([np.arange(len(observations)), np.zeros(len(observations))]).astype(np.int32)
cameras = np.column_stack([frames, np.full(len(frames), -1)]).astype(np.int32)


def descend(
    lens: str, intrinsics: Array, extrinsics: Array, poses: Array, *, core: bool, everything: bool
) -> dict[str, Array]:
    """One call of the solver, which changes its arguments in place."""
    stats: dict[str, Array] = mrcal.optimize(
        intrinsics, extrinsics, poses, None, observations, cameras, None, None, lens, imagersizes=size[None],
        do_optimize_intrinsics_core=core, do_optimize_intrinsics_distortions=everything,
        do_optimize_calobject_warp=False, calibration_object_spacing=spacing, do_apply_outlier_rejection=False,
        do_apply_regularization=everything, verbose=False,
    )  # fmt: skip
    return stats


begin = time.perf_counter()
start = mrcal.seed_stereographic(
    imagersizes=size[None], focal_estimate=focal, indices_frame_camera=frames, observations=observations,
    object_spacing=spacing,
)  # fmt: skip
intrinsics, extrinsics, poses = start
descend("LENSMODEL_STEREOGRAPHIC", intrinsics, extrinsics, poses, core=False, everything=False)
descend("LENSMODEL_STEREOGRAPHIC", intrinsics, extrinsics, poses, core=True, everything=False)
lens = 1e-6 * np.random.default_rng(0).uniform(-1, 1, (1, 5))
intrinsics = np.concatenate([intrinsics, lens], axis=1)
stats = descend("LENSMODEL_OPENCV5", intrinsics, extrinsics, poses, core=True, everything=True)
seconds = time.perf_counter() - begin
residual = np.asarray(stats["x"])[: 2 * observations[..., 0].size]
result = {"seconds": seconds, "params": intrinsics[0].tolist(), "rms_px": float(np.sqrt(2 * (residual**2).mean()))}
with open(sys.argv[2], "w", encoding="utf-8") as file:
    json.dump(result, file)
