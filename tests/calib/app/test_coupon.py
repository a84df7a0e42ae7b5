"""Photos of a coupon tell the print that they show, and those that tell nothing say why."""

import math
import re
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.special import ndtri

import calib
import designer
from calib.coupon_reading.edges import Tone, edges_of
from calib.coupon_reading.place import Sighting, place
from calib.coupon_reading.reading import MUCH_CUT_OFF, OPEN, EdgeFit, EdgeShape, Reading, either, read_edges
from calib.coupon_reading.result import CouponMadeWith, found_in, next_of
from calib.detector.pipeline import detect
from calib.measure_target.deviations import Estimate
from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.kinds.coupon import COUPON as SPEC
from designer.kinds.coupon import WIDTHS_MM
from tests.support.coupon_photos import Printed, Taken, coupon_photo, developed, pose_of, reflected, scan_of

PRINT = Printed((0.17, 0.02), (0.03, 0.03), (0.004, 0.001, 0.002))
SQUARE = Taken(size=(1200, 900), focal_px=1050, distance_mm=77, tilt_rad=0.03, sharpening=0.4, jpeg=95, light=0.75)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A photo and a scan of one print."""
    folder, rng = tmp_path_factory.mktemp("coupon"), np.random.default_rng(5)
    cv2.imwrite(str(folder / "photo.png"), coupon_photo(PRINT, SQUARE, rng))
    cv2.imwrite(str(folder / "scan.png"), coupon_photo(PRINT, scan_of(300), rng))
    return folder


@pytest.fixture(scope="module")
def scanned(folder: Path) -> calib.CouponReading:
    """What the scan tells."""
    return calib.coupon(folder / "scan.png", dpi=300)


@pytest.fixture(scope="module")
def photographed(folder: Path) -> calib.CouponReading:
    """What the photo tells, with two lengths of a caliper."""
    shape = PRINT.print_from_design
    lengths = (
        f"ring 0 to ring {to}:{np.linalg.norm(shape @ way):.4f}mm+-0.01mm"
        for to, way in ((4, [4 * SPEC.pitch_mm, 0]), (20, [0, 4 * SPEC.pitch_mm]))
    )
    return calib.coupon(folder / "photo.png", lengths=lengths)


@pytest.mark.parametrize("way", ["scanned", "photographed"])
def test_the_print_is_found(way: str, request: pytest.FixtureRequest) -> None:
    """Bleed by axis and colour, size, axes and skew are what was drawn, within three stated sigmas and the goals."""
    found = request.getfixturevalue(way).found
    expected = [
        (found.bleed_mm, 0.095, 0.01), (found.black_mm["x"], 0.17, 0.01), (found.black_mm["y"], 0.02, 0.01),
        (found.white_mm["x"], 0.20, 0.01), (found.white_mm["y"], 0.05, 0.01), (found.y_beyond_x_mm, -0.15, 0.003),
        (found.white_beyond_black_mm, 0.03, 0.003), (found.whole.size, 0.0025, 0.0015),
        (found.whole.axes["x"], 0.0015, 0.0008), (found.whole.skews_rad["xy"], -0.004, np.radians(0.05)),
    ]  # fmt: skip
    for one, truth, goal in expected:
        assert one.value == pytest.approx(truth, abs=goal)
        assert abs(one.value - truth) < 3 * one.sigma
    for width in found.widths:
        sign, more = (-1, 0.03) if width.feature == "white line" else (1, 0.0)
        bleeds = (0.17 + more, 0.02 + more)
        for printed, bleed in zip(width.printed_mm, bleeds, strict=True):
            assert printed.value == pytest.approx(width.designed_mm + 2 * sign * bleed, abs=0.02)


def test_what_is_told_takes_it_back(scanned: calib.CouponReading, tmp_path: Path) -> None:
    """The printer's file holds what was found, options of a design replace it, and a sheet has none of it."""
    told = scanned.next_print
    assert told.ink_offset_mm == pytest.approx(-0.095, abs=0.01)
    path = scanned.save_printer(tmp_path / "mine.toml", "prusa-xl")
    made = designer.board(size_mm=(80, 80), printer=str(path)).design.job.printing
    assert made.ink_offset_mm == told.ink_offset_mm
    assert made.skew_compensation_rad == pytest.approx(told.skew_rad)
    assert made.printer.bed_mm == (360, 360, 360)
    assert designer.board(size_mm=(80, 80), printer=str(path), ink_offset="0mm").design.job.printing.ink_offset_mm == 0
    assert designer.board(size_mm=(80, 80), printer=str(path), build="sheet").design.job.printing.ink_offset_mm == 0
    again = scanned.save_printer(tmp_path / "again.toml", str(path))
    assert again.read_text().count("ink_offset") == 1


