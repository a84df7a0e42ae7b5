"""How a format holds a camera: by its own lens, else by the lens that comes closest; and what that loses.

Lenses that suit its field of view come first. A rig is held as its cameras are.
"""

import math
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from calib.cameras import ABILITIES, LINEAR, fitted_models, parameter_names, rays
from calib.cameras.camera import Camera
from calib.cameras.formats import OWN
from calib.cameras.formats.format import CameraFormat, FileLens
from calib.cameras.formats.rig_format import RigFormat
from calib.cameras.refit import FOCAL_AND_CENTRE, Refit, image_grid, in_other_words, refit
from calib.cameras.rig import Rig
from calib.core.se3 import compose, make_pose
from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.base.words import shown, suggestion_or_all

FAR_COSINE = np.cos(np.radians(75.0))
"""Beyond, the numbers of lenses with a focal plane run away: wide ones suit such a camera."""
LARGE_PX = 0.05
"""A larger difference is worth a warning, and a try of other lenses: calibrations are good to hundredths of a pixel."""
BETTER = 0.9
"""A later lens is taken if it leaves less than this part of what the one before it leaves."""

Choice = TypeVar("Choice")


def by_field(wide: Sequence[Choice], narrow: Sequence[Choice], ray: Array) -> list[Sequence[Choice]]:
    """Lenses in groups, those first that suit a camera with such rays (N, 3), of length one; nan where there is none.

    Where it sees far off its axis the others are tried only if there are no wide ones.
    """
    return [group for group in ([wide or narrow] if sees_far(ray) else [narrow, wide]) if group]


def sees_far(ray: Array) -> bool:
    """Whether some of the rays (N, 3), of length one, come from so far off the axis that a wide lens suits."""
    return bool((ray[:, 2] < FAR_COSINE).any())


def try_fits(groups: Sequence[Sequence[Choice]], fit: Callable[[Choice], Refit]) -> list[tuple[Choice, Refit]]:
    """Fits until one leaves no large difference anywhere: the first is the one that most programs read.

    Raises:
        InputError: none can be fitted; why the first cannot.
    """
    tried: list[tuple[Choice, Refit]] = []
    refused: InputError | None = None
    for group in groups:
        for choice in group:
            try:
                tried.append((choice, fit(choice)))
            except InputError as error:
                refused = refused or error
                continue
            if tried[-1][1].max_px <= LARGE_PX:
                return tried
    if not tried and refused is not None:
        raise refused
    return tried


def closest(tried: Sequence[tuple[Choice, Refit]]) -> tuple[Choice, Refit]:
    """The first that no later one is clearly better than."""
    best, *others = tried
    for one in others:
        if one[1].rms_px < BETTER * best[1].rms_px:
            best = one
    return best


@dataclass(frozen=True, eq=False)
class Held:
    """A camera as a file has it."""

    lens: FileLens
    camera: Camera  # of the lens's model; where that is none of ours, as it was
    refit: Refit | None = None  # None: it is exact
    tried: tuple[tuple[FileLens, Refit], ...] = ()  # all that were fitted, in their order

    @property
    def fitted(self) -> str:
        """What was fitted: the model, or a lens that is none of ours."""
        return self.lens.name if self.lens.approximate is not None else self.camera.model

    @property
    def called(self) -> str:
        """The lens by the file's name for it, and by ours where that is another."""
        names = (self.fitted,) if _holds_every(self.lens) else (self.lens.name, self.fitted)
        return " = ".join(dict.fromkeys(names))


def fit_to_format(
    camera: Camera,
    target: CameraFormat,
    model: str | None = None,
    zero: Collection[str] = (),
    lens: str | None = None,
    accept_px: float = math.inf,
) -> Held:
    """The camera as the format can hold it, and the fit that took, if any.

    It stays as it is where the format has a lens for that, unless a model or a lens is given. Else the closest lens of
    its own family is fitted: with a focal plane, or wide. Lens parameters in `zero` are left out besides those that the
    format cannot hold.

    Raises:
        InputError: a model or a lens that is none or that the format has not, none of its lenses takes the camera, or
            the closest is off by more than `accept_px` somewhere in the image.
    """
    held = _held(camera, target, model, zero, lens)
    if held.refit is not None and held.refit.max_px > accept_px:
        raise InputError(_too_far(camera, target, held, accept_px, others=model is None and lens is None))
    return held


