"""What photos of a coupon tell of a printer, against prints that are known: error, stated sigma, and how they agree.

    python -m tests.benchmarks.bench_coupon [SEEDS]

Each seed draws a print (bleed 0 to 0.2 mm along x and y, size and axes 0.3 %, skew 0.15 deg), a camera within what is
assumed of cameras (its focal length off what the file states, its principal point off the middle, a little radial
distortion), light, blur, noise, tone curve and sharpening. The photos are drawn by `tests.support.coupon_photos`, which
shares no line with what measures. The size is told by two lengths of a caliper with 0.01 mm, the limit being the
caliper's. `curved` has an S-curve and defocus beyond what is usual: what the model does not have.

Columns: root mean square of the error, and the root mean square of the error over the stated sigma (1 is honest).
"""

import sys
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from calib.coupons.edges import edges_of
from calib.coupons.place import KnownLength, PlacedPictures, Sighting, place
from calib.coupons.reading import read_edges
from calib.coupons.result import PrinterFaults, found_in
from calib.detector.pipeline import detect
from designer.kinds.coupon import COUPON
from tests.support.coupon_photos import Printed, Taken, coupon_photo, scan_of

TARGET = COUPON.lay_out()
GOAL = {"bleed mm": 0.02, "size %": 0.05, "axes %": 0.05, "skew deg": 0.05}
CALIPER_MM = 0.01
LENGTHS = ((0, 4), (0, 20))
Draw = Callable[[np.random.Generator], list[Taken]]


def camera(rng: np.random.Generator) -> Taken:
    """A phone's, before it is pointed at anything."""
    width, height = 2000, 1500
    diagonal = np.hypot(width, height)
    return Taken(
        size=(width, height), focal_px=1700 * np.exp(rng.normal(0, 0.03)), distance_mm=rng.uniform(74, 90),
        centre_px=tuple(rng.normal(0, 0.006 * diagonal, 2)), radial=rng.normal(0, 0.015),
        blur_px=rng.uniform(0.7, 1.6), gamma=rng.uniform(1.8, 2.4), sharpening=rng.choice([0, 0.3, 0.8]),
        noise=rng.uniform(0.7, 3), gradient=rng.uniform(0, 0.4), veil=rng.uniform(0, 0.03), jpeg=95,
    )  # fmt: skip


def pointed(taken: Taken, rng: np.random.Generator, most_deg: float, turn_deg: float = 0.0) -> Taken:
    """The camera held at an angle, and turned."""
    return replace(
        taken, tilt_rad=np.radians(rng.uniform(0, most_deg)), tilt_to_rad=rng.uniform(0, 2 * np.pi),
        roll_rad=np.radians(turn_deg + rng.uniform(-5, 5)),
    )  # fmt: skip


def one(rng: np.random.Generator) -> list[Taken]:
    """A photo squarely from above, by eye."""
    return [pointed(camera(rng), rng, 4)]


def tilted(rng: np.random.Generator) -> list[Taken]:
    """A photo from the side."""
    return [pointed(camera(rng), rng, 20)]


def four(rng: np.random.Generator) -> list[Taken]:
    """The coupon turned by a quarter between photos."""
    taken = camera(rng)
    return [pointed(taken, rng, 12, turn) for turn in (0, 90, 180, 270)]


def curved(rng: np.random.Generator) -> list[Taken]:
    """A photo squarely from above, with an S-curve or defocus."""
    (taken,) = one(rng)
    gamma, contrast = rng.uniform(1.5, 2.8), rng.uniform(0, 0.5)
    return [replace(taken, contrast=contrast, defocus_px=rng.choice([0.0, 2.0]), gamma=gamma)]


def scan(rng: np.random.Generator) -> list[Taken]:
    """A flatbed at 600 dpi, as good as is assumed of one."""
    turn = np.radians(rng.uniform(-3, 3))
    own = (rng.normal(0, 1e-3), rng.normal(0, 3e-4))
    return [replace(scan_of(600, blur_px=rng.uniform(0.6, 1.2)), roll_rad=turn, scan_strain=own)]


DRAWS: Mapping[str, Draw] = {"one photo": one, "tilted": tilted, "four photos": four, "curved": curved, "scan": scan}


