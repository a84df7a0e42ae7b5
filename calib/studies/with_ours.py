"""What a target of ours would have told of a camera from the same places, beside what another maker's board told.

Both are predicted alike, by the noise that the detector states of their marks in rendered photos of one contrast and
blur: what is measured is not held against what is predicted. Printing errors are left out of both. What is predicted of
rings is on the safe side: in rendered photos of a chessboard of 11 x 8 squares of 20 mm and of an icosahedron as large,
from the same places, the focal length was predicted to .036 and .020 px, and told to .036 and .011 px.
"""

import math
from dataclasses import dataclass

import numpy as np

from calib.cameras import fitted_models
from calib.core.linear_algebra import symmetric_inverse
from calib.solver.blocks import RobustLoss, view_blocks
from calib.solver.calibration import Calibration
from calib.solver.problem import SolveOptions, origin_poses, pack, tie_parameters
from calib.solver.schur import reduced_normal
from calib.studies.tolerance.seen import CONTRAST_TO_NOISE, views_of
from designer.base.arrays import Array, Rows
from designer.base.errors import InputError
from designer.base.words import figure
from designer.kinds.sizing import size_job
from designer.kinds.spec_file import parse_spec
from designer.target import TargetGeometry

MOST_PHOTOS = 40
"""A ratio needs no more."""
MOST_LOST = 0.1
"""Of the photos: from more places ours would not be read."""
ACROSS = 1.9021
"""Edges of an icosahedron through its middle, corner to corner."""
LEAST_EDGE_MM = 40.0
WORTH = 1.25
"""Times surer: less is not worth a word."""


@dataclass(frozen=True)
class WithOurs:
    """Standard deviations of the focal length, px."""

    edge_mm: float  # of an icosahedron as large as the board is long
    board_px: float
    ours_px: float

    @property
    def words(self) -> str:
        """A sentence for who has another maker's board."""
        return (
            f"an icosahedron of ours as large ({self.edge_mm:g} mm edges), photographed from the same places, would "
            f"tell the focal length at least {figure(self.board_px / self.ours_px, 2)} times as surely (predicted for "
            f"both by the noise of marks alone: {figure(self.ours_px, 2)} and {figure(self.board_px, 2)} px): design "
            "choose finds one for your camera"
        )


def with_ours(calibration: Calibration, target: TargetGeometry) -> WithOurs | None:
    """The same photos with our target; None if it cannot be told, or would not be surer."""
    if target.marks is None or calibration.status != "converged" or calibration.camera.model not in fitted_models():
        return None
    long_mm = max(max(marks.size_mm) for marks in target.marks)
    edge_mm = 5.0 * math.floor(long_mm / ACROSS / 5.0)
    if edge_mm < LEAST_EDGE_MM:
        return None
    try:
        ours = size_job(parse_spec({"kind": "ico", "edge": f"{edge_mm:g}mm"}, "")).job.target.lay_out()
    except InputError:
        return None
    poses = calibration.cam_from_target[np.isfinite(calibration.cam_from_target[:, 0, 0])]
    poses = poses[np.unique(np.linspace(0, len(poses) - 1, MOST_PHOTOS).astype(int))]
    (kept, board_px), (kept_ours, ours_px) = (_focal_sigma_px(calibration, one, poses) for one in (target, ours))
    if min(len(kept), len(kept_ours)) < (1 - MOST_LOST) * len(poses):
        return None
    found = WithOurs(edge_mm, board_px, ours_px)
    return found if board_px > WORTH * ours_px else None


def _focal_sigma_px(calibration: Calibration, target: TargetGeometry, poses: Array) -> tuple[Rows, float]:
    """From which poses a target is read, and how surely photos from there tell the focal length; nan: not at all."""
    camera = calibration.camera
    kept, seen = views_of(target, camera, poses, CONTRAST_TO_NOISE)
    tie = tie_parameters(camera.model, SolveOptions(fixed=tuple((name, None) for name in calibration.fixed)))
    if not len(kept) or tie.row[0] < 0:
        return kept, math.nan
    problem = pack(seen, weighted=True)
    pose = origin_poses(problem, poses[kept])
    normal, _ = reduced_normal(view_blocks(problem, camera, pose, RobustLoss()).products, tie.row)
    told = symmetric_inverse(normal)
    if told.rank < len(normal):
        return kept, math.nan
    return kept, float(np.sqrt(told.inverse[tie.row[0], tie.row[0]]))
