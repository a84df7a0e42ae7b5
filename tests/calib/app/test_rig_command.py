"""`calib rig`: what it says, writes and refuses."""

from pathlib import Path

import pytest

from calib.observe.rig_observations import rig_sightings_to_csv
from tests.support.command_line import calib, files_in, summary_of
from tests.support.rig_views import stereo_pair

PLAIN = ("--model", "opencv", "--no-page")
HEAD = "# camera a 640 x 480\n# camera b 640 x 480\n"


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where the commands work, with the sightings of a pair."""
    monkeypatch.chdir(tmp_path)
    Path("pair.csv").write_bytes(rig_sightings_to_csv(stereo_pair(frames=6).observations))
    return tmp_path


def test_the_screen_leads_with_the_verdict_and_the_answer_holds_it() -> None:
    """Cameras and their distance are told; the table that is written solves to the same again."""
    first = calib("rig", "--table", "pair.csv", "-o", "out", *PLAIN, "--json")
    answer = summary_of(first)["answer"]
    assert [one["name"] for one in answer["cameras"]] == ["left", "right"]
    assert answer["pairs"][0]["distance_mm"] == pytest.approx(120, abs=5 * answer["pairs"][0]["distance_sigma_mm"])
    assert first.err.splitlines()[0].startswith(
        {"good": "good", "usable": "usable", "bad": "do not use"}[answer["verdict"]["grade"]]
    )
    again = calib("rig", "--table", "out/sightings.csv", "-o", "again", *PLAIN, "--json", "-v")
    assert summary_of(again)["answer"]["pairs"][0]["distance_mm"] == pytest.approx(
        answer["pairs"][0]["distance_mm"], abs=1e-6
    )
    assert files_in(Path("again")) == files_in(Path("out"))
    assert "epipolar px" in again.err  # as all tables are, with --verbose
    assert "epipolar px" not in first.err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--model", "opencv", "--model", "fisheye", "--table", "pair.csv"), "--model 'fisheye': give one for all"),
        (("--camera", "left", "--table", "pair.csv"), "--camera 'left': needs a camera's name, as in"),
        (("--delays", "--table", "pair.csv"), "--delays: time offsets are told by time stamps"),
        (("--pattern", "{camera}.png", "--table", "pair.csv"), "--pattern: is of the files in folders"),
        (("--table", "."), "not a regular file"),
        (("pair.csv", "left", "right"), "pair.csv"),
    ],
)
def test_what_does_not_fit_is_refused_in_a_line(words: tuple[str, ...], said: str) -> None:
    """With nothing written."""
    answer = calib("rig", *words, "-o", "out")
    assert (answer.code, answer.out) == (2, "")
    assert said in answer.err
    assert answer.err.count("\n") == 1
    assert not Path("out").exists()


@pytest.mark.parametrize(
    "text",
    [
        HEAD + 'camera,frame,u,v,X,Y,Z\na,"1\n2",1,1,0,0,0\nb,"1\n2",1,1,0,0,0\n',
        HEAD + "camera,frame,u,v,X,Y,Z,sigma,weight\na,1,1,1,0,0,0,1,1\n",
        "# camera a 9999999 x 9999999\ncamera,frame,u,v,X,Y,Z\na,1,1,1,0,0,0\n",
        "# camera ../../a 640 x 480\n# camera b 640 x 480\ncamera,frame,u,v,X,Y,Z\n../../a,1,1,1,0,0,0\n",
        "camera,frame,file\na,1,/dev/zero\nb,1,/dev/zero\n",
        "camera,file,time_s\na,x.png,1e15\n",
    ],
)
def test_hostile_tables_end_in_a_line(text: str) -> None:
    """No traceback, nothing written, nothing waited for."""
    Path("hostile.csv").write_text(text)
    answer = calib("rig", "--table", "hostile.csv", "-o", "out")
    assert (answer.code, answer.out) == (2, "")
    assert answer.err.startswith("error: ")
    assert answer.err.count("\n") == 1
    assert not Path("out").exists()
