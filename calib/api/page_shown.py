"""Results that a notebook shows as their page."""

from abc import ABC, abstractmethod
from html import escape
from pathlib import Path
from tempfile import TemporaryDirectory


class ShownAsPage(ABC):
    """What a notebook shows is the page that the command writes."""

    @abstractmethod
    def _write_all(self, folder: Path) -> tuple[Path, ...]:
        """Write what the command writes, the page among it; return the files."""

    def _repr_html_(self) -> str:
        with TemporaryDirectory() as place:
            page = next(path for path in self._write_all(Path(place)) if path.suffix == ".html")
            text = page.read_text(encoding="utf-8")
        return f'<iframe srcdoc="{escape(text)}" width="100%" height="800" style="border:0"></iframe>'
