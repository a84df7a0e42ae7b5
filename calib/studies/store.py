"""`study.sqlite`: the samples of a study, one row each, kept so that a killed run goes on where it was."""

import sqlite3
import stat
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path

from calib.studies.identity import StudyIdentity, program_versions
from calib.studies.samples import (
    SampleResult,
    Samples,
    StoredCase,
    case_from_row,
    row_of,
    row_of_case,
    samples_from_rows,
)
from designer.base.errors import InputError
from designer.base.words import printable

APPLICATION_ID = 0x52465354
"""In the header of the file: "RFST"."""
VERSION = 1
MAX_FILE_BYTES = 4 * 2**30
MOST_SAMPLES = 4_000_000
LONGEST_VALUE_BYTES = 2**24
"""The covariance of a thousand parameters is half as long; SQLite refuses to read what is longer."""
BUSY_S = 20.0
"""Another run on the same file holds its lock for milliseconds."""

SCHEMA = {
    "identity": "CREATE TABLE identity (kind TEXT NOT NULL, name TEXT NOT NULL, value TEXT NOT NULL, "
    "PRIMARY KEY (kind, name)) WITHOUT ROWID",
    "program": "CREATE TABLE program (name TEXT NOT NULL, version TEXT NOT NULL, "
    "PRIMARY KEY (name, version)) WITHOUT ROWID",
    "cases": "CREATE TABLE cases (name TEXT NOT NULL PRIMARY KEY, target TEXT NOT NULL, size INTEGER NOT NULL, "
    "pool INTEGER NOT NULL, sampling TEXT NOT NULL, sightings TEXT NOT NULL, model TEXT NOT NULL, "
    "params INTEGER NOT NULL, covariance BLOB NOT NULL, place INTEGER NOT NULL) WITHOUT ROWID",
    "sample": 'CREATE TABLE sample ("case" TEXT NOT NULL, number INTEGER NOT NULL, status TEXT NOT NULL, '
    "distinct_views INTEGER NOT NULL, reprojection_px REAL, intersection_mm REAL, reconstruction_mm REAL, "
    "pose_mm REAL, params BLOB NOT NULL, iterations INTEGER NOT NULL, message TEXT NOT NULL, "
    'PRIMARY KEY ("case", number)) WITHOUT ROWID',
}
"""Metrics that are not defined are NULL; parameters and their covariance are float64, little endian."""


@dataclass(frozen=True, eq=False)
class Study(AbstractContextManager["Study"]):
    """An open study file. Use it in one thread, and close it; `with` does."""

    path: Path
    identity: StudyIdentity
    connection: sqlite3.Connection

    def __exit__(self, *raised: object) -> None:
        self.close()

    def close(self) -> None:
        """Leave the file whole, without the two that SQLite keeps beside it while it is open."""
        with suppress(sqlite3.Error):  # somebody else reads it, or it was opened to be read
            # Else reading it would need a folder that can be written, and leave files there.
            self.connection.execute("PRAGMA busy_timeout = 0")
            self.connection.execute("PRAGMA journal_mode = DELETE")
        self.connection.close()

    def cases(self) -> tuple[StoredCase, ...]:
        """What has been sampled, in the order of its declaration."""
        with _one_line(self.path):
            rows = self.connection.execute("SELECT * FROM cases ORDER BY place")
            return tuple(case_from_row(self.path, row[:-1]) for row in rows)

    def declare(self, case: StoredCase) -> None:
        """Make a case known before its samples come.

        Raises:
            InputError: the file has a case of this name that is another.
        """
        known = {one.case.name: one for one in self.cases()}.get(case.case.name)
        if known is not None and known != case:
            raise InputError(
                f"{self.path}: holds another case {case.case.name!r} ({known.case.size} of {known.case.pool} views, "
                f"model {known.model}); start a new study in another folder"
            )
        with _one_line(self.path), _transaction(self.connection):
            self.connection.execute(
                "INSERT INTO cases SELECT ?, ?, ?, ?, ?, ?, ?, ?, ?, count(*) FROM cases WHERE true "
                "ON CONFLICT DO NOTHING",
                row_of_case(case),
            )

    def add(self, case: str, results: Sequence[SampleResult]) -> None:
        """Keep samples of a declared case: all of them or, if the program dies meanwhile, none.

        Samples that are there already stay as they are.
        """
        record = self._case(case)
        rows = [(case, *row_of(result, record.params)) for result in results]
        with _one_line(self.path), _transaction(self.connection):
            self.connection.executemany(
                "INSERT INTO sample VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?) ON CONFLICT DO NOTHING", rows
            )

    def done(self, case: str) -> set[int]:
        """The numbers of the samples that are there."""
        with _one_line(self.path):
            found = self.connection.execute('SELECT number FROM sample WHERE "case" = ?', (case,))
            return {number for (number,) in found if isinstance(number, int)}

    def load(self, case: str) -> Samples:
        """All samples of a case, by number."""
        record = self._case(case)
        with _one_line(self.path):
            found = self.connection.execute('SELECT * FROM sample WHERE "case" = ? ORDER BY number', (case,))
            return samples_from_rows(self.path, record, (row[1:] for row in found))

    def load_all(self) -> dict[str, Samples]:
        """The samples of every case that has some, by its name."""
        found = {one.case.name: self.load(one.case.name) for one in self.cases()}
        return {name: samples for name, samples in found.items() if len(samples.number)}

    def programs(self) -> tuple[tuple[str, str], ...]:
        """Names and versions of the programs that made the samples; twice the same name: it changed meanwhile."""
        with _one_line(self.path):
            rows = self.connection.execute("SELECT name, version FROM program ORDER BY name, version")
            return tuple((str(name), str(version)) for name, version in rows)

    def mixed_programs(self) -> tuple[str, ...]:
        """A line for each program of which several versions computed the samples."""
        found: dict[str, list[str]] = {}
        for name, version in self.programs():
            found.setdefault(name, []).append(version)
        return tuple(
            printable(f"the samples were computed by several versions of {name}: {', '.join(versions)}")
            for name, versions in found.items()
            if len(versions) > 1
        )

    def _case(self, name: str) -> StoredCase:
        record = {one.case.name: one for one in self.cases()}.get(name)
        if record is None:
            raise InputError(f"{self.path}: has no case {name!r}; run the study first")
        return record


