"""The preview's panels as pictures of their own: the target, and the net of its faces."""

import io
from dataclasses import dataclass

from PIL import Image

from designer.export.png import CAPTION_PX, HEIGHT_PX
from designer.page.blocks import Raster
from designer.page.raster import thumbnail

POSTER_PX = 800
NET_PX = 1400


@dataclass(frozen=True)
class Panels:
    """The two panels of a preview."""

    target: Raster
    net: Raster | None  # None: a board has a single face


def preview_panels(png: bytes) -> Panels:
    """Cut the preview that `designer.export.png` made, without its caption."""
    image = Image.open(io.BytesIO(png)).convert("RGB")
    height = image.height - CAPTION_PX
    target = image.crop((0, 0, HEIGHT_PX, height))
    net = image.crop((HEIGHT_PX, 0, image.width, height)) if image.width > HEIGHT_PX else None
    return Panels(_small(target, POSTER_PX), None if net is None else _small(net, NET_PX))


def _small(image: Image.Image, width_px: int) -> Raster:
    stream = io.BytesIO()
    image.save(stream, "PNG", compress_level=1)
    return thumbnail(stream.getvalue(), width_px)
