"""How much wider the ink of a print is, from the rings of photos of it."""

from dataclasses import replace

import numpy as np
import pytest

from calib.app.detect import Detector
from calib.app.measure_page import ink_finding
from calib.app.render import render
from calib.core.types import Detections
from calib.coupon_reading.ink_of_rings import InkBleed, ink_of_cameras, ink_of_rings
from calib.measure_target.deviations import Estimate
from calib.renderer.options import RenderOptions
from designer.base.arrays import Array
from designer.kinds.board import BoardSpec
from designer.kinds.layout import lay_out
from designer.target import TargetGeometry
from designer.tolerance.shape import shape_of, target_of
from designer.tolerance.sources.ink_bleed import SOURCE as INK_BLEED

BOARD = lay_out(BoardSpec((200.0, 150.0), 5.0, 13, 9, "triangular", 12.0, 0.45, 15.0, 1.0, 4.0, dots=True))
RADIUS_MM, HOLE_MM = float(BOARD.radius_outer_mm[0]), float(BOARD.radius_inner_mm.max())


def displaced_ratio(axes: tuple[float, float], ratio: float, shift_px: float) -> float:
    """The ratio of two alike ellipses that fit outlines displaced along their normals: outwards, and into the hole."""
    angle = (np.arange(400) + 0.5) * np.pi / 200
    cos, sin = np.cos(angle), np.sin(angle)
    normal = np.column_stack([axes[1] * cos, axes[0] * sin])
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    length = np.hypot(axes[0] * sin, axes[1] * cos)
    by_axes, by_ratio = np.column_stack([cos, sin]) * normal, (axes * np.column_stack([cos, sin]) * normal).sum(axis=1)
    design = np.vstack([np.column_stack([by_axes, np.zeros(400)]), np.column_stack([ratio * by_axes, by_ratio])])
    weight = np.sqrt(np.concatenate([length, ratio * length]))
    left = np.repeat([shift_px, -shift_px], 400)
    return ratio + float(np.linalg.lstsq(design * weight[:, None], left * weight, rcond=None)[0][2])


def photo(
    number: int, bleed_mm: float, shift_blurs: float, px_per_mm: float, slant: float, blur_px: float
) -> Detections:
    """The board, all rings alike, seen by optics that displace edges."""
    ring = np.flatnonzero(~BOARD.is_dot)
    count, ink = len(ring), (HOLE_MM - bleed_mm) / (RADIUS_MM + bleed_mm)
    axes = (px_per_mm * (RADIUS_MM + bleed_mm), slant * px_per_mm * (RADIUS_MM + bleed_mm))
    ratio = displaced_ratio(axes, ink, shift_blurs * blur_px)
    ratios = ratio + np.random.default_rng(number).normal(0, 0.003 / axes[1], count)
    return Detections(
        f"{number}.png", (4000, 3000), BOARD.layout_id, BOARD.geometry_id, ring, BOARD.center_mm[ring],
        np.zeros((count, 2)), np.tile(np.eye(2), (count, 1, 1)), np.tile([0, 0, *axes, 0], (count, 1)), (),
        ratio=ratios, blur_px=np.full(count, blur_px),
    )  # fmt: skip


def photos(bleed_mm: float, shift_blurs: float, sizes: Array) -> list[Detections]:
    """From far and near, more and less aslant."""
    return [
        photo(k, bleed_mm, shift_blurs, size, 1 - 0.06 * (k % 7), 0.8 + 0.05 * (k % 3)) for k, size in enumerate(sizes)
    ]


