"""Where numpy's own inverses may stand."""

import ast
from pathlib import Path

import calib
import designer

BARE = {"inv", "pinv", "solve", "lstsq", "cholesky", "tensorsolve", "cho_factor", "cho_solve", "solve_triangular"}

ALLOWED = {
    "designer/base/solid.py Faceted.corners_mm": "a shortest solution, which any planes that meet have",
    "designer/kinds/faceted.py _clipped": "a shortest solution, which any polygon's sides have",
    "calib/core/linear_algebra.py covariance_with_prior": "a guarded function itself",
    "calib/core/linear_algebra.py least_squares": "a guarded function itself",
    "calib/core/linear_algebra.py pseudo_inverse": "a guarded function itself",
    "calib/measure_target/accuracy.py accuracy_of": "one plus the strain of a print, which is small",
    "calib/measure_target/datum.py moved_target": "a rotation times one plus a small strain",
    "calib/solver/eliminate.py _scaled_factor": "by Cholesky, which tells whether there is an inverse",
    "calib/solver/eliminate.py damped_step": "by Cholesky, which tells whether there is an inverse",
    "calib/solver/eliminate.py covariance_factor": "by Cholesky, which tells whether there is an inverse",
    "calib/measure_target/expected.py with_seen_spread": "a normal matrix with a prior on each unknown",
    "calib/measure_target/solve.py _about_effective": "a normal matrix with a prior on each unknown",
    "calib/coupon_reading/ink_of_rings.py _fit": "a normal matrix with a prior on each unknown",
    "calib/coupon_reading/place.py Placed.design": "a plane that was seen with its rings, so not from its edge",
    "calib/coupon_reading/place.py _solved": "poses of planes by many rings, and priors on what these may not tell",
    "calib/coupon_reading/reading.py _solve": "damped: a diagonal of ones with more on it",
    "calib/coupon_reading/reading.py _stepped": "a normal matrix with a prior on each unknown",
    "calib/coupon_reading/reading.py _told": "a normal matrix with priors; a pseudo-inverse, which any has",
    "calib/coupon_reading/result.py _mean": "Cholesky of the inverse of a normal matrix with a prior on each unknown",
    "calib/cameras/learned.py exact_variance": "a Gram matrix with the knots' noise on its diagonal",
    "calib/detector/lines.py fit_lines": "a covariance plus a floor",
    "calib/detector/frame_quality.py _moments": "a shortest solution, of few equations with finite numbers",
    "calib/studies/tolerance/seen.py corner_covariances": "information plus a floor",
    "calib/detector/naming.py _uprightness": "a shortest solution, which two columns always have",
    "calib/detector/where_expected.py _plane_map": "shortest solutions, whose points were found to span a plane",
    "calib/cameras/formats/opencv.py write_rig": "the linear part of a camera, whose focal lengths are more than zero",
    "calib/cameras/formats/mrcal_surface.py surface_of": "smoothed by its bends, which leave no control point free",
    "calib/rigs/pose_pairs.py _fitted": "variances kept from nothing by a prior, as is the normal matrix",
    "calib/rigs/accuracy.py shared_inverse": "what cannot be inverted is caught, and said to be undetermined",
    "calib/rigs/robot_readings.py _ways": "a normal matrix with more on its diagonal",
    "calib/judge/photo_scores.py PhotoScores.odd_frame": "one plus a covariance",
    "calib/judge/drift.py _in_standard": "one plus covariances",
    "calib/judge/drift.py _own_photos": "a unit triangular matrix, of turns about other centres",
    "calib/judge/reading.py _own_centres": "a shortest solution, which any photo has",
    "calib/rigs/motion.py Motion.speed_covariance": "a Gram matrix with the poses' noise on its diagonal",
    "calib/rigs/motion.py motion_of": "a Gram matrix with the poses' noise on its diagonal",
    "calib/rigs/motion.py _most_likely": "a Gram matrix with the poses' noise on its diagonal",
    "calib/solver/metrics/reconstruction.py reconstruction": "of the rings whose rays were found to meet in a point",
    "calib/cameras/refit.py _adjust": "damped: a diagonal of ones with more on it",
    "calib/solver/image_field.py _likeliest": "Cholesky of correlations on a grid, no node near another",
    "calib/solver/accuracy.py accuracy_of": "poses by Cholesky before, which tells whether they are determined",
    "calib/solver/linear_pose.py weak_perspective_poses": "of the views whose points were found to be solid",
    "calib/studies/compare/scene.py photograph": "Cholesky of the detector's covariances, as its noise is drawn",
    "calib/studies/near.py expand": "Cholesky, which tells whether there is a root, and is asked",
    "calib/studies/near.py _solved": "what cannot be solved is caught, and solved from scratch",
    "calib/studies/tolerance/anchor.py factorise": "a camera that was found determined, by Cholesky",
    "calib/studies/tolerance/anchor.py _with_second": "a camera that was found determined, by Cholesky",
    "calib/studies/tolerance/anchor.py _roots": "a camera that was found determined, by Cholesky",
    "calib/studies/tolerance/anchor.py _root_and_inverse": "a camera that was found determined, by Cholesky",
    "calib/studies/tolerance/anchor.py _History.corrected": "a shortest solution of a few steps",
    "calib/studies/tolerance/first_order.py first_order": "rings that face the camera, by their incidence",
    "calib/studies/tolerance/first_order.py _sums": "a shortest solution, which any rings have",
    "calib/studies/tolerance/first_order.py _rebuilt_by_pixel": "of the rings whose rays were found to meet in a point",
    "calib/studies/tolerance/seen.py map_error_px": "three turns, seen over a whole image",
    "calib/studies/tolerance/setting.py _setting": "Cholesky of the detector's covariances, as its noise is drawn",
    "calib/studies/tolerance/rig_costs.py SimulatedFrames._view": "Cholesky, as the detector's noise is drawn",
    "calib/solver/learn_views.py _combined": "shortest steps with a cut-off that is meant to forget",
    "designer/base/packed.py _root": "Cholesky, which tells whether there is a root, and is asked",
    "designer/make/assembly.py _tiles": "a turn and a shift",
    "designer/make/bed.py against_skew_along": "a skew of a printer's axes, which is small",
    "designer/tolerance/shape.py target_of": "a stretch within bounds that are checked before",
}
"""Functions that hold one, and why no data can make it singular, or who looks before."""


