"""How a target was made, as somebody says or as it is assumed from how it was built: what its rings may be off."""

from dataclasses import dataclass

from designer.base.errors import InputError
from designer.spec.build import BUILDS, builds_of
from designer.target import TargetGeometry
from designer.tolerance.model import ErrorModel
from designer.tolerance.prior import ShapePrior, measured_prior, shape_prior

EXACT, MEASURED = "exact", "measured"
"""What a target is that is as its file says, and one that is so up to the accuracy that its file states."""

_BY_OTHERS = ("sheet-print", "hand-stickers")
"""Of a target that we did not design: a flat one is a print on a plate; patterns on several faces were put there."""


@dataclass(frozen=True)
class Assumed:
    """A way of making that was not told."""

    errors: ErrorModel
    because: str  # what it was taken from, as in "its file says the build 'one-piece'"


def error_model_for(target: TargetGeometry) -> Assumed | None:
    """The way of making that fits a target best; None where its file is no drawing of a part, but one part itself.

    So it is with measured targets, and with simulated parts.
    """
    from designer.tolerance.error_file import error_model

    if target.source != "nominal":
        return None
    # A file made by hand may name a build that is not for its form.
    if (
        target.build is not None
        and (name := BUILDS[target.build].errors_of(target.form, target.face_count, has_lip=target.has_lip)) is not None
    ):
        return Assumed(error_model(name), f"its file says the build '{target.build}'{' with lips' * target.has_lip}")
    if target.spec is not None:
        name = BUILDS[builds_of(target.form)[0]].errors_of(target.form, target.face_count) or _BY_OTHERS[1]
        return Assumed(error_model(name), f"its file does not say how the {target.spec.kind} was built")
    has = "one face" if target.is_planar else "a front and a back" if target.is_plate else "several faces"
    return Assumed(error_model(_BY_OTHERS[0 if target.is_planar else 1]), f"it was made by others and has {has}")


@dataclass(frozen=True, eq=False)
class Made:
    """A way of making."""

    name: str  # an error template's or file's, "measured" or "exact"
    because: str  # why this one; "" if somebody said it
    prior: ShapePrior | None  # None: the rings are where the file has them
    errors: ErrorModel | None = None  # that the prior is of

    @property
    def sentence(self) -> str:
        """What is taken for granted, and how to say otherwise."""
        taken = self.name if self.prior is None or self.name == MEASURED else f"made as '{self.name}'"
        why = f", as {self.because}; --made tells otherwise" if self.because else ""
        return f"the target is taken to be {taken}{why}"


def prior_of(target: TargetGeometry, made: str, errors: ErrorModel | None) -> ShapePrior | None:
    """What a target's rings may be off, made in a way (`Made.name`) with these errors; None: nothing."""
    if made == MEASURED:
        return measured_prior(target)
    return None if errors is None else shape_prior(target, errors)


def how_made(target: TargetGeometry | None, asked: str | None = None, *, rendered_id: str = "") -> Made | None:
    """The way a target was made; None if nobody knows.

    Args:
        target: as its file has it; None: points from elsewhere.
        asked: an error template, a TOML file of errors, or `exact`; None: assumed from the target.
        rendered_id: of the geometry that photos were rendered of; "": real photos.

    Raises:
        InputError: no such template or file, or one for points without a target.
    """
    from designer.tolerance.error_file import error_model

    if asked == EXACT:
        return Made(EXACT, "", None)
    if target is None:
        if asked is None:
            return None
        raise InputError(f"--made {asked}: points without a target file have no faces that errors could be of; "
                         f"give --made {EXACT}, or leave it out")  # fmt: skip
    if asked is not None:
        name, because, errors = asked, "", error_model(asked)
    elif rendered_id == target.geometry_id:
        name, because, errors = EXACT, "the photos were rendered of it", None
    elif target.source == MEASURED:
        name, because, errors = MEASURED, "its file says so", None
    elif (assumed := error_model_for(target)) is None:
        name, because, errors = EXACT, "its file is of a simulated part", None
    else:
        name, because, errors = assumed.errors.name, assumed.because, assumed.errors
    return Made(name, because, prior_of(target, name, errors), errors)