@pytest.mark.parametrize("bleed_mm", [-0.06, 0.0, 0.12])
@pytest.mark.parametrize("shift_blurs", [-0.45, 0.0, 0.3])
def test_bleed_is_told_from_what_optics_do(bleed_mm: float, shift_blurs: float) -> None:
    """Optics displace edges alike in px, bleed alike in mm: photos from several distances tell them apart."""
    told = ink_of_rings(photos(bleed_mm, shift_blurs, np.geomspace(5.0, 14.0, 12)), BOARD)
    assert told is not None
    assert abs(told.bleed_mm.value - bleed_mm) < min(0.01, 2 * told.bleed_mm.sigma)
    assert told.bleed_mm.sigma < 0.02
    assert np.sign(told.seen_mm - bleed_mm) == np.sign(shift_blurs) or abs(told.seen_mm - bleed_mm) < 1e-3


def test_photos_all_alike_say_how_little_they_tell() -> None:
    """From one distance and one side, ink and optics are not told apart, and the stated sigma says so."""
    near = [photo(k, 0.0, -0.45, 8.0, 0.9, 0.8) for k in range(12)]
    told = ink_of_rings(near, BOARD)
    assert told is not None
    assert abs(told.bleed_mm.value) < 2 * told.bleed_mm.sigma
    assert told.bleed_mm.sigma > 0.03
    assert told.more_offset_mm == 0


def test_rings_without_room_for_their_blur_or_known_edges_tell_nothing() -> None:
    """Small or blurred rings, few photos, and detections of older files: nothing is told."""
    sharp = photos(0.0, 0.0, np.geomspace(5.0, 14.0, 12))
    assert ink_of_rings([replace(one, blur_px=9 * one.blur_px) for one in sharp], BOARD) is None
    assert ink_of_rings([replace(one, ratio=None, blur_px=None) for one in sharp], BOARD) is None
    assert ink_of_rings(sharp[:4], BOARD) is None
    assert ink_of_rings([], BOARD) is None


def printed(target: TargetGeometry, bleed_mm: float) -> TargetGeometry:
    """A target whose ink has run."""
    return target_of(INK_BLEED.apply(shape_of(target), np.array([[bleed_mm]])))


@pytest.mark.parametrize(("bleed_mm", "gamma", "blur_px"), [(0.08, 2.2, 0.9), (-0.05, 1.0, 0.6)])
def test_stated_sigma_covers_in_rendered_photos(bleed_mm: float, gamma: float, blur_px: float) -> None:
    """Photos with a tone curve, blur and noise tell the bleed they were rendered with."""
    options = RenderOptions(blur_px=blur_px, gamma=gamma, contrast_to_noise=60.0, black=0.06, white=0.7)
    shown = render(
        printed(BOARD, bleed_mm), views=6, distance_mm=(250.0, 600.0), random_roll=True, options=options, seed=3
    )
    detector = Detector(BOARD)
    told = ink_of_rings([detector.detect(shown.image(view), f"{view}.png") for view in range(6)], BOARD)
    assert told is not None
    assert abs(told.bleed_mm.value - bleed_mm) < 2 * told.bleed_mm.sigma
    assert told.bleed_mm.sigma < 0.02
    assert told.bleed_mm.is_significant


def test_several_cameras_do_not_average_out_what_none_sees() -> None:
    """The sigma of several is that of each, not less."""
    one = InkBleed(Estimate(0.06, 0.01), 0.02, 100, 10)
    both = ink_of_cameras([one, one])
    assert both is not None
    assert both.bleed_mm.value == pytest.approx(0.06)
    assert both.bleed_mm.sigma == pytest.approx(0.01)
    assert (both.rings, both.views) == (200, 20)
    assert ink_of_cameras([]) is None


def test_finding_says_what_to_print_with() -> None:
    """Bleed beyond noise names the option that takes it back; less does not."""
    wide = ink_finding(InkBleed(Estimate(0.062, 0.01), 0.02, 100, 10)).text
    assert wide == (
        "0.062 ± 0.010 mm wider at each edge than designed; next print: --ink-offset -0.06mm, added to what this one "
        "was made with."
    )
    noise = ink_finding(InkBleed(Estimate(-0.02, 0.01), 0.02, 100, 10)).text
    assert noise == "0.020 ± 0.010 mm narrower at each edge than designed: it may be noise."
