"""Camera models behind one protocol, a file each; everything downstream uses `rays` and `project` only.

A model is a file of this folder, which holds it as `MODEL`, and a line of `ABILITIES`. Files are loaded when used.
"""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from calib.core.registry import Registry

if TYPE_CHECKING:
    from calib.cameras.camera import Camera
    from calib.cameras.parameters import LensParameter, Linearised
    from designer.base.arrays import Array


@dataclass(frozen=True)
class PictureKind:
    """A picture without a lens, which photos are resampled to."""

    words: str  # what would have taken it, with its article
    equation: str
    highest_deg: float = 90.0  # off the horizon, that it shows unless asked for more


@dataclass(frozen=True)
class Abilities:
    """What can be done with a model."""

    is_solved: bool = True  # photos determine its parameters; False: photos can be simulated with it, no more
    is_learned: bool = False  # a map that is learned from photos, besides the parameters
    is_wide: bool = False  # light from the side and from behind has an image
    is_surface: bool = False  # a base of few parameters, and hundreds that bend its image: `calib.cameras.surface`
    is_in_all: bool = False  # one of those that `--model all` solves and compares
    is_in_all_wide: bool = False  # likewise, where the lens is a wide one
    picture: PictureKind | None = None  # photos are resampled to it: `calib undistort --to`
    also_called: str = ""  # names that other programs' files have for it, a word each, without `_`, `-` and spaces


ABILITIES: dict[str, Abilities] = {
    "luhmann": Abilities(is_in_all=True),
    "opencv": Abilities(
        is_in_all=True,
        also_called="brown brownconrady plumbbob radtan radtan4 radtan5 radialtangential tangentialradial standard "
        "opencv4 opencv5 pinholeradtan pinholebrown pinholeopencv",
    ),
    "virtual": Abilities(is_in_all=True, is_learned=True),
    "pinhole": Abilities(
        picture=PictureKind("a pinhole", "u = fx X / Z + cx, v = fy Y / Z + cy"),
        also_called="perspective rectilinear simplepinhole none pinholenone undistorted nodistortion",
    ),
    "opencv8": Abilities(
        is_in_all_wide=True, also_called="rational rationalpolynomial fullopencv radtan8 pinholeradtan8"
    ),
    "opencv12": Abilities(also_called="thinprism"),
    "opencv14": Abilities(also_called="tilted scheimpflug tiltedmodel"),
    "opencv_skew": Abilities(),
    "luhmann_skew": Abilities(),
    "fisheye": Abilities(
        is_wide=True,
        is_in_all_wide=True,
        also_called="equidistant equidist equi kannalabrandt kannalabrandt4 kannalabrandt8 kannala brandt kb kb4 kb8 "
        "opencvfisheye pinholeequi pinholeequidistant",
    ),
    "thin_prism_fisheye": Abilities(is_wide=True),
    "ds": Abilities(is_wide=True, is_in_all_wide=True, also_called="doublesphere dsnone"),
    "eucm": Abilities(is_wide=True, is_in_all_wide=True, also_called="extendedunified extendedunifiedcamera eucmnone"),
    "omni": Abilities(is_wide=True, also_called="omnidirectional mei unified omninone"),
    "division": Abilities(is_wide=True),
    "splined": Abilities(is_wide=True, is_surface=True),
    "spline": Abilities(is_solved=False, is_surface=True),
    "cylinder": Abilities(
        is_solved=False,
        is_wide=True,
        picture=PictureKind(
            "a cylindrical camera", "u = fx atan2(X, Z) + cx, v = fy Y / sqrt(X^2 + Z^2) + cy", highest_deg=60.0
        ),
    ),
    "equirectangular": Abilities(
        is_solved=False,
        is_wide=True,
        picture=PictureKind(
            "an equirectangular camera", "u = fx atan2(X, Z) + cx, v = fy atan2(Y, sqrt(X^2 + Z^2)) + cy"
        ),
    ),
}
"""The models, in the order in which they are offered."""

DEFAULT = "luhmann"
"""The model of studies, if none is asked for."""
COMMON = "opencv"
"""The model that most other tools share: what their files hold, what is solved where others' cameras are compared."""
LINEAR = "pinhole"
"""The model without a lens: that of photos without distortion."""
WIDE = "fisheye"
"""The model that is taken for wide lenses if none is asked for, and that solutions of others start from."""
ANY_LENS = "splined"
"""The model that follows a lens that no formula fits, whatever its field of view."""


