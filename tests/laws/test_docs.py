"""The examples of docs/extend.md are code, and keep the rules that the page states."""

import math
import re
import shlex
import sys
from functools import cache
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from typer.core import TyperGroup
from typer.main import get_command

import calib
import designer
import designer.app.design
import designer.kinds.spec_file
import designer.spec.kind
from calib.app import calibration_page
from calib.cameras.camera import Camera
from calib.cameras.formats import FORMATS, READ_FORMATS, WRITTEN_FORMATS
from calib.cli import app as calib_app
from calib.detector.pipeline import detect
from calib.judge.checks import CHECKS, read_criteria
from calib.judge.folders import read_run
from calib.judge.halves import NoHalves
from designer.base.errors import InputError
from designer.cli import app as design_app
from designer.kinds.layout import lay_out
from designer.kinds.presets import preset_names
from designer.kinds.sizing import size_job
from designer.kinds.spec_file import parse_spec
from designer.tolerance.effort import size_of
from designer.tolerance.error_file import error_model
from designer.tolerance.shape import shape_of, target_of
from tests.support.ring_views import view_of
from tests.support.run_folders import write_run
from tests.support.sightings import pinhole
from tests.support.verdict_cases import judge_run, sightings, solved

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "extend.md"


@cache
def example(defines: str) -> ModuleType:
    """The code block of the page that defines a name, as a module."""
    blocks = re.findall(r"^```python\n(.*?)^```", PAGE.read_text(), re.MULTILINE | re.DOTALL)
    (code,) = (block for block in blocks if re.search(rf"^(?:class |def )?{defines}\b", block, re.MULTILINE))
    module = ModuleType(f"docs_{defines.lower()}")
    sys.modules[module.__name__] = module  # dataclasses look their module up
    exec(compile(code, str(PAGE), "exec"), module.__dict__)  # noqa: S102  # the page's own code is what is tested
    return module


def test_error_source_of_zero_changes_nothing_and_stretches_by_its_number() -> None:
    """Numbers of zero leave every centre; a number s moves a ring by s times its x within its face."""
    source = example("STRETCH").STRETCH
    target = lay_out(size_job(parse_spec({"kind": "ico", "edge": "60mm"}, "test")).job.target)
    shape = shape_of(target)
    same = target_of(source.apply(shape, np.zeros((20, 1))))
    np.testing.assert_allclose(same.center_mm, target.center_mm, atol=1e-9)
    stretched = target_of(source.apply(shape, np.full((20, 1), 0.01)))
    moved = np.linalg.norm(stretched.center_mm - target.center_mm, axis=1)
    np.testing.assert_allclose(moved, 0.01 * abs(target.center_in_face_mm[:, 0]), atol=1e-9)


