"""The laws of the kinds of targets: every line of the registry keeps them."""

import ast
import io
import json
import re
import tomllib
from collections.abc import Mapping
from itertools import chain
from pathlib import Path

import jsonschema
import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from calib.detector.pipeline import detect
from calib.renderer import render_view
from designer.base.errors import InputError
from designer.base.solid import Faceted
from designer.formats.stl import stl_bytes
from designer.kinds.sizing import size_job
from designer.kinds.spec_file import parse_spec, spec_to_toml
from designer.make.bed import bed_from_target
from designer.make.printability import check_printability
from designer.spec.kind import KINDS, kind_named, spec_from_mapping, spec_to_mapping
from designer.spec.options import is_required, options_of
from designer.target import target_from_json, target_to_json
from tests.support.designs import COARSE, SMALL, asked_for, design_of, ink_of, packages_of, small, wishes
from tests.support.ring_views import CAMERA, USUAL, misplaced, pose_of

ROOT = Path(__file__).parents[2]
each_kind = pytest.mark.parametrize("name", KINDS)


def test_each_kind_is_one_file_and_one_line() -> None:
    """The files of `designer/kinds` with a kind are the registry's, each of its name; the tests have one small."""
    files = {path.stem for path in (ROOT / "designer/kinds").glob("*.py") if "\nKIND = " in path.read_text()}
    assert files == set(KINDS) == set(SMALL)
    assert [kind_named(name).name for name in KINDS] == list(KINDS)


def names_in(path: Path) -> set[str]:
    """Modules and names that a file imports, and the texts in it."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom):
            found |= {node.module or "", *(alias.name for alias in node.names)}
        elif isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            found.add(node.value)
    return found


LABELS = {
    "designer/target.py": {"solid"},  # a form of targets, here and below
    "designer/kinds/regular_solid.py": {"solid"},
    "designer/spec/build.py": {"solid"},
    "designer/spec/format.py": {"solid"},
    "designer/tolerance/model.py": {"solid"},
    "calib/__init__.py": {"coupon"},  # the function and the command that look at one
    "calib/cli.py": {"coupon"},
    "calib/studies/cost/ratios.py": {"board"},  # what a scene is called
    "calib/studies/statistics.py": {"board"},  # what the paper calls its targets
    "calib/studies/paper_study.py": {"board", "ico"},  # their specs, as target files have them
    "calib/judge/next_view_words.py": {"board"},  # what people call a thing that is flat
    "designer/formats/colour.py": {"corner"},  # of a face, an image, a chessboard: a common word
    "calib/observe/correspondences.py": {"corner"},
    "calib/judge/coverage.py": {"corner"},
    "calib/judge/target_hints.py": {"corner"},
    "calib/detector/overlay_frame.py": {"corner"},
    "calib/app/target_from_photo.py": {"board"},  # a heading
    "calib/studies/with_ours.py": {"ico"},  # the kind that other makers' boards are compared with
    "calib/draw/rig_scene.py": {"dome"},  # what all that a fisheye lens sees is called
}


def test_no_kind_is_named_outside_its_file() -> None:
    """Nothing but the registry names a kind, its spec or its module: what kinds can do, they declare themselves."""
    own = {cls.__name__ for name in KINDS for cls in (kind_named(name).spec, kind_named(name).asked)}
    own |= {*KINDS, *(f"designer.kinds.{name}" for name in KINDS)}
    named, worth = {}, re.compile("|".join(rf"\b{name}\b" for name in own))
    for path in (path for package in ("designer", "calib") for path in (ROOT / package).rglob("*.py")):
        place = path.relative_to(ROOT).as_posix()
        if place == "designer/spec/kind.py" or path.stem in KINDS or not worth.search(path.read_text()):
            continue
        if found := (names_in(path) & own) - LABELS.get(place, set()):
            named[place] = found
    assert not named


@each_kind
def test_layout_is_read_back_bit_for_bit(name: str) -> None:
    """Spec to geometry to file and back: the same numbers, ids and spec."""
    target = small(name).target
    again = target_from_json(target_to_json(target))
    assert again == target
    assert again.layout_id == target.layout_id
    assert again.spec == target.spec
    assert again.spec is not None
    assert spec_from_mapping(json.loads(json.dumps(spec_to_mapping(again.spec)))) == again.spec


@each_kind
def test_published_schema_takes_the_files(name: str) -> None:
    """The schema takes the files of the kind, whatever fields its spec has of its own."""
    schema = json.loads((ROOT / "designer/target.schema.json").read_text())
    jsonschema.validate(json.loads(target_to_json(small(name).target)), schema)


@each_kind
def test_extent_alone_gives_a_target_of_that_size(name: str) -> None:
    """What a target measures, typed again without all else."""
    job = small(name).job
    extent = {key: job.target.options()[key] for key in job.target.extent}
    assert size_job(asked_for(name, extent)).job.target.size_words == job.target.size_words


def require_same_job(kind: str, values: Mapping[str, object]) -> None:
    """What was chosen of these values, if they can be, chooses the same when it is typed again."""
    try:
        job = size_job(asked_for(kind, values)).job
    except InputError:
        return
    text = spec_to_toml(job)
    written = tomllib.loads(text)
    left_out = {*job.printing.way.idle, *kind_named(kind).asked.read_into}
    asked = kind_named(kind).asked
    assert written.keys() - {*asked.of_some} == {"kind", *options_of(asked)} - left_out - {*asked.of_some}
    again = size_job(parse_spec(written, "")).job
    assert again == job
    assert spec_to_toml(again) == text


@settings(max_examples=60)
@given(wishes())
def test_resolved_spec_gives_the_same_job(asked: tuple[str, dict[str, object]]) -> None:
    """Of any kind and options: the file written next to the outputs resolves to the very same job and the same bytes.

    It leaves nothing to be chosen: all keys of its kind are in it, but those idle for its build.
    """
    require_same_job(*asked)


@each_kind
@settings(max_examples=2)
@given(data=st.data())
def test_resolved_spec_holds_each_option(name: str, data: st.DataObject) -> None:
    """One after the other, of whatever value."""
    for option in options_of(kind_named(name).asked):
        require_same_job(*data.draw(wishes((name,), option)))


@each_kind
def test_how_it_is_printed_changes_no_number_of_the_target(name: str) -> None:
    """Ink offset, shrinkage, skew, inlay, colours, letters and stand leave the target file as it is, byte for byte."""
    printed = {
        "ink_offset": "0.05mm", "shrink_compensation": "0.5%", "skew_compensation": "xy 0.1deg", "inlay_depth": "0.4mm",
        "body_colour": "#ffff00", "labels": False, "chord_error": "0.1mm", "stand": name != "coupon",
    }  # fmt: skip
    other = design_of(name, **{**SMALL[name], **printed})
    assert target_to_json(other.target) == target_to_json(small(name).target)
    assert other.job.printing != small(name).job.printing


@each_kind
def test_a_kind_says_what_it_is(name: str) -> None:
    """Words, facts and options are there: the shape first, the lattice last, required options with an example."""
    kind, spec = kind_named(name), small(name).job.target
    assert spec.facts()[0][0] == "shape"
    assert spec.facts()[-1][0] == "lattice"
    assert spec.words.split()[0] == spec.facts()[0][1].split(",")[0]
    assert re.match(r"an? ", kind.title)
    options = options_of(kind.asked)
    assert set(spec.options()) <= set(options)
    assert all("such as" in options[key].help for key in options if is_required(kind.asked, key))


@each_kind
def test_body_and_ink_are_closed_and_fill_the_solid(name: str) -> None:
    """Read back by trimesh: watertight, facing outwards, and together of their hull's volume, less a hollow."""
    design = small(name)
    parts = [
        trimesh.load_mesh(io.BytesIO(stl_bytes(mesh)), file_type="stl") for mesh in (design.part.body, ink_of(design))
    ]
    for part in parts:
        part.merge_vertices()
        assert part.is_watertight
        assert part.is_winding_consistent
        assert part.volume > 0
    hull = trimesh.convex.convex_hull(np.concatenate([part.vertices for part in parts]))
    volume, body = hull.volume, design.job.target.body
    if isinstance(body, Faceted) and body.is_inward:
        volume -= trimesh.convex.convex_hull(body.vertices_mm[list(chain(*body.faces))]).volume
    assert sum(part.volume for part in parts) == pytest.approx(volume, rel=1e-5)
    files = packages_of(design)
    assert files.prusa[:2] == files.bambu[:2] == b"PK"


