"""Pictures for a page: pixels and small versions of them, and SVG drawings of matplotlib that follow its scheme."""

import io
import re
import warnings
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from designer.page.blocks import Raster, Svg

if TYPE_CHECKING:
    from PIL.Image import Image

_PNG = b"\x89PNG\r\n\x1a\n"
_JPEG = b"\xff\xd8\xff"
# Colours without meaning, those of `calib.draw.style` and of matplotlib itself: on light, on dark, and what is so.
_NEUTRAL = {
    "ink": ("#1a1a1a", "#e6e9ec", ("#1a1a1a", "#262626", "#000000")),
    "grey": ("#6b6b6b", "#a3abb3", ("#6b6b6b", "#7f7f7f", "#808080")),
    "faint": ("#bdbdbd", "#59616a", ("#bdbdbd", "#b0b0b0", "#cccccc")),
    "empty": ("#e4e4e4", "#343a41", ("#e4e4e4",)),
    "paper": ("#ffffff", "#1a1d21", ("#ffffff",)),
}
_NAME = {colour: name for name, (_, _, colours) in _NEUTRAL.items() for colour in colours}
_LIGHT, _DARK = (";".join(f"--{name}:{colours[n]}" for name, colours in _NEUTRAL.items()) for n in (0, 1))
_STYLE = (
    f"<style>:root{{{_LIGHT};fill:var(--ink)}}@media screen and (prefers-color-scheme:dark){{:root{{{_DARK}}}}}"
    'text{font-family:"DejaVu Sans",Verdana,"Bitstream Vera Sans",sans-serif!important}</style>'
)
_COLOUR = re.compile(rf"\b((?:fill|stroke)(?:: |=\"))({'|'.join(_NAME)})\b", re.IGNORECASE)
_SIZE = re.compile(r'\bviewBox="0 0 ([0-9]+(?:\.[0-9]+)?) ([0-9]+(?:\.[0-9]+)?)"')
_PX_PER_POINT = 96 / 72


def raster_of(content: bytes) -> Raster:
    """The picture in a PNG or JPEG file, with the size that its head states.

    Raises:
        ValueError: neither PNG nor JPEG, or cut off before its size.
    """
    media_type(content)
    with _open(content) as image:
        return Raster(content, *image.size)


def media_type(content: bytes) -> str:
    """What a browser is told of a picture, by its content.

    Raises:
        ValueError: neither PNG nor JPEG.
    """
    if content.startswith(_PNG):
        return "image/png"
    if content.startswith(_JPEG):
        return "image/jpeg"
    raise ValueError("picture: neither PNG nor JPEG by its first bytes")


def thumbnail(picture: bytes | NDArray[np.uint8], width_px: int) -> Raster:
    """A JPEG at most `width_px` wide and high in proportion, without the photo's metadata.

    The pixels stay as the sensor read them: an orientation noted in the file is not applied, as everywhere in images.

    Args:
        picture: a file that Pillow reads, or pixels (H, W) grey or (H, W, 3) RGB.
        width_px: of the result; a smaller picture keeps its size.

    Raises:
        ValueError: no picture, or one of more pixels than fit in memory.
    """
    from PIL.Image import Resampling

    image = _decoded(picture, width_px) if isinstance(picture, bytes) else _of_pixels(picture)
    small = _eight_bit(image)
    if small.width > width_px:
        height_px = max(1, round(small.height * width_px / small.width))
        small = small.resize((width_px, height_px), Resampling.LANCZOS, reducing_gap=3.0)
    stream = io.BytesIO()
    small.save(stream, "JPEG", quality=80, optimize=True, progressive=True)
    return Raster(stream.getvalue(), small.width, small.height)


def _open(content: bytes) -> "Image":
    """The picture in a file, not yet decoded."""
    from PIL import Image, UnidentifiedImageError

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)  # photos of 150 megapixels are usual here
            return Image.open(io.BytesIO(content))
    except (UnidentifiedImageError, OSError, SyntaxError, Image.DecompressionBombError) as error:
        raise ValueError(f"picture: cannot be read: {error}") from None


def _decoded(content: bytes, width_px: int) -> "Image":
    """The picture in a file; of a JPEG only as much as `width_px` needs is decoded."""
    image = _open(content)
    try:
        image.draft("L" if image.mode == "L" else "RGB", (2 * width_px, 2 * width_px))
        image.load()
    except (OSError, SyntaxError) as error:
        raise ValueError(f"picture: cannot be read: {error}") from None
    return image


def _of_pixels(pixels: NDArray[np.uint8]) -> "Image":
    """Pixels as a picture."""
    from PIL import Image

    if pixels.dtype != np.uint8 or not (pixels.ndim == 2 or (pixels.ndim == 3 and pixels.shape[2] == 3)):
        raise ValueError(f"picture: {pixels.dtype} of shape {pixels.shape}; must be uint8 (H, W) or (H, W, 3)")
    return Image.fromarray(np.ascontiguousarray(pixels))


def _eight_bit(image: "Image") -> "Image":
    """The picture in grey or RGB of 8 bits, transparent parts on white."""
    from PIL import Image

    if image.mode.startswith("I") or image.mode == "F":
        deep = np.asarray(image, dtype=np.float64)
        return Image.fromarray(np.clip(deep / 257, 0, 255).round().astype(np.uint8))
    if image.mode in {"LA", "PA", "RGBA"} or "transparency" in image.info:
        below = Image.new("RGBA", image.size, "white")
        return Image.alpha_composite(below, image.convert("RGBA")).convert("RGB")
    return image if image.mode in {"L", "RGB"} else image.convert("RGB")


def drawing_of_svg(svg: bytes) -> Svg:
    """A drawing of matplotlib for a page.

    As a picture (`<img>`) an SVG is a document of its own: a browser runs no script in it and fetches nothing for it,
    and its ids and styles are not the page's (SVG 2, section 2.2.6, secure static mode). So nothing is taken from it;
    colours without meaning become variables, which its own style sheet sets for light and dark.

    Raises:
        ValueError: no whole SVG as matplotlib writes it.
    """
    text = svg.decode("utf-8", "replace")
    start = text.find("<svg")
    end = text.find(">", start)
    size = _SIZE.search(text, start, end) if 0 <= start < end else None
    if size is None or "</svg>" not in text:
        raise ValueError("drawing: no SVG, or not all of it")
    coloured = _COLOUR.sub(lambda found: f"{found[1]}var(--{_NAME[found[2].lower()]})", text[end + 1 :])
    width_px, height_px = (round(float(side) * _PX_PER_POINT, 2) for side in size.groups())
    return Svg(f"{text[start : end + 1]}{_STYLE}{coloured}".encode(), width_px, height_px)