def printed_again(first: Printed, printer: str) -> Printed:
    """What a printer with the faults of a first coupon makes of the files of a second, which were made for it."""
    plain, mended = (designer.coupon(**options).design.plates[0].pieces[0] for options in ({}, {"printer": printer}))
    target = SPEC.lay_out()
    found, radius_mm = [], []
    for piece in (plain, mended):
        ink, places = (
            piece.as_it_lies.ink,
            target.center_mm @ plain.bed_from_part[:3, :3].T + plain.bed_from_part[:3, 3],
        )
        assert ink is not None
        near = [ink.vertices_mm[np.hypot(*(ink.vertices_mm - place)[:, :2].T) < 3.6, :2] for place in places]
        found.append(np.array([(one.min(axis=0) + one.max(axis=0)) / 2 for one in near]))
        radius_mm.append(float(np.mean([np.ptp(one, axis=0).mean() / 2 for one in near])))
    bed_from_design = [np.linalg.lstsq(target.center_mm[:, :2], one - one.mean(axis=0))[0].T for one in found]
    seen = first.print_from_design @ np.linalg.inv(bed_from_design[0]) @ bed_from_design[1]
    left, stretch, right = np.linalg.svd(seen)
    shape = right.T * stretch @ right  # turned so that it is symmetric: how it lies in a photo is free
    assert np.linalg.det(left @ right) > 0
    scale = np.sqrt(np.linalg.det(bed_from_design[1] @ np.linalg.inv(bed_from_design[0])))
    grown_mm = radius_mm[1] / scale - radius_mm[0]
    x, y = first.bleed_mm
    return Printed((x + grown_mm, y + grown_mm), first.white_bleed_mm, (shape[0, 0] - 1, shape[1, 1] - 1, shape[0, 1]))


def test_the_next_print_is_right(photographed: calib.CouponReading, tmp_path: Path) -> None:
    """The printer's file takes size, skew and mean bleed back; what the axes and their bleeds differ by stays."""
    again = printed_again(PRINT, str(photographed.save_printer(tmp_path / "my-printer.toml")))
    xx, yy, xy = again.strain
    assert np.mean(again.bleed_mm) == pytest.approx(0, abs=0.01)
    assert again.bleed_mm[0] - again.bleed_mm[1] == pytest.approx(0.15)
    assert (xx + yy) / 2 == pytest.approx(0, abs=8e-4)
    assert xx - yy == pytest.approx(0.003, abs=1e-4)
    assert 2 * xy == pytest.approx(0, abs=np.radians(0.05))


def test_what_a_coupon_was_printed_with_counts(scanned: calib.CouponReading) -> None:
    """The next print has the offset of this one and what takes back what is left; noise changes nothing."""
    found, first = scanned.found, scanned.next_print
    assert next_of(found, CouponMadeWith(0.05)).ink_offset_mm == pytest.approx(first.ink_offset_mm + 0.05, abs=0.0051)
    noise = replace(found, bleed_mm=Estimate(0.01, 0.005))
    assert next_of(noise, CouponMadeWith(0.05)).ink_offset_mm == 0.05


def test_edges_are_all_of_the_drawing() -> None:
    """Circles of all rings and dots, and both edges of each line, each with room up to halfway to the next edge."""
    edges = edges_of(SPEC.lay_out())
    rings, dots, lines = 22, 3, 2 * 5 * 4
    assert len(edges) == 2 * rings + dots + 2 * lines
    rooms = {(edge.feature, round(edge.room_mm[0], 6)) for edge in edges if edge.feature != "ring"}
    assert rooms == {("white line", 0.9), *(("black line", width / 2) for width in WIDTHS_MM)}


@pytest.mark.parametrize("disc", [0.0, 0.3, 0.9])
def test_a_linear_file_has_a_symmetric_edge(disc: float) -> None:
    """Without a tone curve the profile is odd about its middle, and goes from 0 to 1."""
    profile = Tone(disc, 0.0, 0.0, 0.5, 0.3).profile((0.1, 0.8))
    x = np.linspace(0, 6, 50)
    assert profile.at(x) + profile.at(-x) == pytest.approx(np.ones(50), abs=1e-6)
    assert profile.at(np.array([-8.5, 8.5])) == pytest.approx([0, 1], abs=1e-3)


