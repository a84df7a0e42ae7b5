"""The preview's panels as pictures of their own: the target, and the net of its faces."""

import io
from dataclasses import dataclass

import numpy as np
from PIL import Image

from designer.formats.png import CAPTION_PX, HEIGHT_PX
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
    """Cut the preview that `designer.formats.png` made, without its caption."""
    pixels = np.asarray(Image.open(io.BytesIO(png)).convert("RGB"))[:-CAPTION_PX]  # (H, W, 3)
    target, net = pixels[:, :HEIGHT_PX], pixels[:, HEIGHT_PX:]
    return Panels(thumbnail(target, POSTER_PX), thumbnail(net, NET_PX) if net.size else None)
