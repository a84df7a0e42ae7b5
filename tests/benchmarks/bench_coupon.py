"""What photos of a coupon tell of a printer, against prints that are known: error, stated sigma, and how they agree.

    python -m tests.benchmarks.bench_coupon [SEEDS [CASE ...]]

Each seed draws a print (bleed 0 to 0.2 mm along x and y and up to 0.05 mm more at white lines, size and axes 0.3 %,
skew 0.15 deg), a camera within what is
assumed of cameras (its focal length off what the file states, its principal point off the middle, a little radial
distortion), light, blur, noise, tone curve and sharpening. The photos are drawn by `tests.support.coupon_photos`, which
shares no line with what measures. The size is told by two lengths of a caliper with 0.01 mm, the limit being the
caliper's. `curved` has an S-curve and defocus beyond what is usual: what the model does not have.

Columns: root mean square of the error, the largest, the usual stated sigma, root mean square and largest of the error
over the stated sigma (a mean square of 1 is honest), and how many lie within two sigmas. Two processes.
"""

import multiprocessing
import sys
from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial

import numpy as np

from calib.coupon_reading.edges import edges_of
from calib.coupon_reading.place import KnownLength, PlacedPictures, Sighting, place
from calib.coupon_reading.reading import read_edges
from calib.coupon_reading.result import PrinterFaults, found_in
from calib.detector.pipeline import detect
from designer.kinds.coupon import COUPON
from tests.support.coupon_photos import Printed, Taken, coupon_photo, scan_of

TARGET = COUPON.lay_out()
GOAL = {"bleed mm": 0.02, "size %": 0.05, "axes %": 0.05, "skew deg": 0.05}
CALIPER_MM = 0.01
LENGTHS, DIAGONALS = ((0, 4), (0, 20)), ((0, 24), (4, 20))
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


def processed(rng: np.random.Generator) -> list[Taken]:
    """A photo squarely from above, linear or not, compressed or sharpened until grey levels are cut off."""
    (taken,) = one(rng)
    sharpening, jpeg = rng.choice([0.0, 1.5, 3.0]), int(rng.choice([70, 85]))
    return [replace(taken, gamma=rng.choice([1.0, 2.2]), sharpening=sharpening, jpeg=jpeg)]


def barrel(rng: np.random.Generator) -> list[Taken]:
    """A photo squarely from above by a lens not straightened, its principal point off by 1 % of the diagonal."""
    (taken,) = one(rng)
    angle = rng.uniform(0, 2 * np.pi)
    return [replace(taken, radial=-0.11, centre_px=(25 * np.cos(angle), 25 * np.sin(angle)))]


def scan(rng: np.random.Generator) -> list[Taken]:
    """A flatbed at 600 dpi, as good as is assumed of one."""
    turn = np.radians(rng.uniform(-3, 3))
    own = (rng.normal(0, 1e-3), rng.normal(0, 3e-4))
    return [replace(scan_of(600, blur_px=rng.uniform(0.6, 1.2)), roll_rad=turn, scan_strain=own)]


DRAWS: Mapping[str, Draw] = {
    "one photo": one, "tilted": tilted, "tilted, 4 lengths": tilted, "four photos": four, "curved": curved,
    "processed": processed, "barrel": barrel, "scan": scan,
}  # fmt: skip
SEEDS: Mapping[str, int] = {"one photo": 100}
FEWER_SEEDS = 30


def printed(rng: np.random.Generator) -> Printed:
    """A print."""
    size, stretch, skew = rng.normal(0, (0.003, 0.003, np.radians(0.15)))
    white = rng.uniform(0, 0.05)
    return Printed(tuple(rng.uniform(0, 0.2, 2)), (white, white), (size + stretch / 2, size - stretch / 2, skew / 2))


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
    assert all(readings)
    known = bool(lengths) or pictures[0][1].scan_dpi is not None
    return placement, found_in(TARGET, placement, [one for one in readings if one], size_known=known)


def measured_lengths(truth: Printed, pairs: tuple[tuple[int, int], ...], rng: np.random.Generator) -> list[KnownLength]:
    """With a caliper."""
    lengths = []
    for a, b in pairs:
        true_mm = np.linalg.norm(truth.print_from_design @ (TARGET.center_mm[a] - TARGET.center_mm[b])[:2])
        lengths.append(KnownLength(a, b, true_mm + rng.normal(0, CALIPER_MM), CALIPER_MM))
    return lengths


def trial(name: str, seed: int) -> dict[str, tuple[float, float]]:
    """Errors and stated sigmas of a seed."""
    rng = np.random.default_rng(seed)
    truth, takes = printed(rng), DRAWS[name](rng)
    pairs = () if takes[0].scan_dpi else LENGTHS + DIAGONALS if "4 lengths" in name else LENGTHS
    lengths = measured_lengths(truth, pairs, rng)
    pictures = [(coupon_photo(truth, taken, np.random.default_rng([seed, k])), taken) for k, taken in enumerate(takes)]
    _, found = looked(pictures, lengths)
    return errors_of(found, truth)


def errors_of(found: PrinterFaults, truth: Printed) -> dict[str, tuple[float, float]]:
    """What was found against what was drawn, and its stated sigma."""
    xx, yy, xy = truth.strain
    x, y = truth.bleed_mm
    white = truth.white_bleed_mm[0]
    size, axis, skew = found.whole.size, found.whole.axes["x"], found.whole.skews_rad["xy"]
    assert size is not None
    numbers = {
        "bleed mm": (found.bleed_mm, (x + y) / 2, 1.0), "bleed x mm": (found.black_mm["x"], x, 1.0),
        "bleed y mm": (found.black_mm["y"], y, 1.0), "white x mm": (found.white_mm["x"], x + white, 1.0),
        "white y mm": (found.white_mm["y"], y + white, 1.0), "y - x mm": (found.y_beyond_x_mm, y - x, 1.0),
        "white-black mm": (found.white_beyond_black_mm, white, 1.0), "size %": (size, (xx + yy) / 2, 100.0),
        "axes %": (axis, (xx - yy) / 2, 100.0), "skew deg": (skew, -2 * xy, np.degrees(1.0)),
    }  # fmt: skip
    return {
        name: (float(unit * (one.value - true)), float(unit * one.sigma)) for name, (one, true, unit) in numbers.items()
    }


def main() -> None:
    """The table."""
    names = sys.argv[2:] or list(DRAWS)
    print(
        f"{'':33}{'goal':>7}{'rms error':>11}{'largest':>9}{'stated':>9}{'rms error/sigma':>17}{'largest':>9}"
        f"{'within 2':>10}"
    )
    with ProcessPoolExecutor(2, mp_context=multiprocessing.get_context("spawn")) as pool:
        for name in names:
            seeds = int(sys.argv[1]) if len(sys.argv) > 1 else SEEDS.get(name, FEWER_SEEDS)
            trials = list(pool.map(partial(trial, name), range(1000, 1000 + seeds)))
            for quantity in trials[0]:
                error, sigma = np.array([one[quantity] for one in trials]).T
                goal = 0.005 if name == "scan" and quantity.endswith("mm") else GOAL.get(quantity, 0.02)
                z = error / sigma
                print(
                    f"{name:18}{quantity:15}{goal:7.3f}{np.sqrt((error**2).mean()):11.4f}{np.abs(error).max():9.4f}"
                    f"{np.median(sigma):9.4f}{np.sqrt((z**2).mean()):17.2f}{np.abs(z).max():9.2f}"
                    f"{100 * (np.abs(z) < 2).mean():9.0f}%",
                    flush=True,
                )


if __name__ == "__main__":
    main()