def open_study(path: Path, identity: StudyIdentity, *, resume: bool) -> Study:
    """Start a study, or go on with it.

    Raises:
        InputError: the file is there and `resume` is not asked for, is of another study, is no study, or cannot be
            written.
    """
    _is_there(path, resume=resume)
    with _opened(path, "rwc") as connection:
        if not _holds_anything(connection):
            _create(connection, identity)
        _check_file(path, connection)
        known = _identity(path, connection)
        difference = known.difference(identity)
        if difference:
            raise InputError(f"{path}: {difference}")
        # Readers see the file while a run writes, and a commit costs no wait for the disk.
        connection.execute("PRAGMA journal_mode = WAL")
        with _transaction(connection):
            connection.executemany("INSERT INTO program VALUES (?, ?) ON CONFLICT DO NOTHING", list(program_versions()))
        return Study(path, known, connection)


def check_place(path: Path, identity: StudyIdentity, *, resume: bool) -> None:
    """Refuse before any work what `open_study` would refuse after it, but for inputs, which need not be there yet."""
    if not _is_there(path, resume=resume):
        return
    with _opened(path, "ro") as connection:
        if _holds_anything(connection):
            _check_file(path, connection)
            known = replace(_identity(path, connection), inputs=())
            if difference := known.difference(replace(identity, inputs=())):
                raise InputError(f"{path}: {difference}")
        connection.close()


def _is_there(path: Path, *, resume: bool) -> bool:
    """Whether there is a file; one that is not to be gone on with is refused."""
    present = _size(path) > 0
    if present and not resume:
        raise InputError(f"{path}: there is a study already; go on with it with --resume, or choose another -o")
    return present


def read_study(path: Path) -> Study:
    """Open a study to read it, while it runs too.

    Raises:
        InputError: there is none, or it is damaged.
    """
    if not _size(path):
        raise InputError(f"{path}: there is no study; run one first")
    with _opened(path, "ro") as connection:
        _check_file(path, connection)
        return Study(path, _identity(path, connection), connection)


def _size(path: Path) -> int:
    """Bytes of a regular file; 0 if there is none."""
    try:
        found = path.stat()
    except FileNotFoundError:
        return 0
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise InputError(f"{str(path)!r}: cannot be read: {reason}; check the path") from None
    if not stat.S_ISREG(found.st_mode):
        raise InputError(f"{path}: not a regular file; name a study.sqlite")
    if found.st_size > MAX_FILE_BYTES:
        raise InputError(f"{path}: more than {MAX_FILE_BYTES} bytes; a study is smaller")
    return found.st_size


