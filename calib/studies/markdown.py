"""Tables and text as Markdown."""

from collections.abc import Iterable, Sequence

_STEERING = str.maketrans({character: f"\\{character}" for character in "\\`*_|<>#"} | {"\n": "<br>"})


def plain(text: str) -> str:
    """Text that Markdown shows as it is; brackets are left alone but where they would be a link."""
    return text.translate(_STEERING).replace("](", "]\\(")


def markdown_table(head: Sequence[str], body: Iterable[Sequence[str]]) -> str:
    """A table of cells that are shown as they are."""
    lines = [head, ["---"] * len(head), *body]
    return "\n".join("| " + " | ".join(plain(cell) for cell in cells) + " |" for cells in lines)
