"""Each check of cameras in space: what was measured against its limits, and what that means in one sentence."""

import math

from calib.judge.evidence import JointEvidence
from calib.judge.halves import NoHalves, RigHalves
from calib.judge.lens_checks import LEAVE_PRIOR_OUT, circle_words
from calib.judge.verdict import Criteria, Found, at_least, at_most, px
from designer.base.words import figure, printable

NOT_KNOWN = "the covariance of the cameras' poses is not known"


def frames(evidence: JointEvidence, criteria: Criteria) -> Found:
    """The weakest link of the best chain between cameras; of a single camera, its frames."""
    limits = criteria["frames"]
    if not evidence.ties:
        words = f"the target was seen in {evidence.frames} frames"
        return Found(at_least(evidence.frames, limits), float(evidence.frames), words)
    weakest = min(evidence.ties, key=lambda tie: tie.joining_frames)
    count, name = weakest.joining_frames, printable(evidence.names[weakest.camera])
    grade, sentence = at_least(count, limits), f"each camera shares {count} frames or more with another"
    if grade != "good":
        sentence = f"{name} shares only {count} frame{'s' * (count != 1)} with another camera"
    elif count < max(tie.joining_frames for tie in evidence.ties):
        sentence += f", {name} the fewest"
    return Found(grade, float(count), sentence)


def lenses(evidence: JointEvidence, _: Criteria) -> Found | None:
    """Lenses that were given and kept: residuals of a rig hardly show what they are off by, its places do."""
    kept = [printable(one.name) for one in evidence.cameras if one.coverage is None]
    if not kept:
        return None
    whose = "all cameras" if len(kept) == len(evidence.cameras) > 1 else ", ".join(kept)
    return Found("usable", None, f"the lens of {whose} is kept as it was given; what it is off by is in no number here")


def halves(evidence: JointEvidence, criteria: Criteria) -> Found:
    """Whether stated deviations hold, and nothing moved; a camera on a robot is judged by where the target is then."""
    found, limits = evidence.halves, criteria["halves"]
    if isinstance(found, NoHalves):
        return Found("unknown", None, found.reason)
    by_turns, in_order = (figure(found.ratio_of(kind), 2) for kind in ("by turns", "in order"))
    sentence = f"rigs solved from alike halves of the frames differ by {by_turns} standard deviations"
    if math.isfinite(found.ratio_of("in order")):
        sentence += f", from the first and the last half of them by {in_order}"
    if found.has_moved:
        sentence += (
            f"; these leave over {figure(found.noise_of('in order'), 2)} times as much as all frames together, so "
            "something changed while the frames were taken, such as a camera that was pushed"
        )
    elif found.factor > 1:
        sentence += f": take the noise's part of standard deviations {figure(found.factor, 2)} times as large"
    grade = at_most(found.ratio, limits)
    if grade == "bad" and is_in_mm(evidence) and at_most(found.target_factor, limits) != "bad":
        return Found("usable", found.ratio, sentence, usable=found.ratio)
    return Found(grade, found.ratio, sentence)


def is_in_mm(evidence: JointEvidence) -> bool:
    """Whether `space` says what everything does at the target."""
    return evidence.carried is not None and math.isfinite(evidence.carried.sigma_mm)


def outliers(evidence: JointEvidence, criteria: Criteria) -> Found | None:
    """Sightings that were left out, of the camera that has most of them."""
    shares = [(one.left_out / max(one.sightings + one.left_out, 1), one.name) for one in evidence.cameras]
    share, name = max(shares)
    if share == 0:
        return None
    sentence = (
        f"{figure(100 * share, 2)} % of the sightings of {printable(name)} were left out, the most of all cameras"
    )
    return Found(at_most(100 * share, criteria["outliers"]), 100 * share, sentence)


def delays(evidence: JointEvidence, criteria: Criteria) -> Found | None:
    """What the least known delay moves the sightings of its camera by."""
    if not evidence.delay_px:
        return None
    known = [
        (value, name) for value, name in zip(evidence.delay_px, evidence.names, strict=True) if math.isfinite(value)
    ]
    if not known:
        return Found("unknown", None, "the target's speed is not known")
    value, name = max(known)
    sentence = f"what is not known of the delay of {printable(name)} moves its sightings by {px(value)} (1 sigma)"
    return Found(at_most(value, criteria["delays"]), value, sentence)


def baselines(evidence: JointEvidence, criteria: Criteria) -> Found | None:
    """The pair whose distance is known worst, in relation to itself."""
    if not evidence.pairs:
        return None
    parts = [(pair.relative.baseline_sigma_mm / max(pair.relative.baseline_mm, 1e-9), pair) for pair in evidence.pairs]
    if not all(math.isfinite(share) for share, _ in parts):
        return Found("unknown", None, NOT_KNOWN)
    share, pair = max(parts, key=lambda part: part[0])
    names = " and ".join(map(printable, pair.names))
    sigma = figure(pair.relative.baseline_sigma_mm, 2)
    sentence = f"the distance of {names}, {figure(pair.relative.baseline_mm, 4)} mm, is known to {sigma} mm (1 sigma)"
    sentence += ", in relation the least of all pairs" if len(parts) > 1 else ""
    return Found(at_most(100 * share, criteria["baselines"]), 100 * share, sentence)


