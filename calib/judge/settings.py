"""What a guide is asked: of which target, which camera model, and how good."""

from dataclasses import dataclass
from functools import cached_property

from calib.cameras import ABILITIES, COMMON, solved_models
from calib.cameras.camera import Camera
from calib.cameras.surface import surface_model
from calib.core.types import KnownPoints
from calib.judge.criteria import STANDARD, read_criteria
from calib.judge.verdict import Criteria
from calib.judge.views import TargetShape, shape_of_points
from calib.observe.observations import known_points
from designer.base.errors import InputError
from designer.base.words import shown, suggestion
from designer.target import TargetGeometry
from designer.tolerance.made import Made, how_made

ALL = "all"


@dataclass(frozen=True, eq=False)
class GuideSettings:
    """What is asked."""

    target: TargetGeometry
    points: KnownPoints  # of the target
    made: Made | None  # how it was; None: nobody knows
    criteria: Criteria
    model: str  # that cameras are solved by
    may_be_wide: bool  # the model was not asked for: a wide lens gets one of its own
    camera: Camera | None  # a first guess

    @cached_property
    def shape(self) -> TargetShape:
        """Of the target, whose file says which of its sides carry the rings."""
        return shape_of_points(self.points, self.points.plane[:, :3])


def settings_of(
    target: TargetGeometry, criteria: Criteria | str = STANDARD, model: str = ALL, made: str | None = None,
    camera: Camera | None = None,
) -> GuideSettings:  # fmt: skip
    """What is asked, from words.

    Raises:
        InputError: a word that means nothing; the message says what may stand there.
    """
    limits = criteria if isinstance(criteria, Criteria) else read_criteria(criteria)
    return GuideSettings(
        target, known_points(target), how_made(target, made), limits, _guiding_model(model), model == ALL, camera
    )


def _guiding_model(model: str) -> str:
    """The formula that photos are guided by: of a map or a surface, which take many photos, one that takes few."""
    choices = solved_models()
    if model != ALL and model not in choices:
        hint = suggestion(model, [*choices, ALL]) or f"; there are {', '.join(choices)} and {ALL}"
        raise InputError(f"model {shown(model)}: none that is solved{hint}")
    if model == ALL or ABILITIES[model].is_learned:
        return COMMON
    surface = surface_model(model)
    return model if surface is None else surface.base.name
