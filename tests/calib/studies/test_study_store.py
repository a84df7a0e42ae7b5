"""The file of a study: what is kept in it, and what is no study."""

import shutil
import sqlite3
from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib.studies.identity import StudyIdentity, identity_of
from calib.studies.samples import Case, SampleErrors, SampleResult, StoredCase
from calib.studies.store import open_study, read_study
from designer.base.errors import InputError

IDENTITY = StudyIdentity(
    5, (("model", "opencv"), ("weighted", "yes")), (("detections", "a" * 64), ("target", "b" * 64))
)
CASE = StoredCase(Case("Brett ▲", 20, 200, "area", "all"), "opencv", 3, np.diag([1.0, 0.1, 2.0]))
NAME = CASE.case.name
NAN, INF = float("nan"), float("inf")


def result(number: int) -> SampleResult:
    """A sample with numbers that decimal digits do not hold."""
    value = np.abs(np.random.default_rng(number).normal(size=7)).tolist()
    return SampleResult(number, "converged", 12, tuple(value[4:]), 3, errors=SampleErrors(*value[:3]))


FAILED = SampleResult(3, "failed", 1, (NAN,) * 3, 0, "kein Bild ✗ 'x'; \"y\"", SampleErrors(NAN, INF))


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A study of one case, five samples."""
    with open_study(tmp_path / "study.sqlite", IDENTITY, resume=False) as study:
        study.declare(CASE)
        study.add(NAME, [result(4), result(0), result(2)])
        study.add(NAME, [FAILED, result(1)])
    return tmp_path / "study.sqlite"


def read_all(path: Path) -> None:
    """Read all that a study file holds."""
    with read_study(path) as study:
        study.programs()
        for case in study.cases():
            study.done(case.case.name)
            study.load(case.case.name)


def refusal(act: Callable[[], object]) -> str:
    """The one line with which something is refused."""
    with pytest.raises(InputError) as refused:
        act()
    assert "\n" not in str(refused.value)
    return str(refused.value)


def test_what_is_kept_comes_back(path: Path) -> None:
    """Samples come back by number, to the last bit; undefined metrics as nan."""
    with read_study(path) as study:
        assert study.cases() == (CASE,)
        np.testing.assert_array_equal(study.cases()[0].covariance, CASE.covariance)
        assert study.identity == IDENTITY
        assert {name for name, _ in study.programs()} == {"numpy", "numba", "scipy", "ringsolid"}
        assert study.done(NAME) == {0, 1, 2, 3, 4}
        samples = study.load(NAME)
    assert samples.number.tolist() == [0, 1, 2, 3, 4]
    assert samples.status.tolist() == ["converged"] * 3 + ["failed", "converged"]
    assert samples.message == ("", "", "", FAILED.message, "")
    assert samples.distinct_views.tolist() == [12, 12, 12, 1, 12]
    for number in (0, 1, 2, 4):
        one = result(number)
        assert tuple(samples.params[number]) == one.params
        assert tuple(samples.metrics[number, :3]) == one.errors[:3]
    np.testing.assert_array_equal(samples.metrics[3], [NAN, INF, NAN, NAN])
    assert np.isnan(samples.params[3]).all()


def test_a_chunk_is_kept_whole_or_not_at_all(path: Path) -> None:
    """Where the disk is full amid a chunk, none of it is kept, and the study is as it was."""
    with open_study(path, IDENTITY, resume=True) as study:
        pages = study.connection.execute("PRAGMA page_count").fetchone()[0]
        study.connection.execute(f"PRAGMA max_page_count = {pages + 2}")
        assert "full" in refusal(lambda: study.add(NAME, [result(number) for number in range(100, 2000)]))
        study.add(NAME, [result(5)])
        assert study.done(NAME) == set(range(6))


def test_samples_stay_as_they_are(path: Path) -> None:
    """What is there is not overwritten by the same sample computed again."""
    with open_study(path, IDENTITY, resume=True) as study:
        study.add(NAME, [replace(result(0), message="other"), result(9)])
        assert study.load(NAME).message[0] == ""
        assert 9 in study.done(NAME)


def test_a_study_is_read_while_it_runs(path: Path) -> None:
    """A reader sees what is kept so far."""
    with open_study(path, IDENTITY, resume=True) as study, read_study(path) as reader:
        study.add(NAME, [result(5)])
        assert 5 in reader.done(NAME)


def test_a_transaction_that_was_killed_is_not_read(path: Path) -> None:
    """What a killed program left half done is refused, and undone when the study is gone on with."""
    killed = path.with_name("killed.sqlite")
    with closing(sqlite3.connect(path, isolation_level=None)) as connection:
        connection.execute("PRAGMA cache_size = 1")
        connection.execute("BEGIN IMMEDIATE")
        connection.execute("UPDATE sample SET iterations = 99, message = hex(randomblob(20000))")
        for suffix in ("", "-journal"):
            shutil.copy(f"{path}{suffix}", f"{killed}{suffix}")
        connection.execute("ROLLBACK")
    assert "go on with it with --resume" in refusal(lambda: read_study(killed))
    with open_study(killed, IDENTITY, resume=True) as study:
        assert study.load(NAME).message[0] == ""


def test_a_study_is_not_overwritten(path: Path) -> None:
    """Without `resume`, a study that is there is refused, with the remedy, and stays."""
    before = path.read_bytes()
    assert "--resume" in refusal(lambda: open_study(path, IDENTITY, resume=False))
    assert path.read_bytes() == before


@pytest.mark.parametrize(
    ("other", "message"),
    [
        (replace(IDENTITY, seed=6), "is a study of seed 5, not 6"),
        (replace(IDENTITY, settings=(("model", "luhmann"), ("weighted", "yes"))), "model 'opencv', not 'luhmann'"),
        (replace(IDENTITY, inputs=(("detections", "c" * 64), ("target", "b" * 64))), "detections has changed"),
        (replace(IDENTITY, inputs=IDENTITY.inputs[:1]), "with target"),
        (replace(IDENTITY, inputs=(*IDENTITY.inputs, ("truth", "c" * 64))), "without truth"),
    ],
)
def test_another_study_is_refused(path: Path, other: StudyIdentity, message: str) -> None:
    """A file of another seed, other settings or changed inputs is refused, and stays."""
    before = path.read_bytes()
    assert message in refusal(lambda: open_study(path, other, resume=True))
    assert path.read_bytes() == before


def test_other_sizes_are_added(path: Path) -> None:
    """A study takes further cases; one of a name that it has must be the same."""
    with open_study(path, IDENTITY, resume=True) as study:
        study.declare(CASE)
        study.declare(replace(CASE, case=replace(CASE.case, size=50)))
        assert [one.case.size for one in study.cases()] == [20, 50]
        assert "another case 'Brett" in refusal(lambda: study.declare(replace(CASE, case=replace(CASE.case, pool=60))))
        assert "no case 'ico'" in refusal(lambda: study.load("ico"))


def test_changed_files_have_another_identity(tmp_path: Path) -> None:
    """An input is known by its content, wherever it is."""
    for name, text in (("a", "one"), ("b", "one"), ("c", "two")):
        (tmp_path / name).write_text(text)
    one, same, other = (identity_of(1, {}, {"target": tmp_path / name}) for name in "abc")
    assert one == same
    assert one != other
    assert "cannot be read" in refusal(lambda: identity_of(1, {}, {"target": tmp_path / "none"}))


def test_a_run_killed_in_its_first_moments_is_started_anew(tmp_path: Path) -> None:
    """A file without tables, as a run leaves it that dies at once, is as good as none."""
    connection = sqlite3.connect(tmp_path / "s")
    connection.execute("PRAGMA journal_mode = WAL")
    connection.close()
    assert (tmp_path / "s").stat().st_size > 0
    open_study(tmp_path / "s", IDENTITY, resume=True).close()
    (tmp_path / "t").touch()
    open_study(tmp_path / "t", IDENTITY, resume=False).close()


def changed(*statements: str) -> Callable[[Path], None]:
    """Statements run on a study, as somebody with an editor might."""

    def run(path: Path) -> None:
        connection = sqlite3.connect(path)
        for statement in statements:
            connection.execute(statement)
        connection.commit()
        connection.close()

    return run


def as_folder(path: Path) -> None:
    path.unlink()
    path.mkdir()


ENDLESS = "WITH RECURSIVE n(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM n) SELECT x FROM n"


@pytest.mark.parametrize(
    "harm",
    [
        lambda path: path.write_bytes(b"not a database" * 500),
        lambda path: path.write_bytes(path.read_bytes()[:5000]),
        as_folder,
        changed("PRAGMA application_id = 1"),
        changed("PRAGMA user_version = 2"),
        changed("DROP TABLE program"),
        changed("ALTER TABLE sample ADD COLUMN more TEXT"),
        changed("DROP TABLE sample", f"CREATE VIEW sample AS {ENDLESS}"),
        changed("CREATE TRIGGER t AFTER INSERT ON program BEGIN DELETE FROM sample; END"),
        changed("DELETE FROM identity"),
        changed("UPDATE identity SET value = 'x' WHERE kind = 'seed'"),
        changed("UPDATE cases SET covariance = x'00'"),
        changed("UPDATE cases SET size = 'many'"),
        changed("UPDATE cases SET params = 1 << 40"),
        changed("UPDATE cases SET name = CAST(x'ff' AS TEXT)"),
        changed("UPDATE sample SET params = x'00' WHERE number = 1"),
        changed("UPDATE sample SET status = 'well' WHERE number = 1"),
        changed("UPDATE sample SET pose_mm = 'far' WHERE number = 1"),
        changed("UPDATE sample SET number = -1 WHERE number = 1"),
        changed("UPDATE sample SET message = CAST(x'fffe' AS TEXT) WHERE number = 1"),
    ],
)
def test_damaged_and_hostile_files(path: Path, harm: Callable[[Path], None]) -> None:
    """What is no study, or one that was tampered with, is refused in one line, and stays as it is."""
    harm(path)
    before = None if path.is_dir() else path.read_bytes()
    assert refusal(lambda: read_all(path)).startswith(str(path))
    try:
        open_study(path, IDENTITY, resume=True).close()  # samples are not looked at before they are asked for
    except InputError:
        assert before is None or path.read_bytes() == before


def test_flipped_bytes(path: Path, tmp_path: Path) -> None:
    """A file with any bytes changed is read or refused in one line, and nothing else."""
    rng = np.random.default_rng(3)
    whole = np.frombuffer(path.read_bytes(), dtype=np.uint8)
    used = np.flatnonzero(whole)
    messages = []
    for trial in range(150):
        content = whole.copy()
        content[rng.choice(used, rng.integers(1, 4))] = rng.integers(256)
        place = tmp_path / f"{trial}.sqlite"
        place.write_bytes(content.tobytes())
        try:
            read_all(place)
            open_study(place, IDENTITY, resume=True).close()
        except InputError as error:
            messages.append(str(error))
    assert len(messages) > 20
    assert not [message for message in messages if "\n" in message]


def test_names_that_are_no_files(tmp_path: Path, path: Path) -> None:
    """A missing file, a folder that is none, or a name that no file can have: one line."""
    assert "no study" in refusal(lambda: read_study(tmp_path / "none"))
    assert "cannot be" in refusal(lambda: open_study(tmp_path / "no" / "s", IDENTITY, resume=True))
    assert "cannot be" in refusal(lambda: open_study(path / "s", IDENTITY, resume=True))
    assert "cannot be" in refusal(lambda: read_study(Path("a\0b")))


def test_names_with_signs_of_addresses(tmp_path: Path, path: Path) -> None:
    """A folder's name may hold what has a meaning in an address."""
    folder = tmp_path / "50% of? it#é"
    folder.mkdir()
    shutil.copy(path, folder / "s")
    with read_study(folder / "s") as study:
        assert study.done(NAME) == {0, 1, 2, 3, 4}
