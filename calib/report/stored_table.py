"""Reading the JSON tables of study folders: within bounds, one rule after the other, text on one line."""

from pathlib import Path
from typing import Annotated, TypeVar

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError

from designer.errors import InputError
from designer.small_file import JsonValue, parse_json, read_small_text
from designer.words import printable

MAX_FILE_BYTES = 64 * 2**20
LONGEST_TEXT = 4000
MOST_ROWS = 20_000
AGAIN = "run the study again with --resume"

Number = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=-1e100, le=1e100)]
Count = Annotated[int, Field(strict=True, ge=0, le=10**12)]
Word = Annotated[str, Field(strict=True, max_length=200), AfterValidator(printable)]
"""A name."""
Line = Annotated[str, Field(strict=True, max_length=LONGEST_TEXT), AfterValidator(printable)]
"""A sentence or two."""
Flag = Annotated[bool, Field(strict=True)]
FewLines = Annotated[tuple[Line, ...], Field(max_length=500)]


class Stored(BaseModel):
    """A part of a table; keys that a page does not show are left alone."""

    model_config = ConfigDict(frozen=True, extra="ignore")


Table = TypeVar("Table", bound=Stored)


def read_table(path: Path, model: type[Table], file_format: str, version: int, remedy: str = AGAIN) -> Table | None:
    """The table of a study; None if the folder has none.

    Args:
        path: of the file.
        model: what its keys must be.
        file_format: that it says it has.
        version: of the format.
        remedy: what a person may do about a damaged file.

    Raises:
        InputError: not JSON, of another format or version, or a key that breaks a rule; the message names it.
    """
    document = read_document(path, file_format, version, remedy)
    return None if document is None else checked(document, path, model, remedy)


def read_document(path: Path, file_format: str, version: int, remedy: str = AGAIN) -> dict[str, JsonValue] | None:
    """The keys of a JSON file of a format; None if there is no such file.

    Raises:
        InputError: not JSON, or of another format or version.
    """
    what = f"a {file_format} file"
    if not path.exists():
        return None
    try:
        document = parse_json(read_small_text(path, MAX_FILE_BYTES, what), path, what)
    except InputError as error:
        raise InputError(f"{error}; {remedy}") from None
    if not isinstance(document, dict) or document.get("format") != file_format:
        raise InputError(f'{path}: it must hold "format": "{file_format}"; {remedy}')
    if document.get("version") != version or isinstance(document["version"], bool):
        raise InputError(
            f"{path}: version {str(document.get('version'))[:20]!r}; this program reads version {version}: "
            "use the version that wrote it"
        )
    return document


def checked(document: dict[str, JsonValue], path: Path, model: type[Table], remedy: str = AGAIN) -> Table:
    """The keys of a file that a page needs.

    Raises:
        InputError: one breaks a rule; the message names it.
    """
    try:
        return model.model_validate(document)
    except ValidationError as error:
        first = error.errors()[0]
        place = printable(".".join(map(str, first["loc"])))[:200]
        raise InputError(f"{path}: {place}: {first['msg']}; {remedy}") from None
