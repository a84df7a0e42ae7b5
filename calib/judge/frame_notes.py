"""What to tell a person of a frame at once, and what keeps it from being taken by itself.

Each limit is where the exact detector's centres begin to suffer: rendered frames that are worse in one respect and
perfect in all others leave more than a tenth of a pixel, or lose rings (`bench_frame_quality`).
"""

import math

from calib.detector.frame_quality import FrameQuality
from calib.judge.guide_told import FrameNote

MOST_MOTION = 0.3
"""Of a ring's smaller semi-axis, moved during the exposure."""
LEAST_MOTION_PX, MOST_MOTION_PX = 1.0, 2.0
"""What moves by less is as sharp as pixels are; by more, a rolling shutter bends what it takes row after row."""
MOST_BLUR = 0.22
"""Standard deviation of the blur, of a ring's smaller semi-axis: beyond, ink and white run into each other."""
SOFTER, SOFTER_PX = 1.6, 0.4
"""Times the blur of the sharpest frame so far, and px more than it: what the lens can do better is out of focus."""
FULL, BLACK = 0.3, 0.6
"""Shares of the white that is at full scale, and of the ink that is at nothing."""
FAINT = 0.12
"""Of full scale: less between ink and white drowns in noise."""
SMALL_PX = 3.5
"""Of the usual ring's smaller semi-axis."""
FLAT = 0.3
"""Smaller over larger semi-axis of the usual ring: seen from 73 degrees."""
SECTORS = ("left and right", "diagonally", "up and down", "diagonally")


def notes_of(quality: FrameQuality | None, sharpest_px: float = math.inf) -> tuple[FrameNote, ...]:
    """What to say of a frame, the most important first: `notes_of(frame_quality(frame, found, target))`.

    Args:
        quality: of it; None: too little was found to tell.
        sharpest_px: the least blur of the frames so far.
    """
    if quality is None:
        return ()
    notes = []
    if quality.full_share > FULL:
        notes.append(
            FrameNote("bright", "too bright: the white is washed out; less light, or a shorter exposure", True)
        )
    if quality.contrast < FAINT or quality.black_share > BLACK:
        notes.append(FrameNote("dark", "too dark: more light on the target", forbids=True))
    if quality.motion_px > min(max(LEAST_MOTION_PX, MOST_MOTION * quality.radius_px), MOST_MOTION_PX):
        sector = SECTORS[round(quality.motion_rad / (math.pi / 4)) % 4]
        said = f"hold still: blurred by {quality.motion_px:.0f} px {sector}"
        notes.append(FrameNote("motion", said, forbids=True))
    elif _is_out_of_focus(quality, sharpest_px):
        notes.append(FrameNote("focus", f"out of focus: edges are {quality.blur_px:.1f} px wide", forbids=True))
    if quality.radius_px < SMALL_PX:
        notes.append(FrameNote("small", f"closer: rings of {quality.radius_px:.0f} px are too small", forbids=True))
    if quality.facing < FLAT:
        notes.append(FrameNote("slant", "too slanted: turn it towards the camera", forbids=False))
    return tuple(notes)


def _is_out_of_focus(quality: FrameQuality, sharpest_px: float) -> bool:
    """Blurred for its size, or much more than the lens can do."""
    is_softer = quality.blur_px > max(SOFTER * sharpest_px, sharpest_px + SOFTER_PX)
    return quality.blur_px > MOST_BLUR * quality.radius_px or is_softer