def test_check_of_an_entry_is_in_the_verdict_by_its_own_limits(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Its limits are the entry's, or those of a person's file; the verdict has it, with its grade."""
    monkeypatch.setitem(CHECKS, "photos", example("PHOTOS").PHOTOS)
    (tmp_path / "own.toml").write_text("[photos]\ngood = 5\nusable = 2\n")
    calibrations = solved(sightings(views=6), ("opencv",))
    for criteria, grade in (("standard", "usable"), (str(tmp_path / "own.toml"), "good")):
        run = judge_run(calibrations, 0, NoHalves("not asked for"), read_criteria(criteria))
        found = next(check for check in run.verdict.checks if check.name == "photos")
        assert (found.grade, found.measured) == (grade, "6.0 photos")


def test_section_of_a_function_and_a_line_is_on_the_page(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Where the line stands, between its neighbours; of what a folder stores."""
    place = len(calibration_page.SECTIONS) - 1
    monkeypatch.setattr(calibration_page, "SECTIONS", [*calibration_page.SECTIONS])
    calibration_page.SECTIONS.insert(place, example("distance_section").distance_section)
    write_run(tmp_path, solved(sightings(views=6), ("opencv",)))
    page = calibration_page.calibration_page(read_run(tmp_path), tmp_path)
    assert [one.title for one in page.sections][-2:] == ["Distances", "Files"]


def test_camera_format_of_a_file_and_a_line_reads_what_it_writes(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """A camera is written and read by `convert`, another model is fitted; a broken line is bad input."""
    monkeypatch.setitem(sys.modules, "calib.cameras.formats.six", example("FORMAT"))
    for formats in (FORMATS, READ_FORMATS, WRITTEN_FORMATS):
        monkeypatch.setattr(formats, "_names", [*formats, "six"])
    camera = Camera("pinhole", np.array([1400.1, 1390.2, 640.3, 481.4]), (1280, 960))
    (place,) = calib.convert(camera, "six").save(tmp_path / "camera.six")
    back = calib.load_camera(place)
    assert back.image_size == camera.image_size
    np.testing.assert_array_equal(back.params, camera.params)
    place.write_text("SIX 1 2 3 x")
    with pytest.raises(InputError, match=r"camera\.six: needs SIX and six numbers"):
        calib.load_camera(place)


def test_kind_of_ones_own_is_designed_and_found_in_a_photo(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A file and a line are a kind: sizes, all files, and rings that the detector names as they are."""
    module = example("OctaSpec")
    monkeypatch.setitem(sys.modules, "designer.kinds.octa", module)
    monkeypatch.setattr(designer.spec.kind, "KINDS", (*designer.spec.kind.KINDS, "octa"))
    for module_of in (designer.kinds.spec_file, designer.app.design):
        monkeypatch.setattr(module_of, "KINDS", designer.spec.kind.KINDS)
    made = designer.design("octa", edge_mm=100, chord_error="50um", formats="pdf", stand=True)
    files = {file.name for file in made.save(tmp_path).files}
    assert {"octa-100mm.prusa.3mf", "octa-100mm.png", "octa-100mm.pdf", "octa-100mm.stand.stl", "index.html"} <= files
    assert designer.load(tmp_path / "octa-100mm.toml").geometry == made.geometry
    assert designer.load_target(tmp_path / "octa-100mm.target.json") == made.geometry
    design = made.design
    target, frame = design.target, design.target.target_from_face
    np.testing.assert_allclose((frame[:, :3, 2] * frame[:, :3, 3]).sum(axis=1), 100 / np.sqrt(6), atol=1e-6)
    solid = math.sqrt(2) / 3 * 100**3
    assert design.part.ink is not None
    assert design.part.body.volume_mm3 + design.part.ink.volume_mm3 == pytest.approx(solid, rel=1e-9)
    view = view_of(target, 5, camera=pinhole(1600, 1200, 1900.0))
    found = detect(view.image, target, name="view.png")
    assert len(set(target.ring_face[found.ring].tolist())) >= 2
    np.testing.assert_allclose(found.center_px, view.center_px[found.ring], atol=0.5)


PAGES = sorted([ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").glob("*.md")])


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_and_pictures_are_there(page: Path) -> None:
    """Every file that a page leads to is there, and every place in it is a heading."""
    links = re.findall(r"\]\((?!https?:)([^)#\s]*)(?:#([^)\s]*))?\)", page.read_text())
    for path, anchor in links:
        place = (page.parent / path).resolve() if path else page
        assert place.exists(), path
        if anchor:
            headings = re.findall(r"^#+ (.*)$", place.read_text(), re.MULTILINE)
            assert anchor in {re.sub(r"[^\w\- ]", "", one).strip().lower().replace(" ", "-") for one in headings}


def test_every_page_and_picture_is_led_to() -> None:
    """No file of docs/ lies there unread."""
    text = "\n".join(page.read_text() for page in PAGES)
    for path in (ROOT / "docs").iterdir():
        assert re.search(rf"\(\S*{re.escape(path.name)}", text), path.name


def command_lines() -> list[list[str]]:
    """The lines of `design` and `calib` in the pages' shell blocks and code spans, as words."""
    found = []
    for page in PAGES:
        text = page.read_text()
        blocks = re.findall(r"^```sh\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
        lines = [line for block in blocks for line in block.replace("\\\n", " ").splitlines()]
        lines += [span.replace("\n", " ") for span in re.findall(r"`((?:design|calib) [^`]*)`", text)]
        for line in lines:
            words = shlex.split(line.split(" | ")[0], comments=True)
            found += [words] if words and words[0] in ("design", "calib") and "..." not in words else []
    return found


def test_commands_and_options_in_the_pages_exist() -> None:
    """What the pages say to type is understood: each command is there, with each option that is used."""
    programs = {"design": get_command(design_app()), "calib": get_command(calib_app())}
    lines = command_lines()
    assert len(lines) > 40
    for words in lines:
        command, rest = programs[words[0]], words[1:]
        while isinstance(command, TyperGroup) and rest and not rest[0].startswith("-"):
            assert rest[0] in command.commands, words
            command, rest = command.commands[rest[0]], rest[1:]
        known = {flag for one in command.params for flag in (*one.opts, *one.secondary_opts)} | {"--help"}
        used = {word.split("=")[0] for word in rest if re.match(r"--?[a-z]", word)}
        assert used <= known, (words, used - known)


def test_the_reference_has_every_public_name(tmp_path: Path) -> None:
    """What pdoc makes of the two packages: their public names, and no room behind them."""
    import pdoc

    pdoc.render.configure(show_source=False, search=False)
    pdoc.pdoc("calib", "designer", output_directory=tmp_path)
    for package in (calib, designer):
        text = (tmp_path / f"{package.__name__}.html").read_text()
        missing = [name for name in package.__all__ if f'id="{name}"' not in text]
        assert not missing
    assert {path.name for path in tmp_path.glob("*.html")} == {"calib.html", "designer.html", "index.html"}


def test_prices_and_hours_of_the_table_of_ways_are_those_of_the_command() -> None:
    """Every way that suits the target is a row, with the price and the hours that `design ways` tells."""
    text = (ROOT / "docs/choose-a-target.md").read_text()
    for head, design in (
        ("icosahedron of edge 100 mm", {"kind": "ico", "edge": "100mm"}),
        ("board of 220 x 220 mm", {"kind": "board", "size": "220x220mm"}),
    ):
        target = lay_out(size_job(parse_spec(design, "")).job.target)
        table = text[text.index(f"| {head}") :].partition("\n\n")[0]
        told = {name: (float(price), float(hours)) for name, price, hours in
                re.findall(r"`([a-z-]+)` \|.* \| ([\d.]+) \| ([\d.]+) \|$", table, re.MULTILINE)}  # fmt: skip
        models = {name: error_model(name) for name in preset_names("errors")}
        efforts = {name: (one.price, one.hours) for name, one in models.items() if one.suits_target(target)}
        assert told == {
            name: tuple(float(f"{effort.of(size_of(target)):.2g}") for effort in both if effort is not None)
            for name, both in efforts.items()
        }
