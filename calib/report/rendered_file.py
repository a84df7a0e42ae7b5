"""What `truth.json` says of rendered photos beside camera and poses: how they are to look."""

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Literal

from pydantic import JsonValue

from calib.render.options import RenderOptions
from calib.report.own_file import read_own, require_near
from calib.results.truth import Truth, read_truth
from designer.errors import InputError
from designer.page.blocks import Finding

REMEDY = "render again"


@dataclass(frozen=True)
class _FileKind:
    """How the images are stored."""

    format: Literal["png", "tiff", "jpeg"]
    quality: int


@dataclass(frozen=True)
class _Look:
    """The keys of `truth.json` that `read_truth` leaves."""

    seed: int
    options: RenderOptions
    file: _FileKind


@dataclass(frozen=True)
class _Keys:
    """The same, to see which options were written: one left out would pass for what is usual."""

    options: dict[str, JsonValue]


@dataclass(frozen=True, eq=False)
class RenderedSet:
    """A set of rendered photos."""

    truth: Truth
    options: RenderOptions
    seed: int
    stored_as: str  # "png, 8 bits"


def read_rendered(path: Path) -> RenderedSet:
    """Read `truth.json`, options and all.

    Raises:
        InputError: it cannot be read, or breaks a rule; the message names it.
    """
    truth = read_truth(path)
    require_near(path, truth.cam_from_target, REMEDY)
    look = read_own(path, _Look, REMEDY)
    if read_own(path, _Keys, REMEDY).options.keys() != {field.name for field in fields(RenderOptions)}:
        raise InputError(f"{path}: options: not those of this version; {REMEDY}")
    quality = f", quality {look.file.quality}" if look.file.format == "jpeg" else ""
    return RenderedSet(truth, look.options, look.seed, f"{look.file.format}{quality}, {look.options.bits} bits")


def option_words(options: RenderOptions) -> tuple[tuple[str, str], ...]:
    """What is on, as names and values; what is off is left out."""
    black, white, background = (f"{100 * light:.3g} %" for light in (options.black, options.white, options.background))
    sampling = "by area (anti-aliased)" if options.sampling == "area" else "one ray a pixel, black or white"
    focus = "the target's origin" if options.focus_mm is None else f"{options.focus_mm:g} mm"
    rows = (
        ("sampling", sampling, True),
        ("light of ink, white, background", f"{black}, {white}, {background}", True),
        ("blur", f"{options.blur_px:g} px (sigma)", options.blur_px),
        ("opening of the lens", f"{options.aperture_mm:g} mm, in focus at {focus}", options.aperture_mm),
        ("contrast over noise", f"{options.contrast_to_noise:g}", options.contrast_to_noise),
        ("read noise", f"{100 * options.read_noise:.3g} % of full scale", options.read_noise),
        ("shot noise", f"of {options.full_well:g} electrons at full scale", options.full_well),
        ("light lost in the corners", f"{100 * options.vignetting:.3g} %", options.vignetting),
        ("light gradient", f"{100 * options.light_gradient:.3g} %", options.light_gradient),
        ("shading", f"{100 * options.shading:.3g} %", options.shading),
        ("glare", f"{100 * options.glare:.3g} %", options.glare),
        ("clutter", f"{options.clutter} shapes", options.clutter),
        ("hidden by things in front", f"{100 * options.occlusion:.3g} %", options.occlusion),
        ("gamma", f"{options.gamma:g}", options.gamma != 1),
    )  # fmt: skip
    return tuple((name, value) for name, value, is_on in rows if is_on)


def effects(options: RenderOptions) -> str:
    """What makes the photos less than ideal, in a few words."""
    usual = {"sampling", "light of ink, white, background"}
    return ", ".join(f"{name} {value}" for name, value in option_words(options) if name not in usual)


def missing_finding(missing: int, total: int) -> Finding:
    """Of a set that was stopped."""
    return Finding(
        "usable", f"{missing} of {total} photos are not there",
        "The same command again renders those that are missing, and leaves the others as they are.",
    )  # fmt: skip
