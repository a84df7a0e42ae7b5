"""Pages of study folders: what they all promise, whatever lies in the folder."""

import json
import os
import re
from pathlib import Path

import pytest

from designer.base.errors import InputError
from designer.base.small_file import JsonValue
from designer.page.blocks import FileList
from designer.page.shell import page_html
from tests.support.report_folders import (
    FOLDERS,
    PRINT,
    blocks_of,
    figures_of,
    findings_of,
    page_of,
    written,
)

TABLES = {"measure": f"{PRINT}.as_built.json"}
MARKUP = "<script>alert(1)</script>&\"'"


@pytest.mark.parametrize("kind", FOLDERS)
def test_a_page_depends_on_the_files_alone(kind: str, tmp_path: Path) -> None:
    """The same files give the same bytes, wherever the folder lies and whenever; at most 10 MB."""
    here, there = written(FOLDERS[kind](), tmp_path / "a"), written(FOLDERS[kind](), tmp_path / "b" / "other name")
    for path in there.rglob("*"):
        os.utime(path, (1, 1))
    html = page_html(page_of(kind, here))
    assert html == page_html(page_of(kind, there))
    assert len(html) < 10e6
    assert str(tmp_path).encode() not in html


@pytest.mark.parametrize("kind", FOLDERS)
def test_a_page_says_question_answer_and_command(kind: str, tmp_path: Path) -> None:
    """The headline is a sentence, the first section asks, each section has something, the command stands below."""
    page = page_of(kind, written(FOLDERS[kind](), tmp_path))
    assert page.headline is not None
    assert page.headline.sentence.endswith(".")
    assert page.sections[0].title == "Question"
    assert "?" in page.sections[0].lead
    assert all(section.blocks for section in page.sections)
    assert page.made_by == f"calib study {kind} -o somewhere"
    assert "nan" not in page_html(page).decode().replace("nanometre", "").split("<body", 1)[1].split("<script", 1)[0]


@pytest.mark.parametrize("kind", FOLDERS)
def test_alternative_texts_state_findings(kind: str, tmp_path: Path) -> None:
    """Every figure has a text of its own with a number in it, which is not its title."""
    figures = figures_of(page_of(kind, written(FOLDERS[kind](), tmp_path)))
    assert figures
    for one in figures:
        assert one.alt
        assert one.title not in one.alt or len(one.alt) > 2 * len(one.title)
        assert any(letter.isdigit() for letter in one.alt), one
    assert len({one.alt for one in figures}) == len(figures)


@pytest.mark.parametrize("kind", FOLDERS)
def test_links_lead_to_files_that_are_there(kind: str, tmp_path: Path) -> None:
    """Whatever a figure or the list of files leads to lies in the folder."""
    page = page_of(kind, written(FOLDERS[kind](), tmp_path))
    paths = [link.path for one in figures_of(page) for link in one.files]
    paths += [row.path for one in blocks_of(page) if isinstance(one, FileList) for row in one.rows]
    assert paths
    assert all((tmp_path / path).is_file() for path in paths)


@pytest.mark.parametrize("kind", FOLDERS)
def test_an_empty_folder_has_a_short_page(kind: str, tmp_path: Path) -> None:
    """Without its table a page says so, and gives no answer."""
    page = page_of(kind, tmp_path)
    assert page.headline is None
    assert any("missing" in one.text for one in findings_of(page))
    page_html(page)


@pytest.mark.parametrize("kind", FOLDERS)
@pytest.mark.parametrize(
    "harm",
    [
        lambda text: text[: len(text) // 2],
        lambda text: re.sub('"version": [12]', '"version": 9', text),
        lambda text: text.replace('"format": "ringsolid.', '"format": "other.'),
        lambda text: re.sub('"(notes|remarks|cameras|alone|starts)": \\[', r'"\1": [1, ', text),
        lambda text: text.replace('"unit": "mm"', '"unit": ["mm"]').replace('"status": "', '"status": "un'),
        lambda text: "[" * 100_000,
        lambda text: "",
        lambda text: "\x00\xff",
    ],
    ids=["cut", "version", "format", "note", "unit", "deep", "empty", "binary"],
)
def test_damaged_tables_are_refused_in_a_line(kind: str, harm: object, tmp_path: Path) -> None:
    """A table that breaks a rule ends in one line that names the file and what to do."""
    assert callable(harm)
    files = dict(FOLDERS[kind]())
    text = files[TABLES[kind]].decode()
    files[TABLES[kind]] = harm(text).encode()
    assert files[TABLES[kind]] != text.encode()
    with pytest.raises(InputError) as refused:
        page_of(kind, written(files, tmp_path))
    message = str(refused.value)
    assert "\n" not in message
    assert TABLES[kind] in message
    assert any(word in message for word in ("--resume", "measure the print again", "use the version"))


def with_markup(value: JsonValue, names: frozenset[str], inside: bool = False) -> JsonValue:
    """The same with markup in all texts below keys of these names."""
    if isinstance(value, dict):
        return {key: with_markup(one, names, inside or key in names) for key, one in value.items()}
    if isinstance(value, list):
        return [with_markup(one, names, inside) for one in value]
    return MARKUP if inside and isinstance(value, str) else value


@pytest.mark.parametrize("kind", FOLDERS)
def test_texts_stay_texts(kind: str, tmp_path: Path) -> None:
    """Names and remarks with markup in them are shown as they are, and do nothing."""
    names = frozenset((
        "target", "notes", "reasons", "claim", "evidence", "elsewhere", "setting", "sentences", "amount", "why",
        "sources_of_amounts", "settings", "remarks", "program", "camera", "sampling", "photos",
    ))  # fmt: skip
    files = dict(FOLDERS[kind]())
    files[TABLES[kind]] = json.dumps(with_markup(json.loads(files[TABLES[kind]]), names)).encode()
    html = page_html(page_of(kind, written(files, tmp_path)))
    assert b"<script>alert" not in html
    assert b"&lt;script&gt;alert(1)" in html
