"""Photos of one target before the files of others: no names, and the question whether it is the right file."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from calib.detector import pipeline
from calib.detector.candidates import Candidates
from calib.detector.pipeline import detect
from calib.detector.why_nothing import explained
from calib.renderer import RenderOptions
from designer.kinds.ico import IcoSpec
from designer.kinds.layout import lay_out
from designer.spec.kind import KINDS
from tests.benchmarks.bench_foreign_names import drawn
from tests.support.designs import small
from tests.support.foreign_views import PLAIN, Photo, false_names, photo_of, random_target, template_targets

DIRTY = RenderOptions(
    blur_px=0.9, contrast_to_noise=30, light_gradient=0.3, vignetting=0.3, shading=0.3, glare=0.3, clutter=30,
    occlusion=0.2,
)  # fmt: skip
TARGETS = {
    **template_targets(),
    **{f"random {seed}": random_target(np.random.default_rng(seed)) for seed in (100, 101, 103, 112)},
}
TARGETS |= {name: small(name).target for name in sorted(set(KINDS) - {t.spec.kind for t in TARGETS.values() if t.spec})}
ASKED = TARGETS
"""Files held against every photo."""
SHOWN = [*((name, False) for name in TARGETS), ("3d-board", True), ("shiny-ico", True), ("random 101", True)]


@cache
def photo(name: str, is_dirty: bool) -> Photo:
    """The one photo of a target that all files are held against."""
    rng = np.random.default_rng([*name.encode(), is_dirty])  # so that another kind changes no photo of these
    options = DIRTY if is_dirty else PLAIN
    return photo_of(TARGETS[name], rng, options=options, size=(1000, 800), is_whole=not is_dirty)


@pytest.fixture
def seen_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of one photo: what is a candidate at a threshold is sought once, whichever file it is held against."""
    levels, candidates = {}, {}
    plain_levels, plain_candidates = pipeline.reduced, pipeline.find_candidates

    def reduced(pixels: NDArray[np.generic], factor: int) -> NDArray[np.generic]:
        key = pixels.tobytes(), factor
        if key not in levels:
            levels[key] = plain_levels(pixels, factor)
        return levels[key]

    def find_candidates(grey: NDArray[np.generic], *words: object) -> Candidates:
        key = id(grey), *words  # which `levels` keeps
        if key not in candidates:
            candidates[key] = plain_candidates(grey, *words)
        return candidates[key]

    monkeypatch.setattr(pipeline, "reduced", reduced)
    monkeypatch.setattr(pipeline, "find_candidates", find_candidates)


@pytest.mark.usefixtures("seen_once")
@pytest.mark.parametrize(("name", "is_dirty"), SHOWN)
def test_no_target_bears_the_names_of_another(name: str, is_dirty: bool) -> None:
    """A photo of any target has no name with the file of any other layout, and every name with its own is right."""
    taken = photo(name, is_dirty)
    for asked in ASKED.values():
        found = detect(taken.view.image, asked, name="photo")
        assert false_names(found, taken, asked) == 0
        assert len(found.ring) or found.remarks


@pytest.mark.parametrize("name", TARGETS)
def test_a_whole_target_is_named_with_its_own_file(name: str) -> None:
    """The evidence that refuses others lets a target pass that is seen whole."""
    taken = photo(name, False)
    found = detect(taken.view.image, TARGETS[name], name="photo")
    due = taken.view.clean & (taken.view.incidence_rad < 1.0) & (taken.view.minor_radius_px > 4)
    assert len(found.ring) >= 0.98 * due.sum() > 12
    assert not found.remarks or not TARGETS[name].is_dot.any()


@pytest.mark.parametrize(
    ("shown", "asked", "words"),
    [
        ("3d-board", "alu-board", "a board of 21 x 21 rings or more on a square lattice"),
        ("master-ico", "3d-board", "rings on a triangular lattice"),
        ("3d-board", "matt-ico", "square lattice"),
    ],
)
def test_the_message_asks_for_the_right_file_and_says_what_is_seen(shown: str, asked: str, words: str) -> None:
    """What a photo without names shows instead is said, and the question whether the file is the right one is asked."""
    pixels = photo(shown, False).view.image
    found = explained(detect(pixels, TARGETS[asked], name="photo"), pixels, TARGETS[asked])
    assert len(found.ring) == 0
    assert "is this the right target file" in found.remarks[-1]
    assert words in found.remarks[-1]