class CameraModel(Protocol):
    """One model. All functions are pure."""

    @property
    def name(self) -> str:
        """The model's name in files."""

    @property
    def remedy(self) -> str:
        """What to do about light that the model cannot show, because it comes from too far off the axis."""

    @property
    def parameters(self) -> "tuple[LensParameter, ...]":
        """What `Camera.params` holds, in its order; the first four are fx, fy, cx, cy in px."""

    @property
    def opencv_lens(self) -> tuple[str, ...] | None:
        """The parameters as OpenCV's functions take them, k1 k2 p1 p2 k3 ...; () without a lens; None: another lens."""

    def rays(self, camera: "Camera", pixel: "Array") -> "Array":
        """Unit directions (..., 3) of the light that reaches pixels (..., 2); nan where there is none."""

    def project(self, camera: "Camera", point: "Array") -> "Array":
        """Pixels (..., 2) of points (..., 3) in the camera frame; nan behind the camera or outside the model."""

    def linearise(self, camera: "Camera", point: "Array") -> "Linearised":
        """Pixels of points (3, N), coordinate by coordinate, with their derivatives; nan where `project` has it."""


MODELS: Registry[CameraModel] = Registry(__name__, "MODEL", ABILITIES)


def solved_models() -> tuple[str, ...]:
    """The models that photos determine."""
    return tuple(name for name, model in ABILITIES.items() if model.is_solved)


def learned_models() -> tuple[str, ...]:
    """The models that are nothing without a learned map."""
    return tuple(name for name, model in ABILITIES.items() if model.is_learned)


def free_form_models() -> tuple[str, ...]:
    """The solved models that follow a lens of no formula."""
    return tuple(name for name in solved_models() if ABILITIES[name].is_learned or ABILITIES[name].is_surface)


def fitted_models() -> tuple[str, ...]:
    """The models of a few parameters, which can be fitted to another camera, and whose covariance tells all."""
    return tuple(
        name for name, model in ABILITIES.items() if model.is_solved and not (model.is_learned or model.is_surface)
    )


def models_of_all() -> tuple[str, ...]:
    """The models that `--model all` means, of an ordinary lens."""
    return tuple(name for name, model in ABILITIES.items() if model.is_in_all)


def models_of_all_wide() -> tuple[str, ...]:
    """The models that `--model all` means, of a wide lens."""
    return tuple(name for name, model in ABILITIES.items() if model.is_in_all_wide)


def wide_models() -> tuple[str, ...]:
    """The models to advise for a wide lens: of those that are compared, what shows light from behind, too."""
    return tuple(name for name in models_of_all_wide() if ABILITIES[name].is_wide)


def pictures() -> "dict[str, PictureKind]":
    """The models of pictures without a lens, which photos are resampled to."""
    return {name: model.picture for name, model in ABILITIES.items() if model.picture is not None}


def parameter_names(model: str) -> tuple[str, ...]:
    """The parameters of a model in the order of `Camera.params`."""
    return tuple(parameter.name for parameter in MODELS[model].parameters)


def told_parameters(model: str) -> "tuple[LensParameter, ...]":
    """The parameters of a model that have a meaning of their own: all but the control points of a surface."""
    return tuple(parameter for parameter in MODELS[model].parameters if not parameter.is_control)


def neutral(model: str) -> "Array":
    """The parameters of a model without distortion, but for its first four, which are zero."""
    import numpy as np

    return np.array([parameter.neutral for parameter in MODELS[model].parameters])


def is_allowed(camera: "Camera") -> bool:
    """Whether each parameter is within its bounds."""
    bounds = MODELS[camera.model].parameters
    return all(bound.lower < x < bound.upper for bound, x in zip(bounds, camera.params.tolist(), strict=True))


def rays(camera: "Camera", pixel: "Array") -> "Array":
    """Unit directions (..., 3) of the light that reaches pixels (..., 2); nan where there is none."""
    ray = MODELS[camera.model].rays(camera, pixel)
    return ray if camera.field_rad is None else _within(camera.field_rad, ray, ray)


def project(camera: "Camera", point: "Array") -> "Array":
    """Pixels (..., 2) of points (..., 3) in the camera frame; nan behind the camera or outside the model."""
    pixel = MODELS[camera.model].project(camera, point)
    return pixel if camera.field_rad is None else _within(camera.field_rad, point, pixel)


def linearise(camera: "Camera", point: "Array") -> "Linearised":
    """Pixels of points (3, N) in the camera frame, with their derivatives; nan where `project` has it."""
    return MODELS[camera.model].linearise(camera, point)


def _within(field_rad: float, point: "Array", value: "Array") -> "Array":
    """Values (..., N) of points (..., 3), nan of those beyond the image circle."""
    import numpy as np

    least = math.cos(field_rad / 2) * np.linalg.norm(point, axis=-1, keepdims=True)
    return np.where(np.asarray(point)[..., 2:] >= least, value, np.nan)