def test_a_power_moves_the_middle_into_the_ink() -> None:
    """By nearly half a blur at 2.2, as its equation says."""
    profile = Tone(0.0, np.log(2.2), 0.0, 0.0, 0.3).profile((0.04 ** (1 / 2.2), 0.85 ** (1 / 2.2)))
    x = np.linspace(-2, 2, 4001)
    middle = x[np.abs(profile.at(x) - 0.5).argmin()]
    light = ((0.04 ** (1 / 2.2) + 0.85 ** (1 / 2.2)) / 2) ** 2.2
    assert middle == pytest.approx(ndtri((light - 0.04) / 0.81), abs=2e-3)


BAD = {
    "overexposed": (Taken(size=(800, 600), focal_px=700, distance_mm=85, light=2.5), "overexposed"),
    "blurred": (Taken(size=(800, 600), focal_px=700, distance_mm=85, blur_px=5.0), "blurred|too far|rings were found"),
    "too far": (Taken(size=(800, 600), focal_px=700, distance_mm=400), "come nearer|too far|rings were found"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_photos_say_what_is_wrong(name: str, tmp_path: Path) -> None:
    """One line with what was seen and what to do."""
    taken, said = BAD[name]
    cv2.imwrite(str(tmp_path / "bad.png"), coupon_photo(PRINT, taken, np.random.default_rng(1)))
    with pytest.raises(InputError) as error:
        calib.coupon(tmp_path / "bad.png")
    assert re.search(said, str(error.value))
    assert "bad.png" in str(error.value)
    assert "\n" not in str(error.value)


OTHER_PICTURES = {
    "mirrored": (lambda photo: photo[:, ::-1], "mirrored"),
    "cut off": (lambda photo: photo[:, :500], "whole"),
    "two": (lambda photo: np.hstack([photo, photo]), "second one"),
    "drawn": (lambda photo: np.where(photo > 90, 255, 0), "two grey levels"),
}


@pytest.mark.parametrize("name", OTHER_PICTURES)
def test_pictures_of_something_else_say_what(name: str, folder: Path, tmp_path: Path) -> None:
    """Before edges are read, in one line with what to do."""
    change, said = OTHER_PICTURES[name]
    photo = cv2.imread(str(folder / "photo.png"), cv2.IMREAD_GRAYSCALE)
    cv2.imwrite(str(tmp_path / "other.png"), change(photo).astype(np.uint8))
    with pytest.raises(InputError, match=rf"^other\.png: .*{said}"):
        calib.coupon(tmp_path / "other.png")


def test_a_crop_is_not_trusted(folder: Path) -> None:
    """Without its left and upper parts a photo tells another print, and its sigmas cover that."""
    photo, target = cv2.imread(str(folder / "photo.png"), cv2.IMREAD_GRAYSCALE), SPEC.lay_out()
    off, sigma = [], []
    for picture in (photo, photo[60:, 200:]):
        seen = detect(picture, target, name="")
        found = place(target, [Sighting(seen.image_size, seen.ring, seen.center_px, seen.cov_px2, 1050.0)])
        off.append(found.print_numbers[1:] - [PRINT.strain[0] - PRINT.strain[1], 2 * PRINT.strain[2]])
        sigma.append(np.sqrt(np.diagonal(found.covariance))[1:])
    assert (np.abs(off) < 3 * np.array(sigma)).all()
    assert (sigma[1] > 5 * sigma[0]).all()


LINEAR = Taken(size=(1200, 900), focal_px=1050, distance_mm=80, tilt_rad=0.03, gamma=1.0)
LINEAR_PHOTOS = {
    "sharp": (replace(LINEAR, size=(1600, 1200), focal_px=1400, blur_px=0.6, tilt_to_rad=3.75), 2),
    "defocused": (replace(LINEAR, defocus_px=2.5), 3),
}
"""And every so many edges are read."""


EVEN = Printed((0.08, 0.08))


def read(photo: NDArray[np.uint8], taken: Taken, every: int = 1) -> tuple[Reading, Estimate]:
    """The edges of a photo, or every so many of them, and the bleed that they tell."""
    target = SPEC.lay_out()
    seen = detect(photo, target, name="")
    found = place(target, [Sighting(seen.image_size, seen.ring, seen.center_px, seen.cov_px2, taken.focal_px)])
    reading = read_edges(photo.astype(float), found.placed[0], edges_of(target)[::every])
    assert reading is not None
    return reading, found_in(target, found, [reading], size_known=False).bleed_mm


@pytest.mark.parametrize("name", LINEAR_PHOTOS)
def test_a_linear_photo_is_told_as_linear(name: str) -> None:
    """Its bleed is within two stated sigmas, which are the goal's: no edge that strays holds up the tone curve."""
    taken, every = LINEAR_PHOTOS[name]
    reading, bleed = read(coupon_photo(EVEN, taken, np.random.default_rng([7, 0])), taken, every)
    assert abs(bleed.value - 0.08) < 2 * bleed.sigma
    assert bleed.sigma < 0.02
    assert reading.shape.tone.log_gamma == pytest.approx(0, abs=0.4)


@pytest.fixture(scope="module")
def light() -> Array:
    """What the lens sees of a print."""
    return reflected(EVEN, LINEAR, SPEC.lay_out())


PROCESSED = {
    "compressed": (replace(LINEAR, jpeg=70), 0.0),
    "sharpened": (replace(LINEAR, gamma=2.2, sharpening=1.5), 0.0),
    "cut off": (replace(LINEAR, gamma=2.2, sharpening=3.0), 0.05),
    "linear and cut off": (replace(LINEAR, sharpening=1.5), 0.1),
}
"""With the share of pixels that are cut off at least."""


@pytest.mark.parametrize("name", PROCESSED)
def test_processed_photos_state_what_they_tell(name: str, light: Array) -> None:
    """Bleed is within two stated sigmas whatever a program did, and cut off levels are noticed."""
    taken, cut_off = PROCESSED[name]
    reading, bleed = read(developed(light, taken, np.random.default_rng(2)), taken, every=3)
    assert abs(bleed.value - 0.08) < 2 * bleed.sigma
    assert bleed.sigma < 0.05
    assert (reading.cut_off > MUCH_CUT_OFF) == (cut_off > 0)
    assert reading.cut_off >= cut_off


def test_of_two_minima_as_good_neither_is_trusted() -> None:
    """What is told lies between, nearer to the one with the smaller misfit, and is as unsure as they are apart."""
    edge = edges_of(SPEC.lay_out())[0]

    def minimum(moved_mm: float, misfit: float) -> Reading:
        fit = EdgeFit(edge, np.full(4, moved_mm), 1e-12 * np.eye(4), np.zeros((4, OPEN)))
        shape = EdgeShape(np.array([1, 1, 0, 0, 0, *Tone().numbers]))
        return Reading((fit,), shape, np.eye(OPEN), 13.0, 1.5, misfit, (0.2, 0.8), 0, 0.0)

    for misfit in (1.0, 1.03, 1.2):
        (fit,) = either(minimum(0.08, 1.0), minimum(0.11, misfit)).fits
        share = (fit.moved_mm[0] - 0.08) / 0.03
        assert share == pytest.approx(1 / (1 + misfit**20))
        assert fit.by_shape[0, -1] == pytest.approx(0.03 * math.sqrt(share * (1 - share)))


def test_a_lens_that_nothing_straightened_is_solved() -> None:
    """Rings seen through a radial term of -0.2, off the middle by 1 %: stretch and skew within two stated sigmas."""
    target, taken = SPEC.lay_out(), replace(SQUARE, radial=-0.2, centre_px=(12.0, -9.0), distance_mm=62)
    turn, shift = pose_of(taken)
    placed = target.center_mm[:, :2] @ PRINT.print_from_design.T
    ray = placed @ turn[:, :2].T + shift
    straight = ray[:, :2] / ray[:, 2:]
    bent = straight * (1 + taken.radial * (straight**2).sum(axis=1, keepdims=True))
    pixel = bent * taken.focal_px + (np.array(taken.size) - 1) / 2 + taken.centre_px
    noisy = pixel + np.random.default_rng(3).normal(0, 0.01, pixel.shape)
    rings = np.arange(len(pixel))
    found = place(
        target, [Sighting(taken.size, rings, noisy, np.tile(1e-4 * np.eye(2), (len(pixel), 1, 1)), taken.focal_px)]
    )
    off = found.print_numbers[1:] - [PRINT.strain[0] - PRINT.strain[1], 2 * PRINT.strain[2]]
    assert (np.abs(off) < 2 * np.sqrt(np.diagonal(found.covariance))[1:]).all()
    assert found.placed[0].radial == pytest.approx(taken.radial, abs=0.02)


def test_wrong_resolutions_and_targets_are_refused(folder: Path) -> None:
    """A scan of another resolution, a photo taken for a scan, a target that is no coupon, a length it has not."""
    with pytest.raises(InputError, match=r"scanned at 30\d dpi"):
        calib.coupon(folder / "scan.png", dpi=600)
    with pytest.raises(InputError, match="states no resolution"):
        calib.coupon(folder / "scan.png", dpi="file")
    board = designer.board(size_mm=(60, 60)).geometry
    with pytest.raises(InputError, match="design coupon"):
        calib.coupon(folder / "scan.png", target=board)
    with pytest.raises(InputError, match="edge"):
        calib.coupon(folder / "scan.png", lengths="edge:60mm")
