"""A file of JSON is a dataclass: `VERDICT.text(judged)` writes it, `VERDICT.read(path)` reads it back bit for bit.

    VERDICT = FileKind(Judged, "verdict", "a verdict.json", "solve again")

Format, version, size, nesting, keys that stand there twice, and the rules of `designer.base.codec` are checked here and
nowhere else.
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Generic, TypeVar, cast

from designer.base.codec import BadValueError, decode, encode
from designer.base.errors import InputError
from designer.base.files import JsonValue, parse_json, read_small_text
from designer.base.words import NAME, shown

T = TypeVar("T")


@dataclass(frozen=True)
class FileKind(Generic[T]):
    """A kind of file: what it holds, what it is called, what is said of one that does not read."""

    holds: type[T]
    kind: str  # "verdict": its format is "ringsolid.verdict"
    what: str  # with its article, as in "a verdict.json"
    remedy: str  # what to do about one that does not read
    version: int = 1
    largest_bytes: int = 64 * 2**20

    @property
    def format(self) -> str:
        """What the file says of itself."""
        return f"{NAME}.{self.kind}"

    def document(self, value: T) -> dict[str, JsonValue]:
        """The keys of a file, its format first."""
        body = cast("dict[str, JsonValue]", encode(self.holds, value))
        return {"format": self.format, "version": self.version, **body}

    def text(self, value: T) -> bytes:
        """The content of a file."""
        return (laid_out(self.document(value)) + "\n").encode()

    def read(self, path: Path) -> T:
        """What a file holds.

        Raises:
            InputError: it cannot be read, is of another format or version, or breaks a rule: one line that names the
                file, the place, and what to do.
        """
        return self.of(self.parsed(path), str(path))

    def parsed(self, path: Path) -> JsonValue:
        """The document in a file, not yet checked.

        Raises:
            InputError: it cannot be read, is larger than any of its kind, or is no JSON.
        """
        try:
            return parse_json(read_small_text(path, self.largest_bytes, self.what), path, self.what)
        except InputError as error:
            raise InputError(f"{error}; {self.remedy}" if path.is_file() else str(error)) from None

    def read_if_there(self, path: Path) -> T | None:
        """What a file holds; None if there is none.

        Raises:
            InputError: as `read`.
        """
        return self.read(path) if path.exists() else None

    def of(self, document: JsonValue, origin: str) -> T:
        """What a document holds, that came from a place that messages name.

        Raises:
            InputError: as `read`.
        """
        body = self._body(document, origin)
        try:
            return decode(self.holds, body)
        except BadValueError as error:
            raise InputError(f"{origin}: {' '.join(str(error).split())}; {self.remedy}") from None
        except InputError as error:
            raise InputError(f"{origin}: {error}") from None

    def keys(self, path: Path) -> dict[str, JsonValue]:
        """What a file holds, not yet decoded: to look at a few keys of a large one.

        Raises:
            InputError: it cannot be read, or is of another format or version.
        """
        return self._body(self.parsed(path), str(path))

    def _body(self, document: JsonValue, origin: str) -> dict[str, JsonValue]:
        if not isinstance(document, dict) or document.get("format") != self.format:
            raise InputError(f'{origin}: not {self.what}: it must hold "format": "{self.format}"; {self.remedy}')
        version = document.get("version")
        if type(version) is not int or version != self.version:
            told = f"this program reads version {self.version}"
            raise InputError(f"{origin}: version {shown(version)}; {told}: use the version that wrote it")
        return {key: value for key, value in document.items() if key not in ("format", "version")}


def laid_out(value: JsonValue, indent: str = "") -> str:
    """JSON that a person can read: a line a key, and a line an item of lists that hold more than plain values."""
    inner = f"{indent} "
    if isinstance(value, dict) and value:
        rows = ",\n".join(f"{inner}{json.dumps(key)}: {laid_out(one, inner)}" for key, one in value.items())
        return f"{{\n{rows}\n{indent}}}"
    if isinstance(value, list) and any(isinstance(one, list | dict) for one in value):
        rows = ",\n".join(inner + json.dumps(one, allow_nan=False) for one in value)
        return f"[\n{rows}\n{indent}]"
    return json.dumps(value, allow_nan=False)