@contextmanager
def _opened(path: Path, mode: str) -> Iterator[sqlite3.Connection]:
    """A connection that is closed again if what is done with it fails."""
    with _one_line(path):
        connection = sqlite3.connect(
            f"{path.absolute().as_uri()}?mode={mode}{_alone(path, mode)}",
            uri=True,
            timeout=BUSY_S,
            isolation_level=None,
        )
        try:
            connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, LONGEST_VALUE_BYTES)
            # What a file's schema defines is not run: it may come from anywhere.
            connection.execute("PRAGMA trusted_schema = OFF")
            connection.execute("PRAGMA cell_size_check = ON")
            yield connection
        except BaseException:
            connection.close()
            raise


def _alone(path: Path, mode: str) -> str:
    """Word to SQLite that nobody writes a file to be read, so that it leaves no files of its own beside it.

    A run that is under way, or was killed, has left such a file: with the latest samples in it, or with what the pages
    of a transaction that did not end were before.
    """
    beside = (path.with_name(f"{path.name}{suffix}") for suffix in ("-wal", "-journal"))
    return "" if mode != "ro" or any(one.exists() for one in beside) else "&immutable=1"


@contextmanager
def _one_line(path: Path) -> Iterator[None]:
    """What SQLite says, as bad input: the file is damaged or locked, or the disk is full."""
    try:
        yield
    except (sqlite3.Error, UnicodeError) as error:
        reason = str(error) or type(error).__name__
        is_half = getattr(error, "sqlite_errorcode", 0) == sqlite3.SQLITE_READONLY_ROLLBACK
        killed = "a run was killed as it wrote; go on with it with --resume, which undoes what was half done"
        remedy = killed if is_half else "check the disk and the path, or start a new study in another folder"
        raise InputError(f"{path}: cannot be used as a study: {reason}; {remedy}") from None


@contextmanager
def _transaction(connection: sqlite3.Connection) -> Iterator[None]:
    """All of it or nothing, whatever ends it."""
    connection.execute("BEGIN IMMEDIATE")
    try:
        yield
        connection.execute("COMMIT")
    except BaseException:
        if connection.in_transaction:
            connection.execute("ROLLBACK")
        raise


def _holds_anything(connection: sqlite3.Connection) -> bool:
    """Whether there are tables; a run that was killed in its first moments leaves a file without."""
    return connection.execute("SELECT 1 FROM sqlite_master LIMIT 1").fetchone() is not None


def _create(connection: sqlite3.Connection, identity: StudyIdentity) -> None:
    """Write the tables and the identity."""
    with _transaction(connection):
        if _holds_anything(connection):  # by another run, meanwhile
            return
        connection.execute(f"PRAGMA application_id = {APPLICATION_ID}")
        connection.execute(f"PRAGMA user_version = {VERSION}")
        for statement in SCHEMA.values():
            connection.execute(statement)
        connection.executemany("INSERT INTO identity VALUES (?, ?, ?)", list(identity.rows()))


def _check_file(path: Path, connection: sqlite3.Connection) -> None:
    """Refuse what is no study of this version, and damaged pages.

    The tables must be as this program makes them: views and triggers of others would run.
    """
    connection.execute("PRAGMA synchronous = NORMAL")
    (found_id,) = connection.execute("PRAGMA application_id").fetchone()
    (version,) = connection.execute("PRAGMA user_version").fetchone()
    if found_id != APPLICATION_ID:
        raise InputError(f"{path}: not a study of this program; choose another -o")
    if version != VERSION:
        raise InputError(f"{path}: a study of version {version}; this program reads version {VERSION}")
    tables = set(connection.execute("SELECT type, name, sql FROM sqlite_master LIMIT 100"))
    if tables != {("table", name, statement) for name, statement in SCHEMA.items()}:
        raise InputError(f"{path}: its tables are not those of a study; start a new study in another folder")
    (count,) = connection.execute("SELECT count(*) FROM sample").fetchone()
    if count > MOST_SAMPLES:
        raise InputError(f"{path}: {count} samples; at most {MOST_SAMPLES} are read")
    (verdict,) = connection.execute("PRAGMA quick_check(1)").fetchone()
    if verdict != "ok":
        raise InputError(f"{path}: is damaged; start a new study in another folder")


def _identity(path: Path, connection: sqlite3.Connection) -> StudyIdentity:
    rows = connection.execute("SELECT kind, name, value FROM identity ORDER BY kind, name")
    identity = StudyIdentity.from_rows(list(rows))
    if identity is None:
        raise InputError(f"{path}: does not say what study it is; start a new study in another folder")
    return identity
