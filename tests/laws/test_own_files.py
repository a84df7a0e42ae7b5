"""Nothing that somebody else made is ever replaced, by any command that writes."""

import io
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from calib.cameras.formats import RIG_FORMATS, WRITTEN_FORMATS
from calib.observe.marker_files import MARKER_FORMATS
from calib.renderer.job import SUFFIX
from designer.base.errors import InputError
from designer.base.files import write_files
from designer.base.own_files import kind_of, require_ours, signed
from tests.laws.test_exit_codes import BOOTSTRAP, CASES, WRITING, Case, folder, require_promised
from tests.support.command_line import Answer, calib, summary_of

__all__ = ["folder"]  # the scene that the commands work in
FOREIGN = {
    ".html": b"<!doctype html>\n<title>My ringsolid board</title>\n",
    ".json": b'{"mine": 1, "format": "ringsolid.camera"}\n',
    ".toml": b'kind = "board"\nname = "mine"  # for ringsolid\n',
    ".csv": b"mine,yours\n1,2\n",
    ".png": cv2.imencode(".png", np.zeros((3, 4), np.uint8))[1].tobytes(),
}


def foreign(path: Path) -> bytes:
    """What somebody may keep under a name."""
    return FOREIGN.get(path.suffix, b"somebody's own\n")


def contents() -> dict[Path, bytes]:
    """All files of the current folder."""
    return {path: path.read_bytes() for path in Path().rglob("*") if path.is_file()}


RENDER = next(one.values[1] for one in CASES if one.values[1].words[0] == "render")
FORMATTED = [
    pytest.param(calib, replace(RENDER, words=(*RENDER.words, "--overwrite", "--format", kind)), id=f"render {kind}")
    for kind in SUFFIX
]
FORMATTED += [
    pytest.param(
        calib, Case(("convert", source, "--to", kind, "-o", f"new{Path(one.file_name).suffix}"), 0), id=f"{said}{kind}"
    )
    for source, said, formats in (
        ("camera.json", "convert ", WRITTEN_FORMATS),
        ("pair.rig.json", "convert a rig, ", RIG_FORMATS),
    )
    for kind, one in formats.items()
]
MARKERS = ("markers", "board.target.json", "detections.csv", "-o", "markers", "--to")
FORMATTED += [pytest.param(calib, Case((*MARKERS, kind), 0), id=f"markers {kind}") for kind in MARKER_FORMATS]


@pytest.mark.parametrize(("program", "case"), [*WRITING, *FORMATTED])
def test_own_files_are_replaced_and_those_of_somebody_else_stay(program: Callable[..., Answer], case: Case) -> None:
    """A command that runs again over its own files ends as before, and writes them all; a study goes on, if asked to.

    Then under each name that it writes lies something else: it stays, byte for byte, and a line names one of them.
    Where the command does without that file it says so; else it ends with 2, and nothing new is there.
    """
    if case.before:
        assert program(*case.before).code == 0
    earlier, words = contents(), tuple(word for word in case.words if word != "--no-page")
    first = program(*words, "--json")
    require_promised(first, case)
    own = {path: content for path, content in contents().items() if earlier.get(path) != content}
    again = program(*words, *(("--resume",) if case.words == BOOTSTRAP else ()), "--json")
    assert again.code == case.code, again
    assert [summary_of(again)[key] for key in ("wrote", "remarks")] == [
        summary_of(first)[key] for key in ("wrote", "remarks")
    ]
    for path in own:
        path.write_bytes(foreign(path))
    planted = {path: foreign(path) for path in own}
    answer = program(*words, "--json")
    there = contents()
    assert {path: there[path] for path in planted} == planted
    named = " ".join([summary_of(answer)["error"] or "", *summary_of(answer)["remarks"], answer.err])
    assert not own or any(path.name in named for path in own), named
    if answer.code == 2:
        assert there == {**earlier, **planted}


PLACED = [one for one in WRITING if {"-o", "--picture"} & set(one.values[1].words)]


@pytest.mark.parametrize(("program", "case"), PLACED)
def test_a_place_that_does_not_suit_is_refused_before_any_work(program: Callable[..., Answer], case: Case) -> None:
    """A file that is read, a name below a file, a file for a folder, a folder for a file: one line that names it."""
    if case.before:
        assert program(*case.before).code == 0
    at = max(case.words.index(flag) for flag in ("-o", "--picture") if flag in case.words) + 1
    place, inputs = Path(case.words[at]), [word for word in case.words[1:at] if Path(word).is_file()]
    Path("file").write_text("x")
    Path(f"folder{place.suffix}").mkdir()
    before = contents()
    other = f"folder{place.suffix}" if place.suffix else "file"
    for wrong in (
        *inputs,
        f"file/{place.name}",
        *((other,) if case.words[0] != "detect" else ()),
    ):  # takes a folder, too
        answer = program(*case.words[:at], wrong, *case.words[at + 1 :])
        assert (answer.code, answer.out, answer.err.count("\n")) == (2, "", 1), (wrong, answer)
        assert Path(wrong).name in answer.err or "file: " in answer.err, (wrong, answer)
        assert contents() == before, wrong


