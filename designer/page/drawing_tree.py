"""The elements of an SVG file, read within bounds and without entities."""

from dataclasses import dataclass, field
from xml.parsers import expat

SVG = "http://www.w3.org/2000/svg"
XLINK_HREF = "http://www.w3.org/1999/xlink href"
MAX_BYTES = 20_000_000
MAX_DEPTH = 64
MAX_ELEMENTS = 500_000


@dataclass(frozen=True)
class Element:
    """An element of any kind; what it may hold is for others to judge."""

    name: str  # local, of SVG; "" of other namespaces
    attributes: dict[str, str]  # by local name, or "namespace name"
    children: list["Element"] = field(default_factory=list)
    texts: list[str] = field(default_factory=list)  # before the first child, after the first, ...

    @property
    def text(self) -> str:
        """All its own text."""
        return "".join(self.texts)


class _Builder:
    """Puts elements together as expat reports them."""

    def __init__(self) -> None:
        self.top = Element("", {})
        self._open = [self.top]
        self._elements = 0

    def start(self, name: str, attributes: dict[str, str]) -> None:
        """An element begins."""
        self._elements += 1
        if len(self._open) > MAX_DEPTH:
            raise ValueError(f"drawing: nested deeper than {MAX_DEPTH} elements")
        if self._elements > MAX_ELEMENTS:
            raise ValueError(f"drawing: more than {MAX_ELEMENTS} elements")
        namespace, _, local = name.rpartition(" ")
        element = Element(local if namespace == SVG else "", attributes)
        parent = self._open[-1]
        self._fill_texts(parent)
        parent.children.append(element)
        self._open.append(element)

    def end(self, _: str) -> None:
        """The innermost element ends."""
        self._fill_texts(self._open.pop())

    def text(self, text: str) -> None:
        """A piece of text."""
        element = self._open[-1]
        if len(element.texts) <= len(element.children):
            self._fill_texts(element)
        element.texts[-1] += text

    @staticmethod
    def _fill_texts(element: Element) -> None:
        """Make room for the text after the last child."""
        element.texts.extend([""] * (len(element.children) + 1 - len(element.texts)))


def parse_svg(content: bytes) -> Element:
    """The root of an SVG file.

    A document type is let pass, as matplotlib writes one, but nothing in it: entities are how a small file becomes a
    large one, and how it reads others.

    Raises:
        ValueError: no SVG, larger or deeper than bounds, or with declarations of its own.
    """
    if len(content) > MAX_BYTES:
        raise ValueError(f"drawing: more than {MAX_BYTES} bytes")
    builder = _Builder()
    parser = expat.ParserCreate(namespace_separator=" ")
    parser.buffer_text = True
    parser.StartElementHandler = builder.start
    parser.EndElementHandler = builder.end
    parser.CharacterDataHandler = builder.text
    parser.StartDoctypeDeclHandler = _refuse_declarations
    try:
        parser.Parse(content, True)
    except expat.ExpatError as error:
        raise ValueError(f"drawing: {error}; no SVG") from None
    (root,) = builder.top.children
    if root.name != "svg":
        raise ValueError("drawing: no SVG, by its outermost element")
    return root


def _refuse_declarations(_name: str, _system: str | None, _public: str | None, has_declarations: int) -> None:
    """Stop at a document type that declares something."""
    if has_declarations:
        raise ValueError("drawing: declares entities or elements of its own")
