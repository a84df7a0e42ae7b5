"""Control points for other programs: what their readers, or their documents, make of the files."""

import csv
import io
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import numpy as np
import pycolmap
import pytest

import calib
from calib.observe.dataset import write_detections
from calib.observe.marker_files import MARKER_FORMATS
from designer.base.errors import InputError
from tests.support.command_scene import BOARD, CAMERA, FOUND

SEEN = tuple(FOUND.values())
NAMES = {name: ring for ring, name in enumerate(BOARD.point_names)}


def texts(to: str) -> dict[str, str]:
    return calib.markers(BOARD, SEEN, to).texts


def check(places: dict[tuple[str, int], list[float]], offset: float) -> None:
    """Each point of each photo once, `offset` from where it was detected."""
    expected = {(one.image, int(ring)): at for one in SEEN for ring, at in zip(one.ring, one.center_px, strict=True)}
    assert places.keys() == expected.keys()
    for key, place in places.items():
        np.testing.assert_allclose(np.array(place) - offset, expected[key], atol=6e-5)


def test_metashape_finds_markers_by_ids_and_photos_by_labels() -> None:
    """Its XML: (0.5, 0.5) is the middle of the first pixel; places in space are in metres."""
    root = ET.fromstring(texts("metashape")["markers.xml"])
    photo = {one.attrib["id"]: f"{one.attrib['label']}.png" for one in root.iterfind("chunk/cameras/camera")}
    marker = {one.attrib["id"]: NAMES[one.attrib["label"]] for one in root.iterfind("chunk/markers/marker")}
    found = {
        (photo[one.attrib["camera_id"]], marker[each.attrib["marker_id"]]): [float(one.attrib[k]) for k in "xy"]
        for each in root.iterfind("chunk/frames/frame/markers/marker")
        for one in each
    }
    check(found, 0.5)
    for one in root.iterfind("chunk/markers/marker"):
        reference = one.find("reference")
        assert reference is not None
        place = [1000 * float(reference.attrib[k]) for k in "xyz"]
        np.testing.assert_allclose(place, BOARD.center_mm[NAMES[one.attrib["label"]]], atol=1e-9)


def test_realitycapture_counts_from_the_corner() -> None:
    """Image, point, x, y from the image's upper left corner; name, x, y, altitude in metres."""
    files = {name: [row for row in csv.reader(io.StringIO(text)) if row[0][0] != "#"]
             for name, text in texts("realitycapture").items()}  # fmt: skip
    check({(image, NAMES[name]): [float(x), float(y)] for image, name, x, y in files["measurements.csv"]}, 0.5)
    for name, *place in files["control_points.csv"]:
        np.testing.assert_allclose([1000 * float(one) for one in place], BOARD.center_mm[NAMES[name]], atol=1e-9)


def test_odm_counts_from_the_middle_of_the_first_pixel() -> None:
    """A projection, then geo_x geo_y geo_z im_x im_y image_name gcp_name (its documents).

    OpenSfM below it makes (u + .5 - width / 2) / size of a pixel, so that the middle of the first one is 0.
    """
    head, *lines = texts("odm")["gcp_list.txt"].splitlines()
    assert head.startswith("+proj=")
    rows = [line.split() for line in lines]
    check({(row[5], NAMES[row[6]]): [float(row[3]), float(row[4])] for row in rows}, 0.0)
    for row in rows:
        np.testing.assert_allclose([1000 * float(one) for one in row[:3]], BOARD.center_mm[NAMES[row[6]]], atol=1e-9)


def test_colmap_sees_them_where_the_camera_saw_them(tmp_path: Path) -> None:
    """With its camera, as `calib convert` writes it, a feature's ray is ours; features that match are one point."""
    files = texts("colmap")
    features = {}
    for one in SEEN:
        head, *lines = files[f"features/{one.image}.txt"].splitlines()
        assert (head, len(lines[0].split())) == (f"{len(one.ring)} 128", 4 + 128)
        features[one.image] = np.array([line.split()[:2] for line in lines], dtype=float)
    check({(one.image, int(ring)): list(at) for one in SEEN
           for ring, at in zip(one.ring, features[one.image], strict=True)}, 0.5)  # fmt: skip
    (tmp_path / "cameras.txt").write_text(calib.convert(CAMERA, "colmap").text)
    for name in ("points3D", "images", "rigs", "frames"):
        (tmp_path / f"{name}.txt").write_text("")
    (camera,) = pycolmap.Reconstruction(str(tmp_path)).cameras.values()
    ray = np.column_stack([camera.cam_from_img(features[SEEN[0].image]), np.ones(len(SEEN[0].ring))])
    np.testing.assert_allclose(ray / np.linalg.norm(ray, axis=1)[:, None], CAMERA.rays(SEEN[0].center_px), atol=1e-6)
    blocks = [block.splitlines() for block in files["matches.txt"].strip().split("\n\n")]
    assert len(blocks) == len(SEEN) * (len(SEEN) - 1) // 2
    for head, *lines in blocks:
        one, other = (FOUND[name] for name in head.split())
        pairs = np.array([line.split() for line in lines], dtype=int)
        assert np.array_equal(one.ring[pairs[:, 0]], other.ring[pairs[:, 1]])
        assert len(pairs) == len(np.intersect1d(one.ring, other.ring))


@pytest.mark.parametrize(
    ("to", "image", "said"),
    [("odm", "a b.jpg", "with a space"), ("colmap", "a b.jpg", "with a space"), ("realitycapture", "a,b.jpg", "comma"),
     ("metashape", "view_0001.jpg", "labelled 'view_0001'"), ("colmap", "a/../../b.jpg", "outside the folder"),
     ("colmap", "/b.jpg", "outside the folder")],
)  # fmt: skip
def test_a_name_that_a_format_cannot_hold_is_refused(to: str, image: str, said: str) -> None:
    """One line with the name and what to do; the others take it."""
    odd = (replace(SEEN[0], image=image), *SEEN[1:])
    with pytest.raises(InputError, match=f"{said}.*rename"):
        calib.markers(BOARD, odd, to)
    others = [name for name in MARKER_FORMATS if name != to and not (name in ("odm", "colmap") and " " in image)]
    assert all(calib.markers(BOARD, odd, name).texts for name in others)


def test_a_run_folder_stands_for_its_detections(tmp_path: Path) -> None:
    """The folder and the file in it give the same; of a folder without one, a line says so."""
    write_detections(tmp_path / "detections.csv", SEEN, BOARD)
    found, other = (calib.markers(BOARD, given, "odm") for given in (tmp_path, tmp_path / "detections.csv"))
    assert found.texts == other.texts
    assert found.places == sum(len(one.ring) for one in SEEN)
    (tmp_path / "none").mkdir()
    with pytest.raises(InputError, match=r"detections\.csv: cannot be read: No such file"):
        calib.markers(BOARD, tmp_path / "none", "odm")


def test_photos_without_the_target_are_no_photos() -> None:
    """They are not in the files; if there are no others, the answer is negative."""
    none = SEEN[0].keep(slice(0))
    assert calib.markers(BOARD, [none, *SEEN[1:]], "odm").photos == len(SEEN) - 1
    assert calib.markers(BOARD, [none], "odm").is_negative