def printed(rng: np.random.Generator) -> Printed:
    """A print."""
    size, stretch, skew = rng.normal(0, (0.003, 0.003, np.radians(0.15)))
    return Printed(tuple(rng.uniform(0, 0.2, 2)), (0, 0), (size + stretch / 2, size - stretch / 2, skew / 2))


def sighting(image: np.ndarray, taken: Taken) -> Sighting:
    """The rings in a photo."""
    found = detect(image, TARGET, name="")
    return Sighting(
        taken.size, found.ring, found.center_px, found.cov_px2, None if taken.scan_dpi else 1700.0, taken.scan_dpi
    )


def looked(
    pictures: list[tuple[np.ndarray, Taken]], lengths: list[KnownLength]
) -> tuple[PlacedPictures, PrinterFaults]:
    """What they tell."""
    placement = place(TARGET, [sighting(image, taken) for image, taken in pictures], lengths)
    edges = edges_of(TARGET)
    readings = [
        read_edges(image.astype(float), placed, edges)
        for (image, _), placed in zip(pictures, placement.placed, strict=True)
    ]
    known = bool(lengths) or pictures[0][1].scan_dpi is not None
    return placement, found_in(TARGET, placement, [one for one in readings if one], size_known=known)


def trial(draw: Draw, seed: int) -> dict[str, tuple[float, float]]:
    """Errors and stated sigmas of a seed."""
    rng = np.random.default_rng(seed)
    truth, takes = printed(rng), draw(rng)
    pictures = [(coupon_photo(truth, taken, rng), taken) for taken in takes]
    shape, lengths = truth.print_from_design, []
    if takes[0].scan_dpi is None:
        for a, b in LENGTHS:
            true_mm = np.linalg.norm(shape @ (TARGET.center_mm[a] - TARGET.center_mm[b])[:2])
            lengths.append(KnownLength(a, b, true_mm + rng.normal(0, CALIPER_MM), CALIPER_MM))
    _, found = looked(pictures, lengths)
    xx, yy, xy = truth.strain
    size, axis, skew = found.whole.size, found.whole.axes["x"], found.whole.skews_rad["xy"]
    assert size is not None
    numbers = {
        "bleed mm": (found.bleed_mm.value - np.mean(truth.bleed_mm), found.bleed_mm.sigma),
        "bleed x mm": (found.black_mm["x"].value - truth.bleed_mm[0], found.black_mm["x"].sigma),
        "bleed y mm": (found.black_mm["y"].value - truth.bleed_mm[1], found.black_mm["y"].sigma),
        "y - x mm": (
            found.y_beyond_x_mm.value - (truth.bleed_mm[1] - truth.bleed_mm[0]), found.y_beyond_x_mm.sigma,
        ),
        "size %": (100 * (size.value - (xx + yy) / 2), 100 * size.sigma),
        "axes %": (100 * (axis.value - (xx - yy) / 2), 100 * axis.sigma),
        "skew deg": (np.degrees(skew.value + 2 * xy), np.degrees(skew.sigma)),
    }  # fmt: skip
    return {name: (float(error), float(sigma)) for name, (error, sigma) in numbers.items()}


def main() -> None:
    """The table."""
    seeds = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    names = sys.argv[2:] or list(DRAWS)
    print(f"{'':28}{'goal':>8}{'rms error':>12}{'largest':>10}{'stated':>10}{'rms error/sigma':>17}{'within 2':>10}")
    for name in names:
        trials = [trial(DRAWS[name], 1000 + seed) for seed in range(seeds)]
        for quantity in trials[0]:
            error, sigma = np.array([one[quantity] for one in trials]).T
            goal = 0.005 if name == "scan" and "bleed" in quantity else GOAL.get(quantity, 0.02)
            print(
                f"{name:14}{quantity:14}{goal:8.3f}{np.sqrt((error**2).mean()):12.4f}{np.abs(error).max():10.4f}"
                f"{np.median(sigma):10.4f}{np.sqrt(((error / sigma) ** 2).mean()):17.2f}"
                f"{100 * (np.abs(error) < 2 * sigma).mean():9.0f}%",
                flush=True,
            )


if __name__ == "__main__":
    main()