def _too_far(camera: Camera, target: CameraFormat, held: Held, accept_px: float, *, others: bool) -> str:
    """That a fit is not good enough, how to have it, and which lens of another family is closer, if others may be."""
    most = math.inf if held.refit is None else held.refit.max_px
    gone = [name for name in held.lens.cannot_hold if camera.parameters.get(name)]
    why = f", which has no {' '.join(gone)}," if gone and held.lens.model == camera.model else ""
    allowed = math.ceil(most * 100) / 100
    line = (
        f"{target.title}'s lens {held.lens.name}{why} is off by up to {most:.3g} px, more than {accept_px:g} px; "
        f"allow it with --accept {allowed:g}px"
    )
    offered = _one_a_model(target.written.values()) if others else []
    strange = [one for one in offered if one.model is not None and one.is_wide != held.lens.is_wide]
    try:
        tried = try_fits([[one for one in strange if not one.is_plain]], lambda one: _fit(camera, one, str(one.model)))
    except InputError:
        tried = []
    if tried and (best := closest(tried))[1].max_px < most:
        line += f"; {best[0].name}, a lens of another kind, by {best[1].max_px:.3g} px, with --lens {best[0].name}"
    return line


def _held(camera: Camera, target: CameraFormat, model: str | None, zero: Collection[str], lens: str | None) -> Held:
    offered = tuple(target.written.values()) if lens is None else (find_lens(target, lens),)
    if zero and model is None and any(one.model in (None, camera.model) for one in offered):
        model = camera.model  # left out of the camera's own lens
    if model is not None and (model != camera.model or zero):
        _require_fitted(model)
    mine = tuple(one for one in offered if model is None or one.model == model or _holds_every(one))
    if not mine:
        return _as_part_of(camera, target, offered, model or camera.model, zero)
    for one in sorted(mine, key=lambda one: one.model != camera.model or one.is_plain):  # the camera's own model first
        same = _exactly(camera, one, model, zero)
        if same is not None:
            return Held(one, same)
    groups: Sequence[Sequence[FileLens]] = [mine]
    if model is None and lens is None:
        groups = _suitable(camera, mine)
    try:
        tried = try_fits(groups, lambda one: _fit(camera, one, model or one.model or camera.model, zero))
    except InputError as error:
        wide = dict.fromkeys(one.name for one in _one_a_model(target.written.values()) if one.is_wide)
        if any(one.is_wide for one in mine) or not sees_far(_rays_of(camera)):
            raise
        hint = f"of {target.title} take --lens {', '.join(wide)}" if wide else f"{target.title} has no lens for that"
        raise InputError(f"{error}; {hint}") from None
    best, result = closest(tried)
    return Held(best, result.camera, result, tuple(tried))


def find_lens(target: CameraFormat, name: str) -> FileLens:
    """The format's lens of that name.

    Raises:
        InputError: it has none.
    """
    found = next((one for key, one in target.written.items() if key.lower() == name.lower()), None)
    if found is None:
        hint = suggestion_or_all(name, target.written)
        raise InputError(f"{target.title} has no lens {shown(name)}{hint}")
    return found


def _require_fitted(model: str) -> None:
    if model not in fitted_models():
        hint = suggestion_or_all(model, fitted_models())
        raise InputError(f"model {shown(model)} cannot be fitted to a camera{hint}")


def _holds_every(lens: FileLens) -> bool:
    """Whether it holds a camera of any model as it is."""
    return lens.model is None and lens.approximate is None


def _as_part_of(
    camera: Camera, target: CameraFormat, offered: Sequence[FileLens], model: str, zero: Collection[str]
) -> Held:
    """The camera in a model that the format has as a part of another only, such as a lens without its last numbers."""
    result = refit(camera, model, zero=zero, turn=camera.learned is not None)
    for one in offered:
        same = _exactly(result.camera, one, None, ())
        if same is not None:
            return Held(one, same, None if result.is_exact else result)
    holds = ", ".join(dict.fromkeys(one.model for one in offered if one.model is not None))
    what = target.title if len(offered) > 1 else f"{target.title}'s {offered[0].name}"
    raise InputError(f"{what} holds models {holds}, not {shown(model)}; leave out --model, or use --to {OWN}")


def _exactly(camera: Camera, lens: FileLens, model: str | None, zero: Collection[str]) -> Camera | None:
    """The camera as the lens has it, if that takes no fit."""
    if lens.approximate is not None:
        return None
    if _holds_every(lens):
        return camera if model in (None, camera.model) and not zero else None
    return in_other_words(camera, str(lens.model), zero=(*zero, *lens.cannot_hold))


def _suitable(camera: Camera, lenses: Sequence[FileLens]) -> list[Sequence[FileLens]]:
    """The lenses worth a fit: of the camera's family; of a camera of none, those first that suit its field of view."""
    most = _one_a_model(lenses)
    worth = [one for one in most if not one.is_plain] or most
    if camera.model in fitted_models():
        is_wide = ABILITIES[camera.model].is_wide
        family = [one for one in worth if one.model is None or one.is_wide == is_wide]
        if family:
            return [family]
    wide, narrow = ([one for one in worth if one.is_wide == is_wide] for is_wide in (True, False))
    return by_field(wide, narrow, _rays_of(camera))


