"""Tables of rays, read by the readers that lie beside them: in C++ and JavaScript, as Python has them."""

import shutil
import struct
import zlib
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import calib
from calib.cameras.camera import Camera, camera_or_preset
from calib.cameras.formats import lut
from designer.base.arrays import Array
from designer.base.errors import InputError
from tests.support.foreign_cameras import MODELS, WIDE_SIZE
from tests.support.programs import run

CAMERAS = {name: Camera(name, np.array(params), WIDE_SIZE) for name, params in MODELS.items()}
CAMERAS["circle"] = Camera("fisheye", np.array(MODELS["fisheye"]), WIDE_SIZE, field_rad=np.radians(150))
CAMERAS["surface"] = camera_or_preset("phase-one-spline")
CAMERAS["tiny"] = Camera("pinhole", np.array([3.0, 3, 0, 1]), (1, 3))

ANSWERS_IN_CPP = """
#include <cstdio>
#include <fstream>
#include <iostream>
#include "ringsolid_lut.h"
int main(int, char** words) {
  ringsolid::Lut lut;
  std::string error;
  if (!lut.read(words[1], error)) { std::cout << error << std::endl; return 1; }
  std::printf("%d %d %.17g %.17g\\n", lut.width(), lut.height(), lut.max_error_px(), lut.rms_error_px());
  double a[3], b[3];
  std::string kind, word[3];
  std::ifstream questions(words[2]);
  while (questions >> kind >> word[0] >> word[1] >> word[2]) {
    for (int k = 0; k < 3; ++k) a[k] = std::stod(word[k]);
    const bool known = kind == "u" ? lut.unproject(a[0], a[1], b) : (b[2] = 0, lut.project(a, b));
    std::printf(known ? "%.17g %.17g %.17g\\n" : "none\\n", b[0], b[1], b[2]);
  }
}
"""
ANSWERS_IN_JS = """
import {readFileSync} from "node:fs";
import {readLut} from "./ringsolid_lut.mjs";
let lut;
try { lut = readLut(readFileSync(process.argv[2])); } catch (error) { console.log(error.message); process.exit(1); }
const lines = [`${lut.width} ${lut.height} ${lut.maxErrorPx} ${lut.rmsErrorPx}`];
for (const line of readFileSync(process.argv[3], "utf8").trim().split("\\n")) {
  const [kind, ...numbers] = line.split(" "), [a, b, c] = numbers.map(Number);
  const answer = kind === "u" ? lut.unproject(a, b) : lut.project([a, b, c]);
  lines.push(answer === null ? "none" : [...answer, 0].slice(0, 3).join(" "));
}
console.log(lines.join("\\n"));
"""
FLAGS = ("-std=c++17", "-O1", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-fsanitize=address,undefined")


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory, request: pytest.FixtureRequest) -> list[str]:
    """The command that answers questions by a table; the files of both follow."""
    name = {"c++": "g++", "js": "node"}[request.param]
    if shutil.which(name) is None:
        pytest.skip(f"{name} is missing, which runs the reader of camera.lut in {request.param}")
    folder = tmp_path_factory.mktemp(request.param)
    calib.convert(CAMERAS["tiny"], "lut").save(folder / "camera.lut")
    if name == "node":
        (folder / "answers.mjs").write_text(ANSWERS_IN_JS)
        return ["node", str(folder / "answers.mjs")]
    (folder / "answers.cc").write_text(ANSWERS_IN_CPP)
    run("g++", *FLAGS, folder / "answers.cc", "-o", folder / "answers")
    return [str(folder / "answers")]


both = pytest.mark.parametrize("program", ["c++", "js"], indirect=True)


@cache
def table_of(name: str) -> lut.RayTable:
    return lut.ray_table(CAMERAS[name], lut.TABLE_PX)


def answers(
    program: list[str], content: bytes, folder: Path, *asked: tuple[str, Array]
) -> tuple[list[float], list[Array]]:
    """What the file says of itself, and the answers (N, 3) of each kind and places asked; nan where there is none."""
    (folder / "c.lut").write_bytes(content)
    lines = [
        " ".join([kind, *(f"{value:.17g}" for value in np.append(row, [0.0])[:3])])
        for kind, places in asked
        for row in places
    ]
    (folder / "questions").write_text("\n".join(lines))
    done = run(*program, folder / "c.lut", folder / "questions")
    head, *rest = done.stdout.splitlines()
    found = [[np.nan] * 3 if line == "none" else [float(one) for one in line.split()] for line in rest]
    ends = np.cumsum([len(places) for _, places in asked])[:-1]
    return [float(one) for one in head.split()], np.split(np.array(found), ends)


