"""What is known of parameters beforehand counts as the observation that it is."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares

from calib.cameras import project
from calib.cameras.camera import Camera
from calib.core.se3 import exp_rotation, log_rotation
from calib.core.types import Observations
from calib.judge.checks import read_criteria
from calib.judge.evidence import lens_evidence
from calib.judge.halves import NoHalves
from calib.judge.judge import judged_by
from calib.judge.solutions import SolveTask, solve_models
from calib.observe.calibration_file import read_calibration, write_calibration
from calib.rigs.problem import CameraChoice
from calib.rigs.solve import solve_rig
from calib.solver.plan import plan_from_words
from calib.solver.priors import ParameterPrior
from calib.solver.problem import SolveOptions
from calib.solver.solve import solve
from designer.base.arrays import Array
from designer.base.errors import InputError
from tests.support import solver_scenes as scenes
from tests.support.rig_views import stereo_pair
from tests.support.verdict_cases import judge_run

TRUE = scenes.CAMERAS["opencv"]
KNOWN = {"fx_px": 10.0, "fy_px": 10.0, "k1": 0.01, "cx_px": 5.0}


def seen(seed: int, views: int = 5, tilt_deg: float = 3.0) -> Observations:
    """Photos that look nearly straight at a board, and so hardly tell the focal length."""
    poses = scenes.poses_around(views, np.random.default_rng(99), half_angle_deg=tilt_deg)
    return scenes.observe(TRUE, scenes.board(7, 5), poses, np.random.default_rng(seed), noise_px=0.05)


def drawn(
    rng: np.random.Generator, camera: Camera = TRUE, sigma: dict[str, float] | None = None
) -> tuple[ParameterPrior, ...]:
    """Priors that are as far off as they say."""
    values = camera.parameters
    return tuple(ParameterPrior(name, rng.normal(values[name], one), one) for name, one in (sigma or KNOWN).items())


def slowly(
    observations: Observations, priors: Sequence[ParameterPrior], start: Array, scale: float
) -> tuple[Array, Array]:
    """Least squares of all residuals and the priors' rows: the parameters, and their standard deviations."""
    names = list(TRUE.parameters)
    count = len(names)

    def residuals(x: Array) -> Array:
        camera, rows = replace(TRUE, params=x[:count]), []
        for view, (wx, wy, wz, *shift) in enumerate(x[count:].reshape(-1, 6).tolist()):
            own = observations.view == view
            place = observations.points.position_mm[observations.point[own]] @ exp_rotation(np.array([wx, wy, wz])).T
            rows.append((project(camera, place + shift) - observations.center_px[own]).ravel())
        rows.append(np.array([(x[names.index(one.name)] - one.value) * scale / one.sigma for one in priors]))
        return np.concatenate(rows)

    found = least_squares(residuals, start, x_scale=np.maximum(np.abs(start), 1e-3), xtol=1e-15, ftol=1e-15, gtol=1e-15)
    covariance = scale**2 * np.linalg.inv(found.jac.T @ found.jac)
    return found.x[:count], np.sqrt(np.diagonal(covariance)[:count])


def test_a_prior_is_an_observation_with_its_own_deviation() -> None:
    """The solution is that of least squares with a row for each prior, which counts by the photos' own noise."""
    observations, priors = seen(1), drawn(np.random.default_rng(2))
    alone = solve(observations, "opencv")
    found = solve(observations, "opencv", SolveOptions(priors=priors))
    poses = [np.concatenate([log_rotation(pose[:3, :3]), pose[:3, 3]]) for pose in found.cam_from_target]
    params, sigma = slowly(observations, priors, np.concatenate([found.camera.params, *poses]), found.scale)
    assert (np.abs(found.camera.params - params) < 0.01 * sigma).all()  # the noise is settled to a hundredth
    assert scenes.sigma_of(found.param_covariance) == pytest.approx(sigma, rel=0.01)
    assert scenes.sigma_of(found.param_covariance)[0] < 0.25 * scenes.sigma_of(alone.param_covariance)[0]


@pytest.mark.parametrize(("views", "tilt_deg"), [(5, 3.0), (1, 0.0)])
def test_covariances_with_priors_keep_their_promise(views: int, tilt_deg: float) -> None:
    """Errors are as large as stated, where photos alone determine a camera and where they do not."""
    sigma = KNOWN if views > 1 else {**KNOWN, "cy_px": 5.0, "k2": 0.05, "p1": 1e-3, "p2": 1e-3, "k3": 0.2}
    squares = []
    for seed in range(40):
        options = SolveOptions(priors=drawn(np.random.default_rng(1000 + seed), sigma=sigma))
        found = solve(seen(seed, views, tilt_deg), "opencv", options)
        assert found.status == "converged"
        error = found.camera.params - TRUE.params
        squares.append(error @ np.linalg.solve(found.param_covariance, error) / len(error))
    assert 0.7 < np.mean(squares) < 1.35  # 40 sets of nine numbers: .075, and a noise known by few observations


