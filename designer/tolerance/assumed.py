"""How a target was made, where nobody says it: assumed from how it was built."""

from dataclasses import dataclass

from designer.spec import BUILDS, Build
from designer.target import TargetGeometry
from designer.tolerance.error_file import error_model
from designer.tolerance.model import ErrorModel

ERRORS_OF_BUILD: dict[Build, str] = {
    "solid": "fdm-dual",
    "printed": "fdm-board",
    "stickers": "hand-stickers",
    "sheet": "sheet-print",
}
"""The error template that says how a build usually comes out."""
_BY_OTHERS = ("sheet-print", "hand-stickers")
"""Of a target that we did not design: a flat one is a print on a plate; patterns on several faces were put there."""


@dataclass(frozen=True)
class Assumed:
    """A way of making that was not told."""

    errors: ErrorModel
    because: str  # what it was taken from, as in "its file says the build 'solid'"


def error_model_for(target: TargetGeometry) -> Assumed | None:
    """The way of making that fits a target best; None where its file is no drawing of a part, but one part itself.

    So it is with measured targets, and with simulated parts.
    """
    if target.source != "nominal":
        return None
    if target.build is not None:
        return Assumed(error_model(ERRORS_OF_BUILD[target.build]), f"its file says the build '{target.build}'")
    if target.spec is not None:
        name = ERRORS_OF_BUILD[BUILDS[target.spec.kind][0]]
        return Assumed(error_model(name), f"its file does not say how the {target.spec.kind} was built")
    flat = target.face_count == 1
    return Assumed(
        error_model(_BY_OTHERS[0 if flat else 1]),
        f"it was made by others and has {'one face' if flat else 'several faces'}",
    )
