"""What a session tells of a frame: what is found in it, what is wrong with it, and how the page is told."""

import numpy as np

from calib.app.detect import Detector
from calib.capture.messages import LookMessage
from calib.capture.sources.source import Frame
from calib.core.types import Detections
from calib.detector.frame_quality import frame_quality
from calib.images.photo import Grey
from calib.judge.guide_told import FrameNote, Look
from calib.judge.shutter import notes_of
from calib.solver.calibration import Calibration
from designer.target import TargetGeometry

MANY_RINGS = 15
"""So many ring-like things without a name are more than chance."""


def exactly_found(pixels: Grey, name: str, target: TargetGeometry, calibration: Calibration | None) -> Detections:
    """What a photo shows, by its camera as far as that is known."""
    camera = None if calibration is None else calibration.camera
    if camera is not None and camera.image_size != (pixels.shape[1], pixels.shape[0]):
        camera = None
    return Detector(target, camera).detect(pixels, name)


def glanced(detector: Detector, frame: Frame, calibration: Calibration | None) -> Detections:
    """What a frame shows about; what the photos tell of the lens so far saves guessing it."""
    likely = None if calibration is None else calibration.camera
    return detector.glance(frame.pixels, f"frame {frame.number}", likely)


def notes_on(
    frame: Frame, found: Detections, target: TargetGeometry, sharpest_px: float
) -> tuple[tuple[FrameNote, ...], float]:
    """What is wrong with a frame, and the blur of the sharpest one so far, which tells what the lens can do."""
    strange = 0 if found.rejected_px is None else len(found.rejected_px)
    if not len(found.ring) and strange >= MANY_RINGS and found.remarks:
        return (FrameNote("target", f"rings, but not this target's: {found.remarks[-1]}", forbids=True),), sharpest_px
    quality = frame_quality(frame.pixels, found, target)
    notes = notes_of(quality, sharpest_px)
    if quality is not None and quality.blur_px > 0 and not notes:
        sharpest_px = min(sharpest_px, quality.blur_px)
    return notes, sharpest_px


def look_message(frame: Frame, found: Detections, target: TargetGeometry, look: Look, still: float) -> LookMessage:
    """What the page is told of a frame."""
    circles = np.column_stack([found.center_px, found.ellipse_px[:, 2]])
    return LookMessage(frame.source, frame.number, (circles,), labels_of(found, target), look, still)


def labels_of(found: Detections, target: TargetGeometry) -> tuple[tuple[float, float, str], ...]:
    """Where the faces of a solid are in an image, and what they are called; none of a board."""
    if target.face_count < 2 or not len(found.ring):
        return ()
    face = target.ring_face[found.ring]
    return tuple(
        (*np.round(found.center_px[face == number].mean(axis=0), 1).tolist(), str(number))
        for number in np.unique(face).tolist()
    )