def test_a_prior_that_photos_contradict_is_named() -> None:
    """With what it says, what they say without it, and in no other case."""
    observations = seen(3, views=8, tilt_deg=30.0)
    off, fits = (
        solve(observations, "opencv", SolveOptions(priors=(ParameterPrior("fx_px", one, 4.0),)))
        for one in (2560.0, 2510.0)
    )
    (said,) = off.remarks
    alone = solve(observations, "opencv").camera.params[0]
    assert said.startswith("fx_px: the prior says 2560.00 ± 4, the photos without it ")
    assert float(said.split("without it ")[1].split()[0]) == pytest.approx(alone, abs=2.0)
    assert not fits.remarks
    judged, agreed = (judge_run([one], 0, NoHalves("not asked for"), read_criteria()).verdict for one in (off, fits))
    assert (judged.grade, judged.leads_with) == ("bad", "priors")
    assert judged.sentence.startswith(said)
    assert judged.advice[0].startswith("leave the prior that the photos contradict out")
    assert {check.name: check.grade for check in agreed.checks}["priors"] == "good"
    no_halves = NoHalves("not asked for")
    lens = replace(lens_evidence([off], 0, no_halves), reading="view1.png looks turned upside down")
    misread = judged_by(off, lens, no_halves, read_criteria(), ()).verdict  # as a wrong prior may make it look
    assert misread.leads_with == "priors"
    assert misread.advice == (judged.advice[0], "if that does not do: view1.png looks turned upside down")


def test_what_may_be_off_besides_noise_counts_with_priors_too() -> None:
    """Of parameters that priors hold nearly fast, an error of the target takes as little as of fixed ones."""
    sigma = {name: 1e-6 for name in TRUE.parameters if name not in ("fx_px", "fy_px")}
    fast = [f"{name}={TRUE.parameters[name]!r}+-{one!r}" for name, one in sigma.items()]
    fixed = [f"{name}={TRUE.parameters[name]!r}" for name in sigma]
    observations = seen(4, views=8, tilt_deg=30.0)
    by = [
        next(solve_models(SolveTask(observations, plan_from_words("opencv", fix=fix, prior=prior)))).calibration
        for fix, prior in ((fixed, []), ([], fast))
    ]
    assert by[1].camera.params == pytest.approx(by[0].camera.params, abs=1e-3)
    stated = [np.sqrt(np.diagonal(one.stated_covariance)[:2]) for one in by]
    assert stated[1] == pytest.approx(stated[0], rel=0.05)


def test_a_file_keeps_priors(tmp_path_factory: pytest.TempPathFactory) -> None:
    """A calibration that is read back is as sure, and is solved again as it was."""
    priors = drawn(np.random.default_rng(5))
    found, folder = solve(seen(5), "opencv", SolveOptions(priors=priors)), tmp_path_factory.mktemp("prior")
    origin = next(solve_models(SolveTask(seen(5), plan_from_words("opencv", prior=[one.text for one in priors]))))
    write_calibration(folder, found, origin.provenance)
    again, kept = read_calibration(folder / "calibration.json")
    assert again.priors == kept.options.priors == priors


def test_priors_of_a_rig_are_of_its_cameras() -> None:
    """They make the joint covariance smaller, and errors are as stated."""
    scene = stereo_pair(frames=6, seed=5)
    sigma = {"fx_px": 0.5, "cy_px": 0.5, "k1": 0.002}
    rng, squares = np.random.default_rng(0), []
    for seed in range(6):
        rig = stereo_pair(frames=6, seed=seed).observations
        choices = [CameraChoice("opencv", priors=drawn(rng, one, sigma)) for one in scene.cameras]
        found = solve_rig(rig, choices)
        for number, one in enumerate(scene.cameras):
            rows = found.rig.params_rows(number)
            error, covariance = found.cameras[number].params - one.params, found.covariance[rows, rows]
            squares.append(error @ np.linalg.solve(covariance, error) / len(error))
            assert (scenes.sigma_of(covariance)[[0, 3, 4]] < list(sigma.values())).all()
    assert 0.6 < np.mean(squares) < 1.5


@pytest.mark.parametrize(
    ("text", "prior"),
    [
        ("fx=1250+-10px", ParameterPrior("fx_px", 1250.0, 10.0)),
        ("fy_px = 1250px ± 1%", ParameterPrior("fy_px", 1250.0, 12.5)),
        ("k1=-1e-1+/-.02", ParameterPrior("k1", -0.1, 0.02)),
        ("tau_x=0+-2deg", ParameterPrior("tau_x", 0.0, np.radians(2.0))),
        ("tau_y=.5+-.1rad", ParameterPrior("tau_y", 0.5, 0.1)),
    ],
)
def test_a_prior_is_typed_with_its_unit(text: str, prior: ParameterPrior) -> None:
    """Or without, in the parameter's own; a value without one has that of the deviation."""
    (found,) = plan_from_words("opencv14", prior=[text]).options.priors
    assert found.name == prior.name
    assert (found.value, found.sigma) == pytest.approx((prior.value, prior.sigma))


@pytest.mark.parametrize(
    "text", ["", "fx", "fx=1", "fx=1+-0", "fx=-5+-1", "fx=1+-nan", "fx=1+-2+-3", "q=1+-1", "fx=1+-1mm", "k1=0+-1px"]
)
def test_a_prior_that_means_nothing_is_refused(text: str) -> None:
    """In one line."""
    with pytest.raises(InputError) as caught:
        plan_from_words("opencv", prior=[text])
    assert "\n" not in str(caught.value)


def test_what_takes_no_prior_says_so() -> None:
    """A parameter that is fixed, a cost in space, and a lens that is no formula."""
    with pytest.raises(InputError, match="fixed and has a prior"):
        plan_from_words("opencv", prior=["fx=1+-1"], fix=["fx"])
    for model, options in (("opencv", {"minimise": "ray"}), ("splined", {})):
        with pytest.raises(InputError, match="--prior"):
            solve(seen(0), model, SolveOptions(priors=(ParameterPrior("fx_px", 1.0, 1.0),), **options))  # type: ignore[arg-type]
