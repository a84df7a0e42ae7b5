"""All that a comparison samples: the paper's figure, the lens that no Brown model fits, and single errors scaled."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from calib.cameras import parameter_names
from calib.cameras.camera import Camera, camera_or_preset
from calib.studies.compare.photographed import ALL_PHOTOS, NOISE, TOGETHER, OneSource, SetsOfPhotos
from calib.studies.compare.scene import (
    MODELS,
    OBJECTS,
    SETS,
    VIRTUAL,
    ComparedScene,
    PaperObject,
    make_target,
    object_named,
    scene_of,
)
from calib.studies.identity import StudyIdentity, identity_of
from calib.studies.statistics import Case
from calib.studies.workers import CaseSpec
from designer.base.errors import InputError
from designer.base.marks import Key
from designer.kinds.presets import preset_or_file
from designer.tolerance.error_file import error_model
from designer.tolerance.model import ErrorModel
from designer.tolerance.source import Amount

CAMERA = "phase-one-ixg"
LENS = "phase-one-spline"
LENS_OBJECTS = ("AluBoard", "ShinyIco")
SLOW = (VIRTUAL, ALL_PHOTOS)
"""Models of which fewer sets of a print are solved."""
FIGURE, LENS_DRAWN, LENS_MADE, PLAIN_DRAWN, ALONE = "figure", "spline, as drawn", "spline", "plain, as drawn", "alone"
DRAWN_SETS = 4
"""Of objects as drawn, which hardly differ."""
QUICK, ALONE_PRINTS = 2, 6
"""Prints and sets that are enough to see which way it goes; prints for each source alone."""
ALIKE = "face_offset, all alike"
WITHOUT_EFFECT = ("scale", "ink_bleed", "thermal")
"""Sources that a calibration with the drawing cannot show: poses take up the scale, and contours keep their centres."""


@dataclass(frozen=True)
class Plan:
    """How much of the comparison."""

    camera: str  # template or file, of the paper's figure
    prints: int
    sets: int = SETS  # of photos of each print
    slow_sets: Annotated[int, Key("virtual_sets")] = 1  # of them, solved with the models that are slow
    alone: int = ALONE_PRINTS  # prints for each source alone
    seed: int = 1


@dataclass(frozen=True, eq=False)
class Group:
    """Cases of which as many samples are wanted."""

    specs: tuple[CaseSpec, ...]
    samples: int

    @property
    def total(self) -> int:
        """Of all cases."""
        return len(self.specs) * self.samples


@dataclass(frozen=True, eq=False)
class Comparison:
    """All cases of a plan."""

    plan: Plan
    scenes: Mapping[str, ComparedScene]  # of the figure, by object
    errors: Mapping[str, ErrorModel]  # by object
    groups: tuple[Group, ...]

    @property
    def total(self) -> int:
        """Samples of all cases."""
        return sum(group.total for group in self.groups)


def identity(plan: Plan) -> StudyIdentity:
    """All that a sample depends on beside its case and number: prints may be added later, sets may not."""
    settings = {"study": "compare", "sets": str(plan.sets), "virtual sets": str(plan.slow_sets)}
    files = {"camera": _camera_file(plan.camera), "lens": _camera_file(LENS), "plain camera": _camera_file(CAMERA)}
    for one in OBJECTS:
        files[f"target {one.template}"] = preset_or_file("targets", one.template)
        files[f"errors {one.errors}"] = preset_or_file("errors", one.errors)
    return identity_of(plan.seed, settings, files)


def _camera_file(name: str) -> Path:
    return Path(name) if Path(name).suffix.lower() == ".json" else preset_or_file("cameras", name)


def comparison(plan: Plan) -> Comparison:
    """The cases of a plan.

    Raises:
        InputError: a camera that cannot be used; the message says why.
    """
    camera = usable_camera(plan.camera)
    scenes = {one.name: scene_of(one.name, make_target(one.template), camera, one.views) for one in OBJECTS}
    errors = {one.name: error_model(one.errors) for one in OBJECTS}
    lens, plain = camera_or_preset(LENS), camera_or_preset(CAMERA)
    fast: list[CaseSpec] = []
    slow: list[CaseSpec] = []
    drawn: list[CaseSpec] = []
    for one in OBJECTS:
        for model in MODELS:
            sets = plan.slow_sets if model in SLOW else plan.sets
            spec = _spec(one, FIGURE, SetsOfPhotos(scenes[one.name], errors[one.name], model, sets))
            (slow if model in SLOW else fast).append(spec)
    for name in LENS_OBJECTS:
        one = object_named(name)
        for model in (*MODELS, ALL_PHOTOS) if scenes[name].target.is_planar else MODELS:
            through, without = (_through(scenes[name], one, other) for other in (lens, plain))
            sets = plan.slow_sets if model in SLOW else plan.sets
            made = SetsOfPhotos(through, errors[name], model, sets)
            (slow if model in SLOW else fast).append(_spec(one, LENS_MADE, made))
            drawn += [
                _spec(one, LENS_DRAWN, SetsOfPhotos(through, None, model, plan.sets)),
                _spec(one, PLAIN_DRAWN, SetsOfPhotos(without, None, model, plan.sets)),
            ]
    groups = (
        Group(tuple(fast), plan.prints * plan.sets),
        Group(_alone_specs(scenes, errors), plan.alone),
        Group(tuple(drawn), min(plan.sets, DRAWN_SETS)),
        Group(tuple(slow), plan.prints * plan.slow_sets),
    )
    return Comparison(plan, scenes, errors, groups)


def usable_camera(name: str) -> Camera:
    """The camera of the figure.

    Raises:
        InputError: there is none, or its focal length says nothing of the image.
    """
    camera = camera_or_preset(name)
    if camera.learned is not None or parameter_names(camera.model)[:2] != ("fx_px", "fy_px"):
        raise InputError(
            f"{name}: model {camera.model} has no lens to photograph with; give one of model {' or '.join(MODELS[:2])}"
        )
    return camera


def _through(scene: ComparedScene, one: PaperObject, camera: Camera) -> ComparedScene:
    """The same scene with another camera, from as far as fits it."""
    return scene_of(one.name, scene.target, camera, scene.views)


def _spec(one: PaperObject, part: str, pool: SetsOfPhotos) -> CaseSpec:
    return CaseSpec(Case(one.name, pool.view_count, pool.view_count, part, pool.camera_model), pool)


def _alone_specs(scenes: Mapping[str, ComparedScene], errors: Mapping[str, ErrorModel]) -> tuple[CaseSpec, ...]:
    """A case for each source that may explain one of the paper's medians."""
    specs = []
    for one in OBJECTS:
        if not one.is_known:
            continue
        scene, model = scenes[one.name], errors[one.name]
        for label, errors_of, source in _candidates(model):
            pool = OneSource(scene, errors_of, source, one.intersection_mm)
            specs.append(CaseSpec(Case(one.name, scene.views, scene.views, ALONE, label), pool))
    return tuple(specs)


def _candidates(model: ErrorModel) -> list[tuple[str, ErrorModel, str]]:
    """What may explain a median: its label, the errors, and the source that is scaled."""
    found = [(name, model, name) for name in model.sources if name not in WITHOUT_EFFECT]
    if "face_offset" in model.sources:
        alike = model.with_amount("face_offset", Amount("fixed", model.amount("face_offset").sigma))
        found.append((ALIKE, alike, "face_offset"))
    return [*found, (TOGETHER, model, TOGETHER), (NOISE, model, NOISE)]
