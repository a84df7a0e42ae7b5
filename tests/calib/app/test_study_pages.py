"""Pages of studies: what they all promise."""

from pathlib import Path

import pytest

from designer.page.blocks import FileList, Paragraph
from designer.page.page_file import PAGE
from designer.page.shell import page_html
from tests.support.pages import blocks_of, figures_of
from tests.support.report_folders import RESULTS
from tests.support.study_commands import nothing_drawn


@pytest.fixture(autouse=True)
def _nothing_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("calib.draw.style.sheet_files", nothing_drawn)


@pytest.mark.parametrize("kind", RESULTS)
def test_a_page_asks_and_answers(kind: str) -> None:
    """It asks before all else, the headline is a sentence, each section has something, and nothing is nan."""
    page = RESULTS[kind]().page()
    assert page.headline is not None
    assert page.headline.sentence.endswith(".")
    assert isinstance(page.lead[0], Paragraph)
    assert "?" in page.lead[0].text
    assert all(section.blocks for section in page.sections)
    assert "nan" not in page_html(page).decode().replace("nanometre", "").split("<body", 1)[1].split("<script", 1)[0]


@pytest.mark.parametrize("kind", RESULTS)
def test_alternative_texts_state_findings(kind: str) -> None:
    """Every figure has a text of its own with a number in it, which is not its title."""
    figures = figures_of(RESULTS[kind]().page())
    assert figures
    for one in figures:
        assert one.alt
        assert one.title not in one.alt or len(one.alt) > 2 * len(one.title)
        assert any(letter.isdigit() for letter in one.alt), one
    assert len({one.alt for one in figures}) == len(figures)


@pytest.mark.parametrize("kind", RESULTS)
def test_links_lead_to_files_that_are_there(kind: str, tmp_path: Path) -> None:
    """Whatever a figure or the list of files leads to lies in the folder, and the page is read as it was."""
    found = RESULTS[kind]()
    files = found.save(tmp_path, command="the command")
    page = PAGE.read(tmp_path / "page.json").page
    paths = [link.path for one in figures_of(page) for link in one.files]
    paths += [row.path for one in blocks_of(page) if isinstance(one, FileList) for row in one.rows]
    assert paths
    assert all((tmp_path / path).is_file() for path in paths)
    assert {*files} == {path for path in tmp_path.rglob("*") if path.is_file()}
    assert page.made_by == "the command"
    assert page_html(page) == (tmp_path / "index.html").read_bytes()
