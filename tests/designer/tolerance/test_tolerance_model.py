"""Error models: how parts are drawn from them, what they refuse, and that photos show the parts."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calib.cameras import project
from calib.cameras.camera import Camera
from calib.core.se3 import look_at, transform
from calib.renderer import RenderOptions, render_view
from designer.base.errors import InputError
from designer.target import TargetGeometry
from designer.tolerance.model import ErrorModel, displaced, draw_values, perturb
from designer.tolerance.source import KINDS, Amount, Kind
from designer.tolerance.sources import SOURCES
from tests.support.perturbed_targets import FULL, MOTIONS, NATURAL, TARGETS, board, drawn, ico, one


@pytest.fixture(params=TARGETS)
def target(request: pytest.FixtureRequest) -> TargetGeometry:
    return TARGETS[request.param]()


# --- drawing ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", KINDS)
def test_draws_have_their_size(kind: Kind) -> None:
    """Root mean square of many draws is the amount's sigma; spreads have no mean, and a uniform one has its width."""
    amount = Amount(kind, 0.3)
    numbers = amount.draw(np.random.default_rng(1), (200, 100))
    assert np.sqrt((numbers**2).mean()) == pytest.approx(amount.sigma, rel=0.03)
    assert numbers.mean() == pytest.approx(0.3 if kind == "fixed" else 0, abs=0.01)
    if kind == "uniform":
        assert 0.299 < np.abs(numbers).max() <= 0.3
    assert amount.scaled(2).sigma == pytest.approx(2 * amount.sigma)


@pytest.mark.parametrize("gone", SOURCES)
def test_leaving_a_source_out_leaves_the_others(gone: str, target: TargetGeometry) -> None:
    """Without one source, or with it larger, all others draw the same numbers, and so does the next draw."""
    rest = [name for name in SOURCES if name != gone]
    larger = FULL.with_amount(gone, Amount("uniform", 7 * FULL.amount(gone).size))
    streams = [np.random.default_rng(6) for _ in range(3)]
    for _ in range(2):
        full, without, other = (
            draw_values(target, model, rng)
            for model, rng in zip((FULL, FULL.only(*rest), larger), streams, strict=True)
        )
        assert set(without) == set(rest)
        for name in rest:
            assert np.array_equal(full[name], without[name]), name
            assert np.array_equal(full[name], other[name]), name


def test_draws_are_repeatable_and_differ() -> None:
    """A seed gives the same part; the next draw, another seed and another source give other numbers."""
    rng = np.random.default_rng(4)
    first, second = draw_values(ico(), FULL, rng), draw_values(ico(), FULL, rng)
    again = draw_values(ico(), FULL, np.random.default_rng(4))
    for name, numbers in first.items():
        assert np.array_equal(numbers, again[name]), name
        assert not np.isin(numbers, second[name]).any(), name
    assert not np.isclose(first["face_tilt"] / NATURAL["rad"], first["face_shift"] / NATURAL["mm"]).any()
    assert perturb(ico(), FULL, np.random.default_rng(4)) == displaced(ico(), first, model=FULL)


@settings(max_examples=10, deadline=None)
@given(factor=st.floats(0, 3))
def test_draws_grow_with_the_model(factor: float) -> None:
    """From one seed, a model twice as bad gives numbers twice as large: sweeps compare like with like."""
    plain, grown = (draw_values(board(), model, np.random.default_rng(3)) for model in (FULL, FULL.scaled(factor)))
    for name, numbers in plain.items():
        assert np.allclose(grown[name], factor * numbers, rtol=1e-12), name


# --- bad input --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "numbers", "words"),
    [
        ("ink_bleed", [1.6], ["ink_bleed 1.6mm", "hole", "smaller"]),
        ("ink_bleed", [-4.0], ["ink_bleed -4mm", "ink of a ring vanishes"]),
        ("scale", [-1.0], ["scale -100%", "between 0.5 and 2 times"]),
        ("scale", [9.0], ["scale 900%"]),
        ("skew", [0.0, 1.2, 0.0], ["skew 68.7549deg", "less than 45deg"]),
        ("face_tilt", [1.2, 1.2], ["face_tilt 68.7549deg", "less than 90deg"]),
        ("face_shift", [np.nan, 0.0], ["face_shift nanmm", "finite"]),
        ("face_offset", [np.inf], ["face_offset infmm", "finite"]),
    ],
)
def test_absurd_sizes_name_source_and_value(name: str, numbers: list[float], words: list[str]) -> None:
    """Numbers that leave no target end in one line with the source, its value and what went wrong."""
    target = ico()
    with pytest.raises(InputError) as caught, np.errstate(invalid="ignore"):
        displaced(target, {**drawn(target, 1, "ring_jitter"), **one(name, target, *numbers)}, model=FULL)
    assert "\n" not in str(caught.value)
    for word in words:
        assert word in str(caught.value)


def test_unknown_sources_and_wrong_shapes_are_refused() -> None:
    """A source that does not exist is told with the nearest; numbers of a wrong shape are a programmer's mistake."""
    with pytest.raises(InputError, match=r"unknown error source 'face_tlit'; did you mean 'face_tilt'\?"):
        displaced(ico(), {"face_tlit": np.zeros((20, 2))}, model=FULL)
    with pytest.raises(InputError, match="unknown error source"):
        ErrorModel("mine", "mine", (("tilt of the moon", Amount("normal", 1.0)),))
    with pytest.raises(ValueError, match=r"face_tilt has values of the shape \(1, 2\)"):
        displaced(ico(), {"face_tilt": np.zeros((1, 2))}, model=FULL)
    with pytest.raises(ValueError, match="twice"):
        ErrorModel("mine", "mine", (("scale", Amount("normal", 1.0)), ("scale", Amount("normal", 2.0))))


# --- what it is for ---------------------------------------------------------------------------------------------------


def test_photos_show_the_perturbed_target() -> None:
    """Tilted, shifted, bowed and skewed faces are drawn where they are: ink moves as the perturbed centres do."""
    target = ico()
    names = (*MOTIONS, "face_bow", "skew", "scale", "ring_jitter")
    made = displaced(target, drawn(target, 12, *names), model=FULL)
    camera = Camera("opencv", np.array([900.0, 900.0, 250.2, 249.6, 0, 0, 0, 0, 0]), (500, 500))
    middle, normal = target.target_from_face[4, :3, 3], target.target_from_face[4, :3, 2]
    where = look_at(middle + 100 * normal + 15 * target.target_from_face[4, :3, 0], middle, 0.2)
    options = RenderOptions(bits=32, black=0.0, white=1.0, background=0.5)
    rows = np.flatnonzero(target.ring_face == 4)
    v, u = np.mgrid[:500, :500]
    found = []
    for shape in (target, made):
        image = render_view(shape, camera, where, options, np.random.default_rng(0)).image
        centers = project(camera, transform(where, shape.center_mm[rows]))
        for center in centers:
            own = np.hypot(u - center[0], v - center[1]) < 33
            ink = 1 - image[own]
            found.append([(ink * u[own]).sum(), (ink * v[own]).sum()] / ink.sum() - center)
    nominal_bias, bias = np.array(found).reshape(2, -1, 2)
    assert np.abs(bias - nominal_bias).max() < 0.05  # a circle's centroid lies beside its centre, on both alike
    steps = project(camera, transform(where, made.center_mm[rows])) - project(
        camera, transform(where, target.center_mm[rows])
    )
    assert np.abs(steps).max() > 5
