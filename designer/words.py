"""Small matters of writing."""


def capital(text: str) -> str:
    """With a capital first letter; the rest stays, as names and units have to."""
    return text[:1].upper() + text[1:]


def with_article(text: str) -> str:
    """As in `an icosahedron`: with the article that goes before its first letter."""
    return f"{'an' if text[:1].lower() in 'aeio' else 'a'} {text}"
