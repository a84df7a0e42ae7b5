"""Where rings may be for a way of making: the first-order prior against draws, and which way of making is assumed."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from calib.core.se3 import exp_rotation
from designer.base.arrays import Array, Rows
from designer.spec.build import BUILDS, builds_of
from designer.target import TargetGeometry, target_from_json, target_to_json
from designer.tolerance.made import error_model_for
from designer.tolerance.model import displaced_shape, draw_values, perturb
from designer.tolerance.prior import ShapePrior, measured_prior, shape_prior
from designer.tolerance.shape import centers_mm
from designer.tolerance.source import Amount
from designer.tolerance.sources import SOURCES
from tests.support.designs import design_of
from tests.support.perturbed_targets import FULL, board, ico, made_by_others

SMALL = 0.01
DRAWS = 400


def _covariance(prior: ShapePrior, rows: Rows) -> Array:
    """Of the coordinates of some rings.  # (3N, 3N)"""
    modes = prior.modes_mm[:, rows].reshape(len(prior.modes_mm), 3 * len(rows))
    full: Array = modes.T @ modes
    for number, row in enumerate(rows):
        part = slice(3 * number, 3 * number + 3)
        full[part, part] += prior.ring_modes_mm[row] @ prior.ring_modes_mm[row].T
    return full


@pytest.mark.parametrize(
    "names", [*((name,) for name in SOURCES), tuple(SOURCES)], ids=lambda names: names[0] if len(names) == 1 else "all"
)
@pytest.mark.parametrize("make", [board, ico])
def test_the_prior_has_the_covariance_of_drawn_parts(
    make: Callable[[], TargetGeometry], names: tuple[str, ...]
) -> None:
    """For small amounts, single rings and pairs of them scatter over drawn parts as the prior says, to sampling.

    Each source alone, so that none hides behind larger ones, and all together.
    """
    target, rng = make(), np.random.default_rng(3)
    errors = FULL.only(*names).scaled(SMALL)
    rows = rng.choice(target.ring_count, 5, replace=False)
    drawn = np.stack([
        (centers_mm(displaced_shape(target, draw_values(target, errors, rng), model=errors)) - target.center_mm)[rows]
        for _ in range(DRAWS)
    ]).reshape(DRAWS, -1)  # fmt: skip
    expected = _covariance(shape_prior(target, errors), rows)
    found = drawn.T @ drawn / DRAWS
    # A sample covariance of normal numbers has the variance (C_ii C_jj + C_ij^2) / n.
    sigma = np.sqrt((np.outer(np.diagonal(expected), np.diagonal(expected)) + expected**2) / DRAWS)
    # What turns do in the second order is left out of the prior.
    second_order = 1e-4 * np.diagonal(expected).max()
    assert (np.abs(found - expected) <= 5 * sigma + second_order + 1e-24).all()


def test_what_moves_no_centre_is_not_in_the_prior() -> None:
    """Ink that runs has no mode; on a body of many faces, a board's warp has none."""
    assert not len(shape_prior(ico(), FULL.only("ink_bleed", "warp")).modes_mm)
    assert len(shape_prior(board(), FULL.only("ink_bleed", "warp")).modes_mm) == 3


def test_an_amount_counts_by_its_standard_deviation() -> None:
    """Whatever its distribution: a uniform one of a size has the prior of a normal one of its standard deviation."""
    uniform = Amount("uniform", 0.2)
    for name in ("face_offset", "ring_jitter"):
        one, other = (
            shape_prior(ico(), FULL.only(name).with_amount(name, amount))
            for amount in (uniform, Amount("normal", 0.2 / np.sqrt(3)))
        )
        assert np.allclose(one.modes_mm, other.modes_mm)
        assert np.allclose(one.ring_modes_mm, other.ring_modes_mm)


def test_a_fixed_amount_is_one_number() -> None:
    """A source of a known size moves all instances together, rings as well."""
    errors = FULL.only("ring_jitter", "face_offset")
    for name in errors.sources:
        prior = shape_prior(ico(), errors.only(name).with_amount(name, Amount("fixed", 0.2)))
        assert prior.modes_mm.shape == (1, ico().ring_count, 3)
        assert prior.ring_modes_mm.shape[2] == 0


