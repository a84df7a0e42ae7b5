"""Blocks as Markdown: `markdown("A title", sections)`; what only a page can show is left out."""

from collections.abc import Iterable, Iterator, Sequence

from designer.page.blocks import Block, Command, Facts, Findings, Fold, Paragraph, Section, Sliders, Steps, Table

_STEERING = str.maketrans({character: f"\\{character}" for character in "\\`*_|<>#"} | {"\n": "<br>"})


def plain(text: str) -> str:
    """Text that Markdown shows as it is; brackets are left alone but where they would be a link."""
    return text.translate(_STEERING).replace("](", "]\\(")


def markdown_table(head: Sequence[str], body: Iterable[Sequence[str]]) -> str:
    """A table of cells that are shown as they are."""
    lines = [head, ["---"] * len(head), *body]
    return "\n".join("| " + " | ".join(plain(cell) for cell in cells) + " |" for cells in lines)


def markdown(title: str, sections: Iterable[Section], lead: str = "") -> str:
    """A text with a heading for each section that has more than pictures, below a sentence if there is one."""
    parts = [f"# {plain(title)}", *([plain(lead)] if lead else [])]
    for section in sections:
        if blocks := [part for block in section.blocks for part in _block(block)]:
            parts += [f"## {plain(section.title)}", *([plain(section.lead)] if section.lead else []), *blocks]
    return "\n\n".join(parts) + "\n"


def _block(block: Block) -> Iterator[str]:
    """The parts of a block, with an empty line between them."""
    match block:
        case Paragraph(text):
            yield plain(text)
        case Facts(rows):
            yield "\n".join(f"- {plain(name)}: {plain(value)}" for name, value in rows)
        case Findings(rows):
            yield "\n".join(
                f"- {plain(one.title)}{': ' if one.title else ''}{plain(' '.join((one.measured, one.text)).strip())}"
                for one in rows
            )
        case Table():
            yield from _table(block)
        case Steps(items):
            yield "\n".join(f"{number}. {plain(item)}" for number, item in enumerate(items, 1))
        case Command(line):
            yield f"```sh\n{line}\n```"
        case Sliders():
            yield from _table(block.table)
        case Fold():
            parts = [part for one in block.blocks for part in _block(one)]
            yield from (f"**{plain(block.title)}**", *parts) if parts else ()


def _table(table: Table) -> Iterator[str]:
    if table.title:
        yield f"**{plain(table.title)}**"
    body = [[cell.text for cell in row] for row in table.rows]
    yield markdown_table([column.title for column in table.columns], body)
    if table.note:
        yield plain(table.note)
