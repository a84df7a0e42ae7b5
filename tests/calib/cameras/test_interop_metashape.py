"""Metashape's XML against the formulas of its manual."""

from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from calib.cameras.formats import FORMATS
from designer.base.errors import InputError
from tests.support.foreign_cameras import lens_camera, text_of, whole_image, written
from tests.support.foreign_projections import in_metashape

SENSORS = """<?xml version="1.0" encoding="UTF-8"?>
<document version="2.0.0"><chunk label="Chunk 1" enabled="true"><sensors next_id="2">
<sensor id="0" label="FC550, DJI MFT 15mm" type="frame"><resolution width="4608" height="3456"/>
  <calibration type="frame" class="initial"><resolution width="4608" height="3456"/><f>4000</f></calibration>
  <calibration type="frame" class="adjusted"><resolution width="4608" height="3456"/>
   <f>4317.5</f><cx>54.25</cx><cy>3.5</cy><k1>0.0167</k1><k2>-0.0239</k2><k3>0.0363</k3><p1>0.0035</p1><p2>0.001</p2>
  </calibration></sensor>
SECOND</sensors></chunk></document>
"""


@pytest.mark.parametrize(("kind", "extra"), [("equisolid_fisheye", ""), ("fisheye", "<p3>0.3</p3>")])
def test_other_fisheyes_of_metashape_are_fitted(kind: str, extra: str, tmp_path: Path) -> None:
    """Of equisolid ones x and y are 2 sin(theta / 2); these, and those with more terms, are off by what is told."""
    text = text_of("metashape", lens_camera("metashape", "fisheye"), "fisheye")
    text = text.replace(">fisheye<", f">{kind}<").replace("</calibration>", f"{extra}</calibration>")
    found = FORMATS["metashape"].read(text, "c", None)
    assert found.refit is not None
    pixel, ray = whole_image(found.camera)
    off = np.linalg.norm(in_metashape(text, ray, kind, found.camera.image_size, tmp_path) - pixel, axis=1)
    assert np.isfinite(off).mean() > 0.8
    assert np.sqrt(np.nanmean(off**2)) == pytest.approx(found.refit.rms_px, rel=0.1)  # taken at our rays, not at its


def test_a_fisheye_has_two_names() -> None:
    """Newer files call it an equidistant one."""
    camera = lens_camera("metashape", "fisheye")
    newer = text_of("metashape", camera, "fisheye").replace(">fisheye<", ">equidistant_fisheye<")
    assert FORMATS["metashape"].read(newer, "c", None).camera.params.tolist() == camera.params.tolist()


def test_p1_and_p2_are_swapped() -> None:
    """Metashape's P1 is OpenCV's p2 and the other way round; the pair of signs stays."""
    held, text = written("metashape", "barrel")
    root = ElementTree.fromstring(text)
    assert float(root.findtext("p1") or 0) == held.params[7] == -0.0004
    assert float(root.findtext("p2") or 0) == held.params[6] == 0.002


def test_the_half_pixel() -> None:
    """A principal point in the image's middle is cx = 0 in Metashape and 511.5 of 1024 here."""
    text = written("metashape", "pinhole")[1]
    camera = FORMATS["metashape"].read(text.replace(">-1.5<", ">0.0<").replace(">6.5<", ">0.0<"), "c", None).camera
    assert camera.params[2:4].tolist() == [511.5, 383.5]


@pytest.mark.parametrize("extra", [{"k4": 0.01}, {"p3": 0.2, "p4": -0.1}, {"k4": 0.02, "b2": -0.8}])
def test_what_our_lens_lacks_is_fitted(extra: dict[str, float], tmp_path: Path) -> None:
    """Numbers k4 and the higher tangential terms are fitted over the image, with the residual the formula shows."""
    text = written("metashape", "barrel")[1].replace("<b2>0.0</b2>\n", "")
    text = text.replace("</calibration>", "".join(f"<{k}>{v}</{k}>" for k, v in extra.items()) + "</calibration>")
    found = FORMATS["metashape"].read(text, "c", None)
    assert found.refit is not None
    assert next(iter(extra)) in found.remarks[0]
    pixel, ray = whole_image(found.camera)
    off = np.linalg.norm(in_metashape(text, ray, "", found.camera.image_size, tmp_path) - pixel, axis=1)
    assert found.refit.max_px > 1e-4
    assert off.max() == pytest.approx(found.refit.max_px, rel=0.1)  # taken at our rays, not at its


def test_the_adjusted_calibration_of_exported_cameras() -> None:
    """Of a sensor's two calibrations the adjusted one counts; of two sensors one must be named."""
    read = FORMATS["metashape"].read
    camera = read(SENSORS.replace("SECOND", ""), "cameras.xml", None).camera
    assert camera.params.tolist() == [
        4317.5,
        4317.5,
        2304 + 54.25 - 0.5,
        1728 + 3.5 - 0.5,
        0.0167,
        -0.0239,
        0.001,
        0.0035,
        0.0363,
    ]
    second = '<sensor id="1" label="b" type="frame"><calibration type="spherical"><f>9</f></calibration></sensor>'
    both = SENSORS.replace("SECOND", second)
    assert read(both, "cameras.xml", "FC550, DJI MFT 15mm").camera.params[0] == 4317.5
    with pytest.raises(InputError, match=r"holds 2 cameras \(FC550, DJI MFT 15mm, b\); name one"):
        read(both, "cameras.xml", None)
    with pytest.raises(InputError, match="'spherical' camera: not supported"):
        read(both, "cameras.xml", "b")


def test_old_photoscan_files() -> None:
    """Files with fx and a principal point counted from the corner are of another convention, and refused."""
    text = "<calibration><projection>frame</projection><width>9</width><height>9</height><fx>9</fx></calibration>"
    with pytest.raises(InputError, match="an old PhotoScan; save it again"):
        FORMATS["metashape"].read(text, "c", None)