@both
@pytest.mark.parametrize("name", CAMERAS)
def test_readers_have_the_rays_of_the_camera(program: list[str], name: str, tmp_path: Path) -> None:
    """At places all over the image: within the error that the file states, and nothing where no light is.

    What is projected lands where the camera has it, within as much; what no pixel shows is projected nowhere.
    """
    camera, table = CAMERAS[name], table_of(name)
    assert table.rms_px <= table.max_px <= lut.TABLE_PX
    size = np.array(camera.image_size)
    pixel = np.random.default_rng(7).uniform(-0.4, 0.6, (300, 2)) + np.random.default_rng(8).integers(0, size, (300, 2))
    pixel = np.clip(pixel, 0, size - 1)
    outside = np.array([[0, 0, -1.0], [np.nan, 0, 1], [0, 0, 0], [1e290, 0, -1e300], [np.inf, 0, 1]])
    beyond = np.array([[-0.6, 0], [0, size[1] - 0.4], [np.nan, 0], [1e30, -1e30], [size[0] * 2.0, 1]])
    head, (ray, nowhere, dark) = answers(
        program, table.content(), tmp_path, ("u", pixel), ("p", outside), ("u", beyond)
    )
    assert np.isnan(nowhere).all()
    assert np.isnan(dark).all()
    assert head == [*camera.image_size, table.max_px, table.rms_px]
    true = camera.rays(np.round(pixel))  # of the pixel whose light is asked for
    assert np.array_equal(np.isnan(ray), np.isnan(true))
    known = ~np.isnan(ray[:, 0]) & ~np.isnan(camera.rays(pixel)[:, 0])
    assert known.sum() > 150 or name == "tiny"
    assert np.allclose(np.linalg.norm(ray[known], axis=1), 1, atol=1e-12)
    assert np.linalg.norm(camera.project(ray[known]) - pixel[known], axis=1).max() <= 1.05 * table.max_px
    _, (back,) = answers(program, table.content(), tmp_path, ("p", 700 * ray[known]))
    assert np.abs(back[:, :2] - pixel[known]).max() < 1e-6


@both
def test_points_that_the_camera_does_not_see_are_projected_nowhere(program: list[str], tmp_path: Path) -> None:
    """All around: a pixel where the camera has one in its image, within the stated error, and none elsewhere."""
    point = np.random.default_rng(2).normal(size=(400, 3))
    for name in ("opencv", "fisheye", "circle"):
        camera, table = CAMERAS[name], table_of(name)
        _, (pixel,) = answers(program, table.content(), tmp_path, ("p", point))
        true = camera.project(point)
        far = np.array(camera.image_size) - 0.5
        inside, near = ((true > -0.5 - by).all(axis=1) & (true < far + by).all(axis=1) for by in (-1, 1))
        clear = inside | ~near
        if camera.field_rad is not None:  # the last pixel that shows light does so up to its edges
            angle = np.arccos(point[:, 2] / np.linalg.norm(point, axis=1))
            clear &= np.abs(angle - camera.field_rad / 2) > 0.005
        assert np.array_equal(np.isnan(pixel[clear, 0]), ~inside[clear])
        both_know = clear & inside
        assert both_know.sum() > 20
        assert np.linalg.norm(pixel[both_know, :2] - true[both_know], axis=1).max() < 2 * table.max_px


