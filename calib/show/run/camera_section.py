"""The camera of a calibration on its page: key facts, parameters, and the files to use."""

import math
import shlex

import numpy as np

from calib.cameras import rays
from calib.cameras.camera import Camera
from calib.core.number_text import figure as digits
from calib.figures.sigma_map import SigmaMap
from calib.show.run.accuracy_figures import uncertainty_figure
from calib.show.run.evaluation_table import focal_length
from calib.show.run.run_folder import RunFolder, Solved
from calib.show.run.run_tables import parameters_table
from calib.verdict.halves import HalvesApart, NoHalves
from designer.page.blocks import Block, Command, Facts, Fold, Section


def page_lead(best: Solved, found: SigmaMap, halves: HalvesApart | NoHalves) -> tuple[Block, ...]:
    """The picture that says most, and key facts."""
    calibration = best.calibration
    seen = calibration.observations
    width, height = calibration.camera.image_size
    facts = (
        ("camera model", best.model),
        ("image", f"{width} x {height} px"),
        (focal_title(calibration.camera), f"{focal_length(calibration).replace('+-', '±')} px"),
        ("field of view", field_of_view_words(calibration.camera)),
        ("photos used", str(seen.view_count)),
        ("sightings", f"{int((~calibration.is_outlier).sum())} rings and dots"),
        ("left over (RMS)", f"{digits(best.rmse_px, 3)} px"),
        ("image covered", f"{100 * best.coverage.share:.0f} %"),
        ("solution", calibration.status),
    )
    return uncertainty_figure(best, found, halves), Facts(facts)


def focal_title(camera: Camera) -> str:
    """What a focal length is called: that of a learned map is none of the lens."""
    return "focal length" if camera.learned is None else "focal length of the virtual sensor"


def field_of_view_words(camera: Camera) -> str:
    """Angles between the rays through the middles of opposite sides; of the linear part where the model has none."""
    width, height = camera.image_size
    middle = np.array([[0, height / 2], [width - 1, height / 2], [width / 2, 0], [width / 2, height - 1]])
    ray = rays(camera, middle)
    if not np.isfinite(ray).all():
        ray = np.column_stack([(middle - camera.params[2:4]) / camera.params[:2], np.ones(4)])
    unit = ray / np.linalg.norm(ray, axis=1, keepdims=True)
    across, down = (
        math.degrees(math.acos(min(1.0, max(-1.0, float(unit[k] @ unit[k + 1]))))) for k in (0, 2)
    )  # fmt: skip
    return f"{across:.1f}° x {down:.1f}°"


def camera_section(run: RunFolder, best: Solved, *, is_usable: bool) -> Section:
    """Parameters, and the files to use.

    Args:
        run: the folder.
        best: its camera.
        is_usable: whether to say how to use it; a camera that is judged unfit is not handed on.
    """
    place = f"{best.path}camera.json"
    blocks: list[Block] = [parameters_table(best)]
    blocks += [
        Fold(f"Parameters of model {one.model}", (parameters_table(one),)) for one in run.solved if one is not best
    ]
    if is_usable:
        blocks.append(Command(
            f"calib convert {shlex.quote(place)} --to opencv -o camera.yaml",
            "To use it: camera.json holds all; for OpenCV (ros, kalibr, colmap, mrcal, metashape) type in this folder",
        ))  # fmt: skip
    calibration = best.calibration
    words = (
        f"{focal_title(calibration.camera).capitalize()} {focal_length(calibration).replace('+-', '±')} px, "
        f"field of view {field_of_view_words(calibration.camera)}; "
        + (f"{place} is the file to use." if is_usable else f"{place} is not to be used: see the verdict.")
    )
    return Section("Camera", tuple(blocks), lead=words)