def carrier(evidence: JointEvidence, criteria: Criteria) -> Found | None:
    """How far the carrier's own turns are off those that photos show: what is not a robot's, or table's, to be."""
    carrier = evidence.carrier
    if carrier is None or not math.isfinite(carrier.sigma_rad):
        return None
    degrees, limits = math.degrees(carrier.sigma_rad), criteria["carrier"]
    sentence = (
        f"the {printable(carrier.kind.partition(',')[0])}'s own errors are {figure(degrees, 2)} deg and "
        f"{figure(carrier.sigma_mm, 2)} mm a coordinate"
    )
    grade = at_most(degrees, limits)
    if grade == "bad":
        sentence += ": its poses are not those of these photos, or their order, unit or sense is another"
    return Found(grade, degrees, sentence)


def space(evidence: JointEvidence, criteria: Criteria) -> Found | None:
    """A point in the middle, or what one camera on its carrier sees there, as a share of how far away it is."""
    found, carried = evidence.middle, evidence.carried
    if carried is not None:
        if not math.isfinite(carried.sigma_mm):
            return Found("unknown", None, NOT_KNOWN)
        share = 100 * carried.sigma_mm / carried.away_mm
        sentence = (
            f"the target, seen from {figure(carried.away_mm, 3)} mm away through this lens, is placed to "
            f"{figure(carried.sigma_mm, 2)} mm (1 sigma) in the frame of what holds the camera"
        )
    elif found is not None:
        share = 100 * found.sigma_mm / found.away_mm
        sentence = (
            f"a point in the middle of where the target was, {figure(found.away_mm, 3)} mm from the nearest camera, is "
            f"placed in the rig's frame to {figure(found.sigma_mm, 2)} mm (1 sigma): {figure(found.noise_mm, 2)} mm by "
            f"the noise of one sighting a camera, {figure(found.rig_mm, 2)} mm by the rig"
        )
    elif len(evidence.cameras) < 2:
        return None
    elif not all(math.isfinite(pair.relative.baseline_sigma_mm) for pair in evidence.pairs):
        return Found("unknown", None, NOT_KNOWN)
    else:
        return Found("unknown", None, "no two cameras see the middle of where the target was")
    return Found(at_most(share, criteria["space"]), share, sentence)


def points(evidence: JointEvidence, criteria: Criteria) -> Found | None:
    """Points that nobody said are corners or centres of circles, where that matters."""
    found = evidence.by_circles
    if found is None or found.sigma_mm <= found.noise_mm:
        return None
    sentence = circle_words(found.doubt, "a place in space", f"off by {figure(found.sigma_mm, 2)} mm")
    share = 100 * found.sigma_mm / found.away_mm
    return Found("unknown" if found.doubt.told_mm is None else at_most(share, criteria["space"]), None, sentence)


def why_good(evidence: JointEvidence) -> str:
    """The main reason of a rig that is good."""
    parts = []
    if evidence.pairs:
        worst = max(pair.relative.baseline_sigma_mm for pair in evidence.pairs)
        parts.append(f"the distances of the cameras are known to {figure(worst, 2)} mm or better")
    if evidence.middle is not None:
        parts.append(f"a point in the middle to {figure(evidence.middle.sigma_mm, 2)} mm")
    if evidence.carried is not None:
        parts.append(f"the target is placed to {figure(evidence.carried.sigma_mm, 2)} mm")
    parts.append("halves of the frames agree")
    return f"{', '.join(parts[:-1])}{',' if len(parts) > 2 else ''} and {parts[-1]}" if parts[1:] else parts[0]


def steps_of(evidence: JointEvidence, criteria: Criteria) -> list[str]:
    """What to do better, what would change the verdict first."""
    steps = [LEAVE_PRIOR_OUT] if evidence.contradicted else []
    halves = evidence.halves
    if isinstance(halves, RigHalves) and halves.has_moved:
        steps.append(
            "fix the cameras, their focus and zoom, and take all frames again: the first frames give another rig than "
            "the last ones"
        )
    elif isinstance(halves, RigHalves) and halves.ratio > criteria["halves"].good:
        steps.append(
            "find what differs between the frames before taking more: cameras that are not taken at once while the "
            "target moves, a target that bends or is not as its file says, autofocus or image stabilisation"
        )
    loud = [one for one in evidence.cameras if one.rms_px > criteria["residuals"].good]
    if len(loud) == len(evidence.cameras) > 1 and not evidence.delay_px:
        steps.append(
            "look at what all cameras have in common, as each leaves over more than it should: photos that were not "
            "taken at once while the target moved (time stamps and --delays, or stop and go), or a target that is not "
            "as its file says"
        )
    elif loud:
        names = ", ".join(printable(one.name) for one in loud)
        steps.append(f"look at the photos of {names}: blur, motion, or a lens that the camera model does not fit")
    few = [tie for tie in evidence.ties if tie.joining_frames < criteria["frames"].good]
    if few:
        names = ", ".join(printable(evidence.names[tie.camera]) for tie in few)
        steps.append(
            f"take more frames in which these see the target together with another camera: {names}; "
            f"{criteria['frames'].good:g} or more"
        )
    return steps
