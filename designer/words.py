"""Small matters of writing."""


def capital(text: str) -> str:
    """With a capital first letter; the rest stays, as names and units have to."""
    return text[:1].upper() + text[1:]