def bare_calls(source: str) -> list[tuple[str, str]]:
    """Functions in which a source names an inverse of numpy's or scipy's `linalg`, and which."""
    tree, found = ast.parse(source), []
    imported = {
        alias.asname or alias.name: alias.name
        for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) and (node.module or "").endswith("linalg")
        for alias in node.names if alias.name in BARE
    }  # fmt: skip

    def look(node: ast.AST, place: str) -> None:
        for child in ast.iter_child_nodes(node):
            if isinstance(child, ast.FunctionDef | ast.ClassDef):
                look(child, f"{place}.{child.name}".lstrip("."))
                continue
            if isinstance(child, ast.Attribute) and child.attr in BARE and ast.unparse(child.value).endswith("linalg"):
                found.append((place, child.attr))
            if isinstance(child, ast.Name) and child.id in imported:
                found.append((place, imported[child.id]))
            look(child, place)

    look(tree, "")
    return found


def test_inverses_of_what_data_make_are_guarded() -> None:
    """An inverse goes through `calib.core.linear_algebra`, or stands in a function that says here why it exists."""
    root = Path(calib.__file__).parent.parent
    assert root == Path(designer.__file__).parent.parent
    files = [path for package in ("calib", "designer") for path in sorted((root / package).rglob("*.py"))]
    holding = {
        f"{path.relative_to(root).as_posix()} {place}"
        for path in files
        if "linalg" in (text := path.read_text(encoding="utf-8"))
        for place, _ in bare_calls(text)
    }
    assert sorted(holding - set(ALLOWED)) == []
    assert sorted(set(ALLOWED) - holding) == []


def test_every_way_of_calling_one_is_seen() -> None:
    """By the module, by its alias, or by name, and in which function."""
    text = (
        "from scipy.linalg import cho_solve as by_parts\nnp.linalg.inv(a)\nfrom numpy import linalg\n"
        "class A:\n    def b(self):\n        return [by_parts(c) for c in linalg.solve(a, b)]"
    )
    assert sorted(bare_calls(text)) == [("", "inv"), ("A.b", "cho_solve"), ("A.b", "solve")]