def test_a_measured_target_is_as_uncertain_as_it_states() -> None:
    """The faces of a measured target move by their stated covariances: what draws of their poses do to the rings."""
    rng, faces = np.random.default_rng(1), made_by_others().face_count
    root = 1e-3 * rng.standard_normal((faces, 6, 6))
    target = replace(made_by_others(), face_covariance=root @ root.transpose(0, 2, 1))
    prior = measured_prior(target)
    assert prior is not None
    step = np.einsum("fij,fj->fi", root, rng.standard_normal((faces, 6)))[target.ring_face]
    local = np.einsum("rij,rj->ri", exp_rotation(step[:, :3]), target.center_in_face_mm) + step[:, 3:]
    frame = target.target_from_face[target.ring_face]
    moved = np.einsum("rij,rj->ri", frame[:, :3, :3], local) + frame[:, :3, 3] - target.center_mm
    modes = prior.modes_mm.reshape(len(prior.modes_mm), -1)
    rest = moved.reshape(-1) - modes.T @ np.linalg.lstsq(modes.T, moved.reshape(-1), rcond=None)[0]
    assert np.abs(rest).max() < 0.01 * np.abs(moved).max()
    variance = np.einsum(
        "rij,rjk,rlk->ril", *(_by_motion(target), target.face_covariance[target.ring_face], _by_motion(target))
    )
    assert np.allclose(prior.sigma_mm**2, np.einsum("rii->ri", variance))
    assert measured_prior(board()) is None


def _by_motion(target: TargetGeometry) -> Array:
    """Derivatives of the rings by their faces' motions, by differences.  # (R, 3, 6)"""
    columns = []
    for number in range(6):
        step = np.zeros(6)
        step[number] = 1e-6
        local = target.center_in_face_mm @ exp_rotation(step[:3]).T + step[3:] - target.center_in_face_mm
        columns.append(np.einsum("rij,rj->ri", target.target_from_face[target.ring_face, :3, :3], local) / 1e-6)
    return np.stack(columns, axis=2)


@pytest.mark.parametrize(
    ("build", "nominal"),
    [(name, {"plate": board, "solid": ico}[form]()) for form in ("plate", "solid") for name in builds_of(form)],
)
def test_the_way_of_making_is_assumed_from_the_build(build: str, nominal: TargetGeometry) -> None:
    """A target's file says its build, no id depends on it, and the error template of that build is assumed."""
    target = replace(nominal, build=build)
    assert target.geometry_id == nominal.geometry_id
    again = target_from_json(target_to_json(target))
    assert again.build == build
    assumed = error_model_for(again)
    assert assumed is not None
    assert assumed.errors.name == BUILDS[build].errors[target.form]
    assert build in assumed.because


def test_a_build_that_does_not_suit_a_target_is_not_believed() -> None:
    """A board whose file was changed to say stickers gets the errors of a usual board; a former name is read."""
    assumed = error_model_for(replace(board(), build="stickers"))
    assert assumed is not None
    assert assumed.errors.name == "fdm-board"
    former = target_to_json(replace(ico(), build="one-piece")).replace('"build": "one-piece"', '"build": "solid"')
    assert target_from_json(former).build == "one-piece"


def test_a_design_says_how_it_is_built() -> None:
    """The target of a design carries the build that was asked for, or the usual one."""
    for build in ("stickers", None):
        design = design_of("ico", edge="100mm", build=build)
        assert design.target.build == (build or "one-piece")


def test_without_a_build_the_kind_decides_and_parts_are_exact() -> None:
    """Older files get the usual build of their kind, targets of others what fits their faces, single parts nothing."""
    names = {error_model_for(one).errors.name for one in (ico(), board())}
    assert names == {"fdm-dual", "fdm-board"}
    others = error_model_for(replace(made_by_others(), source="nominal"))
    assert others is not None
    assert others.errors.name == "hand-stickers"
    assert error_model_for(made_by_others()) is None
    assert error_model_for(perturb(board(), FULL, np.random.default_rng(0))) is None
