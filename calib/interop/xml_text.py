"""XML of other tools, read without trust: no document types, hence no entities of a file's own; bounded depth."""

from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

from designer.base.errors import InputError

MAX_DEPTH = 40


def parse_xml(text: str, origin: str) -> Element:
    """The root of an XML text.

    Raises:
        InputError: not XML, with a document type, or nested too deep; the message names file and place.
    """
    builder, depth = TreeBuilder(), 0

    def start(name: str, attributes: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        if depth > MAX_DEPTH:
            raise InputError(f"{origin}: nested too deep for a camera file")
        builder.start(name, attributes)

    def end(name: str) -> None:
        nonlocal depth
        depth -= 1
        builder.end(name)

    def refuse(*_: object) -> None:
        raise InputError(f"{origin}: XML with a document type is refused, as no camera file has one; delete <!DOCTYPE>")

    parser = expat.ParserCreate()
    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.CharacterDataHandler = builder.data
    parser.StartDoctypeDeclHandler = refuse
    try:
        parser.Parse(text, True)
        return builder.close()
    except expat.ExpatError as error:
        what = expat.errors.messages.get(error.code, "not well formed")
        raise InputError(f"{origin}: line {error.lineno}: {what}; not valid XML") from None
    except UnicodeEncodeError:
        raise InputError(f"{origin}: not text; not valid XML") from None
