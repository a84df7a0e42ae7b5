"""How near to the physical limit are the centres? Monte-Carlo of one ring against bound and peers.

Run from the repository's root: `python -m tests.benchmarks.bench_centres [--rings N] [--seed S]`. Rings of R = 15 px
tilted by 45 degrees, focal length 1000 px, blur 0.7 px, contrast over noise 50, at random places within a pixel and
with random axes; once evenly lit, once with 30 % more light at one end of the ring than at the other (on the target,
before the lens blurs it). The pictures are drawn here, not by the renderer. Bounds: `var = 1 / (pi J (R + r))` with
the vanishing line known and `var = (R^5 + r^5) / (pi J R r (R^2 - r^2)^2)` without, for a ring seen straight on, with
`J = C^2 / (2 sqrt(pi) blur noise^2)`; the bound the estimators are held to is that of the tilted ring, from the
derivatives of the picture itself.
"""

import argparse
import math
import time
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.detector.ring_fit import fit_rings
from calib.detector.ring_model import PARAMETERS
from tests.benchmarks.synthetic import DARK, LIGHT, Array, Box, plane_view, ring_shade, rms, row

OUTER_PX, RATIO, TILT_RAD, FOCAL_PX = 15.0, 0.45, math.radians(45), 1000.0
BLUR_PX, NOISE, GRADIENT = 0.7, (LIGHT - DARK) / 50, 0.3
CELL, COLUMNS = 64, 25
FULL_SCALE = 40_000.0


@dataclass(frozen=True, eq=False)
class Rings:
    """A mosaic of N rings, each in a cell of its own."""

    image: NDArray[np.uint16]
    center_px: Array  # (N, 2)
    a: Array  # (N, 2, 2) u = c + A X / (1 + w X)
    w: Array  # (N, 2)


@dataclass(frozen=True, eq=False)
class Ring:
    """u = c + A X / (1 + w X) for |X| <= 1 and |X| <= ratio, and its light."""

    c: Array
    a: Array  # (2, 2)
    w: Array
    ratio: float = RATIO
    blur_px: float = BLUR_PX
    light: float = LIGHT
    dark: float = DARK
    slope: Array | None = None  # (2,) relative light per px

    def picture(self, box: Box) -> Array:
        """Noise-free intensities."""
        view = np.eye(3)
        view[:2, :2], view[:2, 2], view[2, :2] = self.a + np.outer(self.c, self.w), self.c, self.w
        shade = ring_shade(view, np.zeros(2), 1.0, self.ratio, box, self.blur_px, slope=self.slope)
        paper = np.full_like(shade, self.light)
        if self.slope is not None:
            u, v = (np.arange(n) - (n - 1) / 2 for n in (box.width, box.height))
            paper *= 1 + self.slope[0] * u + self.slope[1] * v[:, None]
        return paper - (self.light - self.dark) * shade


def random_ring(rng: np.random.Generator, corner: tuple[int, int], gradient: float) -> Ring:
    """A ring somewhere near the middle of a cell."""
    middle = np.array(corner) + (CELL - 1) / 2 + rng.uniform(-0.5, 0.5, 2)
    view = plane_view(FOCAL_PX, TILT_RAD, rng.uniform(0, 2 * np.pi), FOCAL_PX / OUTER_PX, middle)
    c, w = view[:2, 2], view[2, :2]
    angle = rng.uniform(0, 2 * np.pi)
    slope = gradient / (2 * OUTER_PX) * np.array([math.cos(angle), math.sin(angle)]) if gradient else None
    return Ring(c, view[:2, :2] - np.outer(c, w), w, slope=slope)


