"""A result tells the same in memory, in its folder, on its page and to programs, whichever command it is of."""

import json
import re
import shlex
from collections.abc import Callable
from pathlib import Path

import pytest

from designer.base.codec import encode_by_value
from designer.page import capability
from designer.page.blocks import FileList
from designer.page.page_file import PAGE
from designer.page.result import Result
from designer.page.shell import page_html
from tests.laws.test_exit_codes import CASES, Case, folder, require_promised
from tests.support.command_line import Answer, calib, design, summary_of
from tests.support.pages import blocks_of, figures_of

__all__ = ["folder"]  # the scene that the commands work in
ADVISED = {"calib": calib, "design": design}
OF_PHOTOS = {"detections", "undistorted"}
"""Kinds of results that are written beside photos, one by one."""
OF_PAGE = ("index.html", "page.json")
"""Files that say in what folder they are."""


def told_by(program: Callable[..., Answer], *words: str) -> tuple[Answer, list[Result]]:
    """What a command leaves, and the result that it tells."""
    found, told = list[Result](), capability.told

    def kept(result: Result, *rest: object, **options: object) -> object:
        found.append(result)
        return told(result, *rest, **options)  # type: ignore[arg-type]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(capability, "told", kept)
        return program(*words), found


def files_of(place: Path) -> dict[Path, bytes]:
    """All files of a folder, by their paths in it."""
    return {path.relative_to(place): path.read_bytes() for path in place.rglob("*") if path.is_file()}


@pytest.mark.parametrize(("program", "case"), [one for one in CASES if one.values[1].code != 2])
def test_memory_folder_page_and_json_tell_the_same(
    program: Callable[..., Answer], case: Case, capfd: pytest.CaptureFixture[str]
) -> None:
    """What is saved again from memory is what the command wrote, and `KIND.json` what it answers.

    It ends as promised, in no more lines than a screen has. The page has an answer, something in each section and
    nowhere nan; figures are told in words with a number, files are there; a notebook shows it; `calib report` makes it
    again to the last byte. Nothing of this prints a line. What is advised next runs as it stands, in any folder.
    """
    place = Path("it's my $out")
    words = tuple(str(place) if word == "out" else word for word in case.words if word != "--no-page")
    if case.before:
        program(*(str(place) if word == "out" else word for word in case.before))
    answer, found = told_by(program, *words, "--json")
    require_promised(answer, case)
    assert len(answer.err.splitlines()) <= 25 or case.words == ("templates",)  # which is a list
    if not found or found[0].kind in OF_PHOTOS:
        return
    result, summary = found[0], summary_of(answer)
    assert summary["answer"] == json.loads(json.dumps(encode_by_value(result.answer())))
    capfd.readouterr()
    page = result.page()
    assert (page.headline is not None and page.headline.sentence != "") or result.kind == "rescaled"
    assert all(section.blocks for section in page.sections)
    assert not re.search(r"\bnan\b", page_html(page).decode().split("<body", 1)[1].split("<script", 1)[0])
    assert all(re.search(r"\d", figure.alt) for figure in figures_of(page))
    assert "srcdoc" in result._repr_html_()
    if "out" not in case.words:  # one file, and what lies beside it
        own = [path for path in map(Path, summary["wrote"]) if ".overlay" not in path.name and path.name not in OF_PAGE]
        if own and "-o" in words:
            result.save(Path("again", words[words.index("-o") + 1]))
            assert [path for path in own if path.read_bytes() != ("again" / path).read_bytes()] == []
        assert capfd.readouterr() == ("", "")
        return
    if result.kind not in ("calibration", "rig", "ways", "design"):  # whose files hold what a person goes on from
        stored = json.loads((place / f"{result.kind}.json").read_text())
        assert {name: value for name, value in stored.items() if name not in ("format", "version")} == summary["answer"]
    wrote = {path: content for path, content in files_of(place).items() if path.suffix != ".sqlite"}
    result.save("again", command=summary["line"])
    assert capfd.readouterr() == ("", "")
    again = files_of(Path("again"))
    assert set(wrote) <= set(again)
    assert [path for path in wrote if path.name not in OF_PAGE and again[path] != wrote[path]] == []
    if result.kind == "design":  # a spec makes its page again
        return
    for block in blocks_of(PAGE.read(place / "page.json").page):
        for row in block.rows if isinstance(block, FileList) else ():
            assert (place / row.path).stat().st_size == row.size_bytes
    (place / "index.html").unlink()
    assert calib("report", place).code == case.code
    assert (place / "index.html").read_bytes() == wrote[Path("index.html")]
    for line in summary["next"] if case.code == 0 else ():
        words = tuple(shlex.split(line, comments=True))
        if words[1] not in ("tolerance", "run", "measure"):  # which take photos first, or long
            assert ADVISED[words[0]](*words[1:]).code in (0, 1), line