@both
def test_hostile_tables_are_refused(program: list[str], tmp_path: Path) -> None:
    """Cut off, longer, with any byte changed, and with a right checksum over impossible sizes and spans."""
    content = lut.ray_table(CAMERAS["pinhole"], 1.0).content()

    def refused(changed: bytes) -> str:
        (tmp_path / "c.lut").write_bytes(changed)
        done = run(*program, tmp_path / "c.lut", "none", check=False)
        assert (done.returncode, done.stderr) == (1, "")
        return done.stdout

    for size in (0, 5, 16, 55, 56, 60, len(content) - 1):
        refused(content[:size])
    refused(content + b"\0")
    for at in (3, 17, 25, 33, 50, 57, 500, len(content) - 3):
        changed = bytearray(content)
        changed[at] ^= 0x40
        refused(bytes(changed))

    def summed(head: bytes, body: bytes) -> bytes:
        return head + struct.pack("<Q", zlib.crc32(body, zlib.crc32(head))) + body

    head, body = content[: lut.HEAD.size], content[lut.HEAD.size + 8 :]
    fields = list(lut.HEAD.unpack(head))
    for k, value in ((1, 0), (1, 2**32 - 1), (2, 2**32 - 1), (2, 0), (3, 2**32 - 1), (3, 0), (4, 2**32 - 4)):
        refused(summed(lut.HEAD.pack(*fields[:k], value, *fields[k + 1 :]), body))
    assert "light beyond the image" in refused(summed(head, body[:-4] + struct.pack("<I", fields[1] + 1)))
    assert "not finite" in refused(summed(head, struct.pack("<d", np.inf) + body[8:]))


def test_a_table_is_as_accurate_as_is_asked_for_or_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """With no more cells than that takes; what is stated is what is found at other places than those looked at."""
    camera = CAMERAS["fisheye"]
    sizes = []
    for accept in (1.0, 1e-2, 1e-3):
        done = calib.convert(camera, "lut", accept_px=accept)
        table = lut.ray_table(camera, accept)
        assert done.max_px == table.max_px <= accept
        assert not done.lost
        u, v = (np.linspace(0, side - 1, 4 * side // 7) for side in camera.image_size)
        pixel = np.stack(np.meshgrid(u, v), axis=-1)
        off = np.linalg.norm(camera.project(table.rays(u, v)) - pixel, axis=-1)
        assert np.nanmax(off) < 1.1 * table.max_px
        sizes.append(len(table.content()))
    assert sizes == sorted(set(sizes))
    monkeypatch.setattr(lut, "CELLS", lut.CELLS[:2])
    with pytest.raises(InputError, match=r"lens bicubic is off by up to .* px, more than 1e-12 px"):
        calib.convert(camera, "lut", accept_px=1e-12)


def test_light_in_two_parts_of_a_row_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """A table says one part of each row; whatever model has more of them is not written."""

    def rays(camera: Camera, pixel: Array) -> Array:
        ray = np.tile([0.0, 0, 1], (len(pixel), 1))
        ray[np.abs(pixel[:, 0] - 500) < 20] = np.nan
        return ray

    monkeypatch.setattr(lut, "rays", rays)
    with pytest.raises(InputError, match="several parts of a row"):
        lut.ray_table(Camera("pinhole", np.array(MODELS["pinhole"]), WIDE_SIZE), 1.0)


def test_the_files_are_written_beside_each_other_and_only_over_our_own(tmp_path: Path) -> None:
    """The table, and both readers; a rig's camera is named; somebody else's reader stays."""
    place = tmp_path / "left.lut"
    done = calib.convert(CAMERAS["pinhole"], "lut", out=place)
    assert {path.name for path in tmp_path.iterdir()} == {"left.lut", *lut.READERS}
    assert place.read_bytes() == lut.ray_table(CAMERAS["pinhole"], lut.TABLE_PX).content()
    done.save(place)
    (tmp_path / lut.READERS[0]).write_text("// mine\n")
    with pytest.raises(InputError, match=lut.READERS[0]):
        done.save(place)
    with pytest.raises(InputError, match="is no text"):
        assert done.texts
    with pytest.raises(InputError, match="has no lens and no parameters; leave out model"):
        calib.convert(CAMERAS["pinhole"], "lut", model="opencv")


def test_the_docs_say_what_the_file_holds() -> None:
    """Every field of the head, in docs/lut.md, at its place."""
    page = (Path(__file__).parents[3] / "docs/lut.md").read_text()
    fields = {0: "`ringsolid lut 1", 16: "width", 24: "cells", 32: "error", 48: "CRC-32", 56: "control"}
    for at, what in fields.items():
        assert any(line.startswith(f"| {at} |") and what in line for line in page.splitlines())