def test_a_picture_is_signed_and_shows_the_same(tmp_path: Path) -> None:
    """PNG and JPEG, a package and a text are known for this program's afterwards, and what they hold is as before."""
    pixels = np.arange(48, dtype=np.uint8).reshape(6, 8)
    for suffix in (".png", ".jpg", ".tiff"):
        plain = cv2.imencode(suffix, pixels)[1].tobytes()
        assert not kind_of(plain)
        own = signed(f"a{suffix}", plain)
        assert kind_of(own) == b"ringsolid."
        assert np.array_equal(np.asarray(Image.open(io.BytesIO(own))), np.asarray(Image.open(io.BytesIO(plain))))
        assert signed("a", own) == own
    package = io.BytesIO()
    with zipfile.ZipFile(package, "w") as archive:
        archive.writestr("a", "text")
    with zipfile.ZipFile(io.BytesIO(signed("a.3mf", package.getvalue()))) as archive:
        assert (archive.read("a"), archive.comment) == (b"text", b"ringsolid")
    write_files({tmp_path / "a.md": b"# A table"})
    write_files({tmp_path / "a.md": b"# Another table"})
    assert (tmp_path / "a.md").read_text().startswith("# Another table\n<!-- ringsolid")


@pytest.mark.parametrize("name", ["camera.json", "design.toml", "index.html", "a.csv", "a.png", "a.svg"])
def test_what_names_this_program_is_not_yet_its_own(name: str, tmp_path: Path) -> None:
    """A file of somebody's that mentions the program, or holds some of its output, stays."""
    path = tmp_path / name
    path.write_bytes(foreign(path))
    for new in (None, b'{\n"format": "ringsolid.camera"', b"# ringsolid design\n"):
        with pytest.raises(InputError, match="not of ringsolid's making"):
            require_ours(path, new)
    require_ours(path, foreign(path))


@pytest.mark.parametrize(
    "text",
    [
        b"# ringsolid: my own notes, do not lose\nsize = 3\n",
        b"# ringsolid notes of mine, version 1\n",
        b"# ringsolidify\n",
        b"ringsolid is what I use\n",
        b"ringsolid binary STLs\n",
        b"size = 3\n# ringsolid is what I use\nsize = 4\n",
        b"size = 3\n# ringsolid\nsize = 4\n",
        b"size = 3\n# ringsolid.design-toml\nsize = 4\n",
        b"size = 3\n# ringsolidify\n",
        b'<p>a page shows <meta name="generator" content="ringsolid 1"></p>\n',
        b'{"asset": {"generator": "ringsolid"}}\n',
        b"my notes of /Creator (ringsolid)\n",
    ],
)
def test_a_mark_counts_only_where_files_of_ours_have_it(text: bytes, tmp_path: Path) -> None:
    """A text that tells of this program, in whatever words and wherever, is its writer's."""
    (tmp_path / "mine.toml").write_bytes(text)
    for kind in ("", "ringsolid.notes", "ringsolid.design-toml"):
        with pytest.raises(InputError, match="not of ringsolid's making"):
            require_ours(tmp_path / "mine.toml", kind=kind)


@pytest.mark.parametrize("suffix", [".toml", ".yaml", ".xml", ".txt", ".cameramodel", ".pdf", ".svg", ".md"])
def test_a_note_says_what_the_file_is(suffix: str, tmp_path: Path) -> None:
    """One sort of thing is never written over another; notes of earlier versions told only whose the file is.

    These count for what their suffix stands for.
    """
    path = tmp_path / f"ico{suffix}"
    design, camera = (signed(path.name, b"content", sort) for sort in ("design", "kalibr"))
    elsewhere = signed("camera.ini.yml", b"content", "kalibr")
    path.write_bytes(design)
    require_ours(path, signed(path.name, b"other content", "design"))
    assert signed(path.name, design) == design
    for new in (camera, elsewhere):
        with pytest.raises(InputError, match="of another kind"):
            require_ours(path, new)
    for name in (b"ringsolid",):
        path.write_bytes(design.replace(b"ringsolid.design-" + suffix[1:].encode(), name))
        require_ours(path, design)
        with pytest.raises(InputError, match="of another kind"):
            require_ours(path, elsewhere)
