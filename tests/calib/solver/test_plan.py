"""A person's words about a solution become options."""

import inspect

import pytest

from calib.app.run import run
from calib.solver.plan import SolvePlan, plan_from_words
from designer.base.errors import InputError
from designer.base.options import parameters_of

FOCAL = parameters_of(inspect.unwrap(run))["focal_px"]


def plan(
    model: str = "all",
    *,
    fix: tuple[str, ...] = (),
    share: tuple[str, ...] = (),
    focal_px: float | None = None,
    loss: str = "squares",
    reject: float | None = None,
) -> SolvePlan:
    """The plan of a command line."""
    return plan_from_words(
        model, fix=[*fix], share=[*share], focal_px=focal_px, loss=loss, reject=reject, weighted=False
    )


def test_all_means_the_three_models_of_the_comparison() -> None:
    """Any other model is itself."""
    assert plan().models == ("luhmann", "opencv", "virtual")
    assert plan("pinhole").models == ("pinhole",)


def test_a_model_gets_only_parameters_that_it_has() -> None:
    """What another of the models has is no fault, and a group counts only where all of it is known."""
    options = plan(fix=("k3=0", "p1"), share=("fx_px,fy_px", "k1 , k2"))
    assert options.options_of("opencv").fixed == (("k3", 0.0), ("p1", None))
    assert options.options_of("opencv").shared == (("fx_px", "fy_px"), ("k1", "k2"))
    assert options.options_of("virtual").fixed == ()
    assert options.options_of("virtual").shared == (("fx_px", "fy_px"),)


@pytest.mark.parametrize(
    ("text", "pair"),
    [("k3=0", ("k3", 0.0)), ("k3", ("k3", None)), (" k1 = -1.5e-1 ", ("k1", -0.15)), ("fx_px=2500", ("fx_px", 2500.0))],
)
def test_a_parameter_is_kept_or_set(text: str, pair: tuple[str, float | None]) -> None:
    """A name keeps the value that it starts from; a name with a value has that."""
    assert plan("opencv", fix=(text,)).options.fixed == (pair,)


@pytest.mark.parametrize(
    "text", ["", "k3=", "=0", "k3=zero", "k3=nan", "k3=inf", "k3=1e999", "k3==0", "k3 0", "k4", "fx_px=-5", "k3=\n"]
)
def test_a_word_that_sets_no_parameter_is_refused(text: str) -> None:
    """The message is one line."""
    with pytest.raises(InputError) as caught:
        plan("opencv", fix=(text,))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("fix", "share", "rule"),
    [
        (("k1", "k1=0"), (), "fixed twice"),
        (("k1",), ("k1,k2",), "fixed and shared"),
        ((), ("fx_px,fx_px",), "twice"),
        ((), ("fx_px,fy_px", "fy_px,fx_px"), "twice"),
        ((), ("fx_px,k1",), "units"),
        ((), ("fx_px",), "two or more"),
        ((), ("fx_px,",), "no such parameter"),
    ],
)
def test_choices_that_contradict_each_other_are_refused(
    fix: tuple[str, ...], share: tuple[str, ...], rule: str
) -> None:
    """At once, and not when the model's turn comes."""
    with pytest.raises(InputError, match=rule):
        plan(fix=fix, share=share)


@pytest.mark.parametrize(("text", "length_px"), [("2500px", 2500.0), (" 2.5e3 ", 2500.0), ("1000 px", 1000.0)])
def test_a_focal_length_is_in_pixels(text: str, length_px: float) -> None:
    """With its unit or without."""
    assert FOCAL.read(text) == plan(focal_px=length_px).options.focal_px == length_px


@pytest.mark.parametrize("number", [0.0, 0.99, -4.0, float("nan"), float("inf")])
def test_rejecting_needs_a_sensible_limit(number: float) -> None:
    """Less than one standard deviation would leave out most of all that is good."""
    with pytest.raises(InputError, match="such as 4"):
        plan(reject=number)


def test_losses_and_models_are_known_by_name() -> None:
    """A misspelt one is answered with the right one."""
    assert [plan(loss=loss).options.loss for loss in ("squares", "huber", "cauchy")] == ["squares", "huber", "cauchy"]
    with pytest.raises(InputError, match="huber"):
        plan(loss="l1")
    with pytest.raises(InputError, match="did you mean 'luhmann'"):
        plan("luhman")
    with pytest.raises(InputError, match="there are"):
        plan("xyz")