@pytest.mark.parametrize(
    ("shown", "asked", "words"),
    [("master-ico", "matt-ico", "times as large for their pitch"), ("shiny-ico", "matt-ico", "distance of its faces")],
)
def test_a_solid_of_other_proportions_is_refused_though_its_codes_agree(shown: str, asked: str, words: str) -> None:
    """Rings larger for their pitch, or faces farther apart for it, than a print makes: another target."""
    pixels = photo(shown, False).view.image
    found = explained(detect(pixels, TARGETS[asked], name="photo"), pixels, TARGETS[asked])
    assert len(found.ring) == 0
    assert any(words in remark for remark in found.remarks)
    assert "is this the right target file" in found.remarks[-1]


@pytest.mark.parametrize("change_mm", [0.5, -0.5])
def test_a_solid_within_the_errors_of_prints_keeps_its_names(change_mm: float) -> None:
    """Faces half a millimetre nearer or farther, and any scale, are what prints and measured files differ by."""
    taken = photo("matt-ico", False)
    spec = TARGETS["matt-ico"].spec
    assert isinstance(spec, IcoSpec)
    found = detect(taken.view.image, lay_out(replace(spec, edge_mm=spec.edge_mm + change_mm)), name="photo")
    assert len(found.ring) == len(detect(taken.view.image, TARGETS["matt-ico"], name="photo").ring)


@pytest.mark.parametrize(
    "seed", [200, 1027, 1312, 3030, 3119, 3135, 4127, 7048, 8137, 20292, 20313, 20320, 30134, 90331]
)
def test_a_board_ends_where_its_file_says(seed: int) -> None:
    """Files of boards a row or column larger or smaller are refused, where covers hide part of the end, too.

    Also where white is as bright as pixels just hold, or rings so blurred that it is darker between them than beside.
    """
    _, taken, files = drawn(seed)
    asked = "3d-board" if seed == 3135 else "sibling"
    assert len(detect(taken.view.image, files[asked], name="photo").ring) == 0
    if seed != 3119:
        assert len(detect(taken.view.image, taken.target, name="photo").ring) > 0


@pytest.mark.parametrize("seed", [1006, 40078])
def test_a_row_that_looks_out_from_under_a_cover_is_no_end(seed: int) -> None:
    """Straight covers that follow a last row, dark or as white as the board, are told by what they leave of rings."""
    _, taken, files = drawn(seed)
    assert len(detect(taken.view.image, files["own"], name="photo").ring) >= 0.7 * taken.view.clean.sum()


@pytest.mark.parametrize(("seed", "asked"), [(8079, "shiny-ico"), (30158, "matt-ico")])
def test_a_face_that_the_wrong_file_names_wrong_does_not_hide_that_faces_stand_apart(seed: int, asked: str) -> None:
    """A file of another spacing brings one of seven faces, or of four, under wrong names: the others still tell."""
    _, taken, files = drawn(seed)
    assert "distance of its faces" in detect(taken.view.image, files[asked], name="photo").remarks[-1]


def test_rings_beside_a_lone_face_count_though_they_look_like_dots() -> None:
    """A grid of eight rows beside the one face that has names is no face of seven, however small its rings are."""
    _, taken, files = drawn(40337)
    assert "7 where it has none" in detect(taken.view.image, files["sibling"], name="photo").remarks[-1]


@pytest.mark.parametrize("asked", ["matt-ico", "shiny-ico"])
def test_a_lone_face_of_small_rings_is_not_believed(asked: str) -> None:
    """Only the proportions of its rings tell one face of a solid from another's, and of 4 px they tell too little."""
    _, taken, files = drawn(80104)
    assert len(detect(taken.view.image, files[asked], name="photo").ring) == 0
