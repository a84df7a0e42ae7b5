"""The files of a study's tables, and tables as CSV, for other programs."""

import csv
import io
from collections.abc import Mapping, Sequence
from typing import TypeVar, cast

from calib.observe.csv_table import ANY_NAME
from designer.base.codec import encode
from designer.base.small_file import JsonValue

Row = TypeVar("Row")

MARKDOWN_FILE, CSV_FILE, JSON_FILE = "table.md", "table.csv", "table.json"


def rows_to_csv(kind: type[Row], rows: Sequence[Row], heads: Sequence[Mapping[str, JsonValue]] = ()) -> bytes:
    """A line a row, its fields as columns; a head, if there are any, stands before each."""
    values = [encode(kind, row) for row in rows]
    lines = [
        {**head, **cast("dict[str, JsonValue]", row)}
        for head, row in zip(heads or [{}] * len(rows), values, strict=True)
    ]
    stream = io.StringIO()
    writer = csv.DictWriter(stream, list(lines[0]) if lines else ["none"], lineterminator="\n")
    writer.writeheader()
    for line in lines:
        writer.writerow({name: "" if value is None else value for name, value in line.items()})
    return stream.getvalue().encode("utf-8", ANY_NAME)
