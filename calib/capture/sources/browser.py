"""The camera of the browser that shows the page: its frames come with the page's messages."""

from calib.capture.messages import SourceKind
from calib.capture.sources.source import Put, Say


class BrowserCamera:
    """Whatever camera the person chooses on the page; what is wrong with it, the page says."""

    kind: SourceKind = "browser"
    name = "the browser's camera"

    def start(self, row: int, put: Put, say: Say) -> None:
        """As `Source`; there is nothing to begin."""

    def stop(self) -> None:
        """As `Source`."""
