"""Where numpy's own inverses may stand."""

import ast
from pathlib import Path

import calib
import designer

BARE = {"inv", "pinv", "solve", "lstsq", "cholesky", "tensorsolve", "cho_factor", "cho_solve", "solve_triangular"}

ALLOWED = {
    "calib/linear_algebra.py": "the guarded functions themselves",
    "calib/as_built/accuracy.py": "one plus the strain of a print, which is small",
    "calib/as_built/datum.py": "a rotation times one plus a small strain",
    "calib/as_built/eliminate.py": "by Cholesky, which tells whether there is an inverse",
    "calib/as_built/ring_spread.py": "a normal matrix with a prior on each unknown",
    "calib/as_built/solve.py": "a normal matrix with a prior on each unknown",
    "calib/cameras/learned.py": "a Gram matrix with the knots' noise on its diagonal",
    "calib/detect/alignment.py": "turns of a lattice, and its basis by steps that span it",
    "calib/detect/homography.py": "similarities that normalise, and a homography that was found determined",
    "calib/detect/judge.py": "rings' axes, of which those without an area are replaced before",
    "calib/detect/lens.py": "Jacobians of homographies where they show rings",
    "calib/detect/lines.py": "a covariance plus a floor",
    "calib/detect/name_board.py": "a shortest solution, which two columns always have",
    "calib/detect/place.py": "Jacobians of homographies where they show rings",
    "calib/detect/where_expected.py": "shortest solutions, whose points were found to span a plane",
    "calib/metrics/reconstruction.py": "of the rings whose rays were found to meet in a point",
    "calib/refit.py": "damped: a diagonal of ones with more on it",
    "calib/solver/covariance.py": "poses by Cholesky before, which tells whether they are determined",
    "calib/solver/linear_pose.py": "of the views whose points were found to be solid",
    "calib/studies/compare/scene.py": "Cholesky of the detector's covariances, as its noise is drawn",
    "calib/studies/expansion.py": "Cholesky, which tells whether there is a root, and is asked",
    "calib/studies/near.py": "what cannot be solved is caught, and solved from scratch",
    "calib/studies/tolerance/anchor.py": "a camera that was found determined, by Cholesky",
    "calib/studies/tolerance/map_error.py": "three turns, seen over a whole image",
    "calib/studies/tolerance/response.py": "rings that face the camera, by their incidence",
    "calib/studies/tolerance/setting.py": "Cholesky of the detector's covariances, as its noise is drawn",
    "calib/virtual/learn_views.py": "shortest steps with a cut-off that is meant to forget",
    "designer/bed.py": "a skew of a printer's axes, which is small",
    "designer/tolerance/shape.py": "a stretch within bounds that are checked before",
}
"""Files that hold some, and why no data can make these singular, or who looks before."""


def bare_calls(source: str) -> list[str]:
    """Names of inverses that a source takes from numpy's or scipy's `linalg`."""
    found = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Attribute) and node.attr in BARE and ast.unparse(node.value).endswith("linalg"):
            found.append(node.attr)
        if isinstance(node, ast.ImportFrom) and (node.module or "").endswith("linalg"):
            found += [name.name for name in node.names if name.name in BARE]
    return found


def test_inverses_of_what_data_make_are_guarded() -> None:
    """An inverse goes through `calib.linear_algebra`, or stands in a file that says why it exists."""
    root = Path(calib.__file__).parent.parent
    assert root == Path(designer.__file__).parent.parent
    files = [path for package in ("calib", "designer") for path in sorted((root / package).rglob("*.py"))]
    holding = {path.relative_to(root).as_posix() for path in files if bare_calls(path.read_text(encoding="utf-8"))}
    holding.discard("calib/linear_algebra.py")
    assert sorted(holding - set(ALLOWED)) == []
    assert sorted(set(ALLOWED) - holding - {"calib/linear_algebra.py"}) == []


def test_every_way_of_calling_one_is_seen() -> None:
    """By the module, by its alias, or by name."""
    text = "from scipy.linalg import cho_solve\nnp.linalg.inv(a)\nfrom numpy import linalg\nlinalg.solve(a, b)"
    assert sorted(bare_calls(text)) == ["cho_solve", "inv", "solve"]
