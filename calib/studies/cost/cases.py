"""All that the study samples: scenes, how their targets and sightings are, and real photos if there are any."""

from dataclasses import dataclass, replace

from calib.cameras.camera import camera_or_preset
from calib.core.types import Observations
from calib.solver.problem import Loss
from calib.studies.compare.cases import Group
from calib.studies.compare.scene import ComparedScene, make_target, scene_of
from calib.studies.cost.photographed import CONDITIONS, CostPool, RealPool, StartPool
from calib.studies.identity import StudyIdentity, identity_of
from calib.studies.statistics import Case
from calib.studies.workers import CaseSpec
from designer.base.errors import InputError
from designer.kinds.presets import preset_or_file
from designer.tolerance.error_file import error_model

VIEWS = 20
CONTRAST_TO_NOISE = 50.0
FARTHEST = 2.0
"""Photos are taken from where the target fills the image to twice as far: ranges that are all alike would hide much."""
MOST_PARTS = 24
"""Of real photos."""
LEAST_PHOTOS = 4
STARTS = "bad starts"
REAL = "photos held out"


@dataclass(frozen=True)
class CostScene:
    """A target before a camera, by the names of their templates."""

    name: str
    template: str
    errors: str  # how the target is made
    camera: str


SETTINGS: tuple[CostScene, ...] = (
    CostScene("board", "3d-board", "fdm-board", "machine-vision"),
    CostScene("icosahedron", "shiny-ico", "fdm-dual", "machine-vision"),
    CostScene("board, wide lens", "3d-board", "fdm-board", "action-camera"),
)


@dataclass(frozen=True)
class CostPlan:
    """How much of the study."""

    sets: int  # of photos of each scene and condition
    starts: int  # of each scene
    seed: int = 1
    photos: str = ""  # name of the real ones; "": none
    model: str = ""  # that they are solved with


@dataclass(frozen=True, eq=False)
class RealPhotos:
    """Photos of a person's own."""

    name: str
    observations: Observations
    model: str


def identity(plan: CostPlan, digests: tuple[tuple[str, str], ...] = ()) -> StudyIdentity:
    """All that a sample depends on beside its case and number; sets and starts may be added later.

    Args:
        plan: of the study.
        digests: names and SHA-256 of a person's files.
    """
    files = {}
    for one in SETTINGS:
        files[f"target {one.template}"] = preset_or_file("targets", one.template)
        files[f"errors {one.errors}"] = preset_or_file("errors", one.errors)
        files[f"camera {one.camera}"] = preset_or_file("cameras", one.camera)
    found = identity_of(plan.seed, {"study": "cost", "photos": plan.photos, "model": plan.model}, files)
    return replace(found, inputs=tuple(sorted((*found.inputs, *digests))))


def scene_named(setting: CostScene) -> ComparedScene:
    """The scene of a setting."""
    scene = scene_of(setting.name, make_target(setting.template), camera_or_preset(setting.camera), VIEWS)
    return replace(scene, contrast_to_noise=CONTRAST_TO_NOISE, farthest=FARTHEST)


def groups_of(plan: CostPlan, real: RealPhotos | None) -> tuple[Group, ...]:
    """The cases of a plan.

    Raises:
        InputError: photos too few to hold some out.
    """
    simulated, starts = [], []
    for one in SETTINGS:
        scene = scene_named(one)
        for condition in CONDITIONS:
            is_huber = condition == "outliers, Huber"
            loss: Loss = "huber" if is_huber else "squares"
            errors = error_model(one.errors) if condition == "as made" else None
            pool = CostPool(scene, errors, is_huber or condition == "outliers", loss)
            simulated.append(CaseSpec(Case(one.name, VIEWS, VIEWS, condition), pool))
        starts.append(CaseSpec(Case(one.name, VIEWS, VIEWS, STARTS), StartPool(scene)))
    groups = [Group(tuple(simulated), plan.sets), Group(tuple(starts), plan.starts)]
    if real is not None:
        count = real.observations.view_count
        if count < LEAST_PHOTOS:
            raise InputError(f"{real.name}: {count} photos, of which some are held out; give {LEAST_PHOTOS} or more")
        parts = min(count, MOST_PARTS)
        spec = CaseSpec(Case(real.name, count, count, REAL), RealPool(real.observations, real.model, parts))
        groups.insert(0, Group((spec,), parts))
    return tuple(groups)
