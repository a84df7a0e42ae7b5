"""How good a share of what could have been found is, and the worst of several levels."""

from collections.abc import Iterable

from designer.page.blocks import Finding, Level

GOOD_SHARE, USABLE_SHARE = 0.95, 0.5
"""Of the rings that could have been measured, of the readable photos with the target or a pose, and of the photos that
could be read. From 95 % on, what is missing is what nobody can see to: a hair on a ring, a finger at the edge. Below a
half, something is wrong with target file, light or focus, and what was found is no fair sample of the image."""
SHARE_RULE = f"good from {100 * GOOD_SHARE:.0f} %, usable from {100 * USABLE_SHARE:.0f} %"
_WORST_FIRST: tuple[Level, ...] = ("bad", "usable", "good")


def level_of_share(share: float) -> Level:
    """Of a share of what should have been found."""
    return "good" if share >= GOOD_SHARE else "usable" if share >= USABLE_SHARE else "bad"


def worst_level(rows: Iterable[Finding]) -> Level:
    """Of checks."""
    return min((row.level for row in rows), key=_WORST_FIRST.index)