def _rays_of(camera: Camera) -> Array:
    return rays(camera, image_grid(camera.image_size).reshape(-1, 2))


def _one_a_model(lenses: Iterable[FileLens]) -> list[FileLens]:
    """Of the lenses of one model the one that holds the most."""
    most: dict[str | None, FileLens] = {}
    for one in lenses:
        if one.model not in most or len(one.cannot_hold) < len(most[one.model].cannot_hold):
            most[one.model] = one
    return list(most.values())


def _fit(camera: Camera, lens: FileLens, model: str, zero: Collection[str] = ()) -> Refit:
    if lens.approximate is not None:
        return lens.approximate(camera)
    return refit(camera, model, zero=(*zero, *lens.cannot_hold), turn=camera.learned is not None)


def lost_of(camera: Camera, held: Held, target: CameraFormat) -> tuple[str, ...]:
    """What a file does not say that a camera knew, a line for each thing."""
    lost = []
    values = dict(zip(parameter_names(camera.model), camera.params.tolist(), strict=True))
    lens = held.lens
    gone = [name for name in lens.cannot_hold if lens.model == camera.model and values.get(name)]
    if gone and held.refit is not None:
        others = "the others make up for what they can"
        lost.append(f"{' '.join(gone)}, for which {target.title} has no place; {others}")
    fit = held.refit
    if fit is not None and fit.max_px > LARGE_PX:
        kind = " by a lens of another kind" if _is_of_another_kind(camera, lens) else ""
        lost.append(f"up to {fit.max_px:.3g} px of where the camera sees a point, RMS {fit.rms_px:.2g} px{kind}")
    is_foreign = not lens.keeps_edges and (bool(lens.numbers) or lens.approximate is not None)
    if camera.field_rad is not None and is_foreign:
        lost.append(
            f"where the image circle ends, {np.degrees(camera.field_rad) / 2:.1f} degrees off the axis; "
            "the file's lens goes on, untried"
        )
    if camera.learned is not None and (is_foreign or held.camera.learned is None):
        lost.append("where the map is known; the file's lens goes on to the edges of the image, untried")
    elif held.camera.model == LINEAR and np.any(camera.params[FOCAL_AND_CENTRE:]):
        lost.append("the lens's distortion")
    return tuple(lost)


def _is_of_another_kind(camera: Camera, lens: FileLens) -> bool:
    """Whether one has a focal plane, and the other is wide."""
    if camera.model not in fitted_models() or lens.model is None:
        return False
    return lens.is_wide != ABILITIES[camera.model].is_wide


def rig_as_held(rig: Rig, held: Sequence[Held]) -> Rig:
    """The rig with its cameras as files hold them: poses of those whose frames were turned turn with them."""
    cameras = tuple(one.camera for one in held)
    if cameras == rig.cameras:  # the very same: what is known of their numbers stays
        return rig
    turns = [np.eye(3) if one.refit is None else one.refit.new_from_old for one in held]
    poses = compose(np.stack([make_pose(turn, np.zeros(3)) for turn in turns]), rig.cam_from_rig)
    return replace(rig, cameras=cameras, cam_from_rig=poses, covariance=None)


def lost_of_rig(rig: Rig, held: Sequence[Held], target: RigFormat) -> tuple[str, ...]:
    """What files do not say that a rig knew, a line each."""
    lost = []
    for name, camera, one in zip(rig.names, rig.cameras, held, strict=True):
        lost += [f"of {name}: {line}" for line in lost_of(camera, one, target.cameras)]
    kinds = {(camera.model, one.lens.is_wide) for camera, one in zip(rig.cameras, held, strict=True)}
    if len({model for model, _ in kinds}) < len(kinds):
        each = ", ".join(f"{name} {one.lens.name}" for name, one in zip(rig.names, held, strict=True))
        lost.append(f"that cameras are of one model, as they get lenses of two kinds: {each}")
    if target.name == OWN:
        is_gone = rig.covariance is not None and rig_as_held(rig, held).covariance is None
        return (*lost, *(("how sure it all is",) if is_gone else ()))
    if rig.covariance is not None:
        lost.append("how sure it all is, which rig.json keeps")
    if rig.delay_s is not None:
        lost.append("the delays of the cameras' time stamps")
    if not target.keeps_frame and not np.array_equal(rig.cam_from_rig[0], np.eye(4)):
        whose = f" ({rig.rig_frame})" if rig.rig_frame and rig.rig_frame not in rig.names else ""
        lost.append(f"the rig's frame{whose}; the files' is that of camera {rig.names[0]}")
    written = target.words(rig.names)
    if written != rig.names:
        lost.append(f"the cameras' names; they are called {', '.join(written[:4])}{', ...' * (len(written) > 4)}")
    return tuple(lost)