def random_rings(count: int, gradient: float, rng: np.random.Generator) -> Rings:
    """The mosaic, with noise."""
    lines = math.ceil(count / COLUMNS)
    image = np.empty((lines * CELL, COLUMNS * CELL))
    drawn = []
    for n in range(lines * COLUMNS):
        left, top = CELL * (n % COLUMNS), CELL * (n // COLUMNS)
        ring = random_ring(rng, (left, top), gradient)
        image[top : top + CELL, left : left + CELL] = ring.picture(Box(left, top, CELL, CELL))
        drawn.append(ring)
    image += NOISE * rng.standard_normal(image.shape)
    counts = np.clip(np.rint(FULL_SCALE * image), 0, 65535).astype(np.uint16)
    return Rings(counts, np.array([r.c for r in drawn]), np.array([r.a for r in drawn]), np.array([r.w for r in drawn]))


def numeric_bound(gradient: float, *, line_known: bool, rng: np.random.Generator, rings: int = 6) -> float:
    """Cramér-Rao bound of a centre, RMS of both axes, from central differences of the pictures of some rings."""
    variance = [bound_px2(random_ring(rng, (0, 0), gradient), gradient, line_known=line_known) for _ in range(rings)]
    return math.sqrt(float(np.mean(variance)))


def bound_px2(ring: Ring, gradient: float = 0.0, *, line_known: bool, side: int = CELL) -> float:
    """Cramér-Rao bound of the variance of a centre, mean of both axes, in a square picture of so many pixels."""
    box = Box(0, 0, side, side)
    start = _parameters(ring, gradient)
    step = np.array([0.05, 0.05, 0.05, 0.05, 0.05, 0.003, 0.01, 0.02, 0.02, 3e-4, 3e-4, 2e-4, 2e-4])[: len(start)]
    columns = []
    for n, size in enumerate(step):
        if line_known and n in (9, 10):
            continue
        shift = np.zeros(len(start))
        shift[n] = size
        high, low = (_from_parameters(start + s * shift, ring).picture(box) for s in (1, -1))
        columns.append(((high - low) / (2 * size)).ravel())
    jacobian = np.array(columns).T
    covariance = NOISE**2 * np.linalg.inv(jacobian.T @ jacobian)
    return float(np.trace(covariance[:2, :2])) / 2


def _parameters(ring: Ring, gradient: float) -> Array:
    """Centre, A turned to lower triangular, ratio, blur, levels, vanishing line, and the slope of the light if any."""
    turn, _ = np.linalg.qr(ring.a.T)  # A turn is lower triangular; X turns along and stays on its circle
    a, w = ring.a @ turn, turn.T @ ring.w
    values = [*ring.c, a[0, 0], a[1, 0], a[1, 1], ring.ratio, ring.blur_px, ring.light, ring.dark, *w]
    return np.array(values + (list(ring.slope) if gradient and ring.slope is not None else []))


def _from_parameters(p: Array, like: Ring) -> Ring:
    slope = p[11:13] if len(p) > 11 else like.slope
    return Ring(p[:2], np.array([[p[2], 0.0], [p[3], p[4]]]), p[9:11], p[5], p[6], p[7], p[8], slope)


def contour_centers(rings: Rings) -> Array:
    """Peer: centre of the ellipse through the outer Otsu contour of each cell, the one nearest to the middle."""
    found = []
    for cell, corner in _cells(rings):
        _, binary = cv2.threshold(cell, 0, 255, cv2.THRESH_BINARY_INV | cv2.THRESH_OTSU)
        contours, _ = cv2.findContours(binary, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        centers = [cv2.fitEllipse(contour)[0] for contour in contours if len(contour) >= 40]
        found.append(np.array(min(centers, key=lambda c: math.dist(c, (CELL / 2, CELL / 2)))) + corner)
    return np.array(found)


def blob_centers(rings: Rings) -> Array:
    """Peer: what `cv2.findCirclesGrid` puts into its grid, the centroid by SimpleBlobDetector (nan: none found).

    Told to look for light blobs, since a ring's middle is white: its default finds no ring at all.
    """
    options = cv2.SimpleBlobDetector.Params()
    options.blobColor = 255
    detector = cv2.SimpleBlobDetector.create(options)
    found = []
    for cell, corner in _cells(rings):
        points = [np.array(p.pt) for p in detector.detect(cell) if math.dist(p.pt, (CELL / 2, CELL / 2)) < 5]
        found.append(points[0] + corner if points else np.full(2, np.nan))
    return np.array(found)


def _cells(rings: Rings) -> list[tuple[NDArray[np.uint8], Array]]:
    levels = (rings.image / 256).astype(np.uint8)
    corners = [(CELL * x, CELL * y) for y in range(len(levels) // CELL) for x in range(COLUMNS)]
    return [(levels[y : y + CELL, x : x + CELL].copy(), np.array([x, y], dtype=float)) for x, y in corners]


def ours(rings: Rings, *, line_known: bool, rng: np.random.Generator) -> tuple[Array, Array, float]:
    """Centres (N, 2), covariances (N, 2, 2) and seconds of the detector's batch fit, from rough starts."""
    count = len(rings.center_px)
    back = np.linalg.inv(rings.a)
    # u = c + A X / (1 + w X) is X = A^-1 v / (1 - m v) with m = A^-T w; E is A^-1 turned to lower triangular.
    m = np.einsum("nji,nj->ni", back, rings.w)
    start = np.zeros((count, PARAMETERS))
    for n in range(count):
        upside = np.linalg.cholesky((back[n].T @ back[n])[::-1, ::-1])[::-1, ::-1].T
        start[n, 2:5] = upside[0, 0], upside[1, 0], upside[1, 1]
    start[:, 2:5] *= rng.uniform(0.97, 1.03, (count, 1))
    start[:, :2] = rings.center_px + rng.uniform(-0.5, 0.5, (count, 2))
    start[:, 7:10] = RATIO * rng.uniform(0.95, 1.05), 1.0, FULL_SCALE * LIGHT
    start[:, 12] = 0.85
    line = m if line_known else np.zeros((count, 2))
    information = np.tile(1e14 * np.eye(2), (count, 1, 1)) if line_known else None
    fit_rings(rings.image, start[:32], limit=1.6)  # compile
    began = time.perf_counter()
    fits = fit_rings(rings.image, start, limit=1.6, line=line, line_information=information)
    seconds = time.perf_counter() - began
    return np.where(fits.ok[:, None], fits.center_px, np.nan), fits.cov_px2, seconds


def report(name: str, gradient: float, goals: tuple[float, float], count: int, rng: np.random.Generator) -> None:
    """The table of one kind of light."""
    rings = random_rings(count, gradient, rng)
    print(f"{name}, {len(rings.center_px)} rings; RMSE per axis in px")
    for line_known, goal in zip((False, True), goals, strict=True):
        bound = numeric_bound(gradient, line_known=line_known, rng=rng)
        center, covariance, seconds = ours(rings, line_known=line_known, rng=rng)
        error = center - rings.center_px
        good = np.isfinite(error).all(axis=1)
        what = "vanishing line " + ("known" if line_known else "unknown")
        against = f"{rms(error[good]) / bound:.2f} x bound {bound:.4f}; worst {np.abs(error[good]).max():.3f}"
        row(f"intensity fit, {what}", f"<= {goal:.4f}", f"{rms(error[good]):.4f}", against)
        spread = math.sqrt(np.trace(covariance[good], axis1=1, axis2=2).mean() / 2) / rms(error[good])
        whitened = np.einsum("ni,nij,nj->n", error[good], np.linalg.inv(covariance[good]), error[good])
        row("  reported over observed sigma, pooled", "0.9-1.15", f"{spread:.3f}", f"chi2/2 {whitened.mean() / 2:.2f}")
        row("  fitted; ms a ring", "", f"{good.sum()}/{len(error)}", f"{1e3 * seconds / len(error):.2f} ms")
    for what, center in (("peer: ellipse on the Otsu contour (cv2)", contour_centers(rings)),
                         ("peer: SimpleBlobDetector (cv2.findCirclesGrid)", blob_centers(rings))):  # fmt: skip
        error = center - rings.center_px
        good = np.isfinite(error).all(axis=1)
        row(what, "", f"{rms(error[good]):.4f}", f"found {good.sum()}/{len(error)}")


def formula_bounds() -> tuple[float, float]:
    """The closed bounds for a ring seen straight on, free and with the vanishing line known; blur without pixel."""
    outer, inner = OUTER_PX, RATIO * OUTER_PX
    j = (LIGHT - DARK) ** 2 / (2 * math.sqrt(math.pi) * BLUR_PX * NOISE**2)
    free = (outer**5 + inner**5) / (math.pi * j * outer * inner * (outer**2 - inner**2) ** 2)
    return math.sqrt(free), math.sqrt(1 / (math.pi * j * (outer + inner)))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rings", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    rng = np.random.default_rng(arguments.seed)
    started = time.perf_counter()
    free, known = formula_bounds()
    print(f"bound seen straight on, by formula: {free:.4f} px free, {known:.4f} px with the line known")
    report("even light", 0.0, (0.0125, 0.0050), arguments.rings, rng)
    report("30 % light gradient", GRADIENT, (0.0130, 0.0060), arguments.rings, rng)
    print(f"{time.perf_counter() - started:.0f} s")


if __name__ == "__main__":
    main()