@each_kind
def test_part_lies_on_the_bed(name: str) -> None:
    """By a rigid motion the last face, or a larger one without rings, lies on the bed, the part within it.

    The design rules have nothing against it.
    """
    design = small(name)
    printing = design.job.printing
    motion = bed_from_target(design.target, printing)
    assert motion[:3, :3] @ motion[:3, :3].T == pytest.approx(np.eye(3), abs=1e-9)
    assert np.linalg.det(motion[:3, :3]) == pytest.approx(1.0)
    part = np.concatenate([mesh.vertices_mm for mesh in (design.part.body, ink_of(design))])
    placed = part @ motion[:3, :3].T + motion[:3, 3]
    assert placed[:, 2].min() == pytest.approx(0.0, abs=1e-9)
    body = design.job.target.body
    if body is None or not body.bare:
        assert motion[:3, :3] @ design.target.target_from_face[-1, :3, 2] == pytest.approx([0, 0, -1], abs=1e-9)
    on_bed = placed[placed[:, 2] < 1e-6]
    assert np.linalg.matrix_rank(on_bed - on_bed[0], tol=1e-3) == 2
    assert (placed.max(axis=0) < printing.printer.bed_mm).all()
    assert (placed[:, :2].min(axis=0) > 0).all()
    assert not check_printability(design.target, printing).violations


@each_kind
@pytest.mark.parametrize("seed", [1, 2])
def test_photos_of_a_kind_are_detected(name: str, seed: int) -> None:
    """Rendered small and found again: rings of every face that is plain to see, none under a wrong name."""
    values = {**SMALL[name], "chord_error": COARSE}
    target = size_job(asked_for(name, values)).job.target.lay_out()
    reach = np.linalg.norm(target.center_mm, axis=1).max()
    rng = np.random.default_rng(seed)
    view = render_view(target, CAMERA, pose_of(target, rng, 5.0 * reach), USUAL, rng)
    found = detect(view.image, target, name=name)
    assert len(found.ring)
    assert misplaced(found, view).max() < 0.5
    plain = view.clean & (view.incidence_rad < 1.15) & (view.minor_radius_px > 4)
    assert set(target.ring_face[plain]) <= set(target.ring_face[found.ring])
