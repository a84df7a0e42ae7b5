"""Bodies for stickers: lips with clearance, numbers where stickers lie, and what is left of a hand's error."""

import math
from dataclasses import replace

import numpy as np
import pytest
from manifold3d import CrossSection, Manifold

from designer.base.errors import InputError
from designer.builds.design import Design
from designer.kinds.layout import lip_of
from designer.make.bed import bed_from_target, printed_size_mm
from designer.make.lip import engraved
from designer.make.mesh import placed, prism, solid_of
from designer.make.pattern import moved_in
from designer.tolerance.error_file import error_model
from designer.tolerance.made import error_model_for
from tests.support.designs import COARSE, design_of

WIDE: dict[str, object] = {"build": "stickers", "border": "2mm", "chord_error": COARSE}


def stickers(kind: str, **more: object) -> Design:
    return design_of(kind, edge="60mm", **{**WIDE, **more})


def sticker(design: Design, face: int, lift_mm: float) -> Manifold:
    """As it is cut and lies, in the target's frame."""
    lip, printing = lip_of(design.target, design.job.printing), design.job.printing
    cut = moved_in(design.target.outline_mm[face], lip.inset_mm)
    return placed(prism((cut,), lift_mm - printing.sticker_thickness_mm, lift_mm), design.target.target_from_face[face])


@pytest.mark.parametrize("kind", ["ico", "cube"])
def test_a_sticker_lies_in_its_lip_with_the_clearance_all_around(kind: str) -> None:
    """It touches nothing but its seat, its face is the target's, and every way aside ends after the clearance."""
    design = stickers(kind)
    body, target = solid_of(design.part.body), design.target
    clearance = design.job.printing.printer.clearance_mm
    for face in range(target.face_count - 1):
        there = sticker(design, face, 0.02)
        assert (there ^ body).volume() < 1e-9
        assert (sticker(design, face, -0.02) ^ body).volume() > 0.01 * there.volume()
        assert there.min_gap(body, 1.0) == pytest.approx(0.02, abs=1e-5)  # above its seat
        outline = target.outline_mm[face]
        for a, b in zip(outline, np.roll(outline, -1, axis=0), strict=True):
            out = np.array([b[1] - a[1], a[0] - b[0]]) / np.linalg.norm(b - a)
            for share, meets in ((0.99, False), (1.1, True)):
                step = target.target_from_face[face, :3, :2] @ (share * clearance * out)
                assert ((there.translate(tuple(step)) ^ body).volume() > 1e-6) is meets


@pytest.mark.parametrize("kind", ["ico", "cube"])
def test_the_face_on_the_bed_lies_flat(kind: str) -> None:
    """No pocket is closed over the bed: the last face has its seat lowest, a groove in it, and nothing below."""
    design = stickers(kind)
    printing, target = design.job.printing, design.target
    motion, vertices = bed_from_target(target, printing), design.part.body.vertices_mm
    assert (vertices @ motion[2, :3] + motion[2, 3]).min() == pytest.approx(0.0, abs=1e-6)
    assert np.ptp(vertices @ motion[:3, :3].T, axis=0) == pytest.approx(printed_size_mm(target, printing), abs=0.05)
    flat = solid_of(design.part.body).transform(np.linalg.inv(target.target_from_face[-1])[:3])
    layer = flat.slice(-printing.sticker_thickness_mm - 0.05)
    lip, outline = lip_of(target, printing), target.outline_mm[-1]
    seat, around = (CrossSection([moved_in(outline, inset)]) for inset in (lip.width_mm, lip.width_mm - 0.44))
    pits = CrossSection([*engraved(target, target.face_count - 1, printing)])
    assert ((seat - pits) - layer).area() < 1e-6
    assert ((around - seat) ^ layer).area() < 1e-6
    assert (layer - around).area() > 0.1 * (around - seat).area()


