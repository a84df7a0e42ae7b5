"""What to do about a camera that is not known well, or not everywhere: the next photos, and what they leave open."""

from collections.abc import Sequence

from calib.judge.evidence import LensEvidence
from calib.judge.lens_checks import SURE
from calib.judge.next_views import NextView, photos_needed, why_no_next_views
from calib.judge.verdict import Criteria, px
from calib.solver.calibration import Calibration, is_flat
from designer.base.words import figure

MANY_TIMES = 5
"""So many times as many photos as there are will not be taken."""
HOPELESS_TIMES = 100
"""A number that large tells nobody anything."""
LITTLE_PERCENT = 0.5
"""Of the image: next photos that add less have nothing to do with what is covered."""
SOLID = "a solid target, as an icosahedron, has faces at every slant wherever it is held, and needs fewer photos"


def photo_advice(
    calibration: Calibration, evidence: LensEvidence, criteria: Criteria, views: Sequence[NextView] | None
) -> tuple[str, ...]:
    """The next photos one after the other, or what else there is to say of photos to take.

    Args:
        calibration: the one that is judged.
        evidence: of it.
        criteria: the limits it is judged by.
        views: the next photos that were found for it; None: nobody looked for any.
    """
    sentences: list[str] = []
    if views:
        of_all = f" of {len(views)}" if len(views) > 1 else ""
        sentences = [
            f"next photo{f' {number}{of_all}' if of_all else ''}: {view.sentence}"
            for number, view in enumerate(views, start=1)
        ]
        wanted = [] if is_sure(evidence, criteria) else [px(criteria["uncertainty"].good)]
        if 100 * evidence.coverage.share < criteria["coverage"].good or not wanted:
            wanted.append(f"{criteria['coverage'].good:.0f} % covered")
        sentences[0] += f" (wanted: {', '.join(wanted)})"
    elif not (
        views is None
        or is_sure(evidence, criteria)
        or _is_sure_as_stated(evidence, criteria)
        or evidence.uncertainty.by_target  # what to do then is said of the target
    ):
        why = why_no_next_views(calibration) or (
            "none of the places and tilts tried, at 0.7 to 1.4 times the distances so far, would make the camera "
            "better known; use a target that fills more of the image"
        )
        sentences = [f"no next photo can be proposed: {why}"]
    after = _after_them(calibration, evidence, criteria, views)
    return (*sentences, *_uncovered(calibration, evidence, criteria, views), *((after,) if after else ()))


def _after_them(
    calibration: Calibration, evidence: LensEvidence, criteria: Criteria, views: Sequence[NextView] | None
) -> str:
    """What more photos like those so far would do; where nobody looked for better ones, that they are wanted."""
    if is_sure(evidence, criteria) or not evidence.uncertainty.is_estimated:
        return ""
    sigma, limit = evidence.uncertainty.noise_px, criteria["uncertainty"].good
    if _is_sure_as_stated(evidence, criteria):
        return ""  # by noise alone it is known well enough: what makes the halves differ comes first
    alike = ""
    # Photos average noise out, not what is the same in all of them.
    uncertain, shape = evidence.uncertainty, evidence.shape
    is_noise = uncertain.factor <= 1 and not uncertain.by_target and (shape is None or shape.ratio <= SURE)
    if sigma is not None and calibration.status == "converged" and is_noise:
        alike = _photos_alike(evidence.frames, sigma, limit, others=bool(views))
    if views is not None:
        return alike
    return "take photos that fill the image and show the target from other sides" + (f"; {alike}" if alike else "")


def _photos_alike(photos: int, sigma_px: float, limit_px: float, *, others: bool) -> str:
    """What more photos like those so far would do."""
    needed = photos_needed(photos, sigma_px, limit_px)
    instead = "instead of these, " if others else ""
    if needed > HOPELESS_TIMES * photos:
        return f"{instead}more photos like the {photos} so far would not do"
    if needed > MANY_TIMES * photos:
        step = 10 ** max(len(str(needed)) - 2, 0)
        about = -(-needed // step) * step
        return f"{instead}more photos like the {photos} so far would not do: about {about} would be needed"
    more = f"{needed - photos} more photo{'s' * (needed - photos != 1)}"
    return f"{instead}{more} like the {photos} so far would bring {px(limit_px)} too"


def _uncovered(
    calibration: Calibration, evidence: LensEvidence, criteria: Criteria, views: Sequence[NextView] | None
) -> tuple[str, ...]:
    """Parts of the image without the target, if the next photos do not show it there."""
    percent, wanted = 100 * evidence.coverage.share, criteria["coverage"].good
    missing = evidence.coverage.missing_words
    last = 100 * views[-1].covered_after if views else percent
    if views and last > percent + LITTLE_PERCENT:
        angles = evidence.coverage.missing_angles
        solid = f"; {SOLID}" if is_flat(calibration.observations.points) else ""
        aside = (f"show the target at other angles: hardly a photo has it {angles}{solid}",) if angles else ()
        return *aside, *_again(views[-1], criteria)
    if percent >= wanted or not missing:
        return ()
    beyond = "the map is not known" if evidence.uncertainty.is_map_exact else "the lens is a guess of its model"
    return (
        f"show the target in {missing} too: the observations surround {percent:.0f} % of the {evidence.coverage.area}, "
        f"{wanted:.0f} % is wanted, and beyond them {beyond}",
    )


def _again(last: NextView, criteria: Criteria) -> tuple[str, ...]:
    """What the next photos leave open, which a solution with them tells better than this one."""
    found, wanted = [], []
    if last.sigma_px_after > criteria["uncertainty"].good:
        found.append(f"95 % sigma to about {figure(last.sigma_px_after, 1)} px")
        wanted.append(px(criteria["uncertainty"].good))
    if 100 * last.covered_after < criteria["coverage"].good:
        found.append(f"the coverage to {100 * last.covered_after:.0f} %")
        wanted.append(f"{criteria['coverage'].good:.0f} %")
    if not found:
        return ()
    return (
        f"solve again with these photos, which then tells the ones to follow: they bring {' and '.join(found)}, "
        f"{' and '.join(wanted)} {'is' if len(wanted) == 1 else 'are'} wanted",
    )


def is_sure(evidence: LensEvidence, criteria: Criteria) -> bool:
    """Whether the camera is known as well as it should be."""
    sigma = evidence.uncertainty.image_px
    return evidence.uncertainty.is_map_exact or (sigma is not None and sigma <= criteria["uncertainty"].good)


def _is_sure_as_stated(evidence: LensEvidence, criteria: Criteria) -> bool:
    """Whether it is by the standard deviations of the solution."""
    sigma = evidence.uncertainty.noise_px
    return sigma is not None and sigma <= criteria["uncertainty"].good
