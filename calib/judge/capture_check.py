"""Whether something moved, breathed or leaned alike in all photos, which halves of them cannot show."""

from calib.judge.evidence import CameraEvidence
from calib.judge.verdict import Criteria, Found, Limits, at_most, px
from calib.solver.calibration import CaptureError
from designer.base.words import figure

LIMITS = Limits(0.1, 0.3)


def judge_capture(evidence: CameraEvidence, criteria: Criteria) -> Found | None:
    """By what is beyond chance; nothing is said of cameras that are not told by few parameters."""
    error = evidence.uncertainty.capture_error
    if error is None:
        return None
    if not error.effects:
        sentence = (
            "nothing moves with the rows, and focal length and centres follow neither distance, time nor tilt beyond "
            f"chance; {px(evidence.uncertainty.capture_px)} of the camera's uncertainty (1 sigma) is what the photos "
            f"leave open of it, {taken_as(error)}"
        )
        return Found("good", 0.0, sentence)
    value = max(effect.camera_px for effect in error.effects)
    shown = "; ".join(
        f"{effect.name} ({figure(effect.amount, 2)} ± {figure(effect.sigma, 1)} {effect.unit}), which moved the camera "
        f"by up to {px(effect.camera_px)} in 95 % of the image"
        for effect in error.effects
    )
    if all(effect.explains for effect in error.effects):
        sentence = f"the photos show {shown}; its uncertainty contains it"
    else:
        sentence = (
            f"something looks like {shown}; it does not explain all that is left over, or parameters were fixed or "
            "shared, so it may be another cause"
        )
    return Found(at_most(value, criteria["capture"]), value, sentence)


def taken_as(error: CaptureError) -> str:
    """How the photos are taken to be made, and what says so."""
    words = {"still": "camera and target at rest", "handheld": "held by hand", "moving": "with a target that moves"}
    return words[error.capture] + (f" ({error.because}; --capture tells otherwise)" if error.because else "")
