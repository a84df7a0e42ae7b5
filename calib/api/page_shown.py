"""Results that a notebook shows as their page."""

from abc import ABC, abstractmethod
from html import escape
from os import PathLike
from pathlib import Path
from tempfile import TemporaryDirectory


class ShownAsPage(ABC):
    """What a notebook shows is the page that the command writes."""

    kind: str  # of the page

    @abstractmethod
    def save(self, place: str | PathLike[str], /) -> tuple[Path, ...]:
        """Write the results; return the files."""

    def _save_in(self, folder: Path) -> None:
        self.save(folder)

    def _repr_html_(self) -> str:
        from calib.show.folder import PAGE_FILE, write_folder_page

        with TemporaryDirectory() as folder:
            self._save_in(Path(folder))
            page = Path(folder) / PAGE_FILE
            if not page.exists():
                write_folder_page(page.parent, self.kind, "")
            text = page.read_text(encoding="utf-8")
        return f'<iframe srcdoc="{escape(text)}" width="100%" height="800" style="border:0"></iframe>'
