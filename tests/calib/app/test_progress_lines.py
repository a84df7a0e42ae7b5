"""Progress where there is no terminal."""

import pytest

from designer.page.progress import progress_bar

EVERY_S = 4.0


def test_progress_is_told_in_lines_off_a_terminal(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Every few seconds a line on standard error says how many are done and about how long the rest takes."""
    now = [100.0]
    monkeypatch.setattr("designer.page.progress.SAID_EVERY_S", EVERY_S)
    monkeypatch.setattr("designer.page.progress.time.monotonic", lambda: now[0])
    with progress_bar("drawing", 40) as tell:
        for done in range(1, 41):
            now[0] += EVERY_S / 4
            tell(done)
    told = capsys.readouterr()
    assert told.out == ""
    lines = told.err.splitlines()
    assert lines[0] == f"drawing: 4/40, about {9 * EVERY_S:.0f} s left"
    assert len(lines) == 9