def test_each_face_has_its_number_under_its_sticker_and_the_way_to_its_corner() -> None:
    """Engraved two layers deep below the seat, within the sticker; the arrow's tip lies towards the code corner."""
    design = stickers("ico")
    body, plain = (solid_of(d.part.body) for d in (design, stickers("ico", labels=False)))
    layer, target = design.job.printing.printer.layer_height_mm, design.target
    assert design.job.printing.labels
    areas = []
    for face in range(target.face_count):
        *number, arrow = engraved(target, face, design.job.printing)
        assert len(number) >= 1
        tip = arrow[np.argmax(arrow @ target.outline_mm[face, 0])]
        corner = target.outline_mm[face, 0]
        assert tip / np.linalg.norm(tip) == pytest.approx(corner / np.linalg.norm(corner), abs=1e-9)
        areas.append(prism((*number, arrow), 0.0, 1.0).volume())
        assert prism((*number, arrow), 0.0, 1.0).translate((0, 0, -0.5)).volume() == pytest.approx(areas[-1])
        inside = sticker(design, face, 0.0)
        pits = placed(prism((*number, arrow), -0.09, -0.01), target.target_from_face[face])
        assert (pits - inside).volume() < 1e-9
    assert plain.volume() - body.volume() == pytest.approx(2 * layer * sum(areas), rel=1e-6)


def test_borders_that_are_too_narrow_get_no_lip() -> None:
    """Left out with the border that is enough, which is; asked for, refused; `no` is no."""
    narrow = design_of("ico", edge="30mm", build="stickers", chord_error=COARSE)
    assert not narrow.job.printing.lip
    least = lip_of(narrow.target, narrow.job.printing).least_border_mm
    assert stickers("ico", border=f"{math.ceil(100 * least) / 100}mm").job.printing.lip
    assert not stickers("ico", border=f"{math.floor(100 * least) / 100}mm").job.printing.lip
    with pytest.raises(InputError, match=r"lip: a border of 0.6mm is too narrow .* --border 1\.\d+mm is enough"):
        design_of("ico", edge="30mm", build="stickers", lip=True)
    assert not stickers("ico", lip=False).job.printing.lip


def test_a_target_with_lips_is_taken_to_be_made_so() -> None:
    """Its file says so; without, it is taken for one placed by hand. No id tells."""
    target = stickers("ico").target
    for has_lip, name in ((True, "lip-stickers"), (False, "hand-stickers")):
        assumed = error_model_for(replace(target, has_lip=has_lip))
        assert assumed is not None
        assert assumed.errors.name == name
        assert replace(target, has_lip=has_lip).geometry_id == target.geometry_id


def test_lips_leave_what_their_template_says() -> None:
    """Triangles drawn anywhere in a lip where they fit, cut and pasted as the template assumes, scatter as it says."""
    rng, edge, clearance = np.random.default_rng(5), 98.0, 0.15
    draws = 400_000
    shift = rng.uniform(-2 * clearance, 2 * clearance, (draws, 2))
    turn = rng.uniform(-1, 1, draws) * 2 * clearance / edge
    angle = math.pi / 2 + 2 * math.pi / 3 * np.arange(3)
    normal, corner = -np.stack([np.cos(angle), np.sin(angle)], axis=1), np.stack([np.cos(angle), np.sin(angle)], axis=1)
    corner = corner * edge / math.sqrt(3)
    # Each corner, turned and shifted, stays inside each side of the lip.
    moved = corner + turn[:, None, None] * np.stack([-corner[:, 1], corner[:, 0]], axis=1) + shift[:, None]
    room = edge / (2 * math.sqrt(3)) + clearance
    fits = (np.einsum("nki,si->nks", moved, normal) <= room).all(axis=(1, 2))
    in_lip, turned = shift[fits].std(), turn[fits].std()
    assert in_lip == pytest.approx(math.sqrt(0.3) * clearance, rel=0.02)
    assert turned == pytest.approx(2 * clearance / (math.sqrt(10) * edge), rel=0.02)
    cut = 0.1 * math.sqrt(2 / 3)
    of_lips = math.hypot(in_lip, cut), math.hypot(turned, cut / edge)
    aimed = 0.3, math.radians(0.35)  # on the face without a lip
    errors = error_model("lip-stickers")
    for name, own, other in zip(("face_shift", "face_rotation"), of_lips, aimed, strict=True):
        assert errors.amount(name).sigma == pytest.approx(math.sqrt((19 * own**2 + other**2) / 20), rel=0.1)
