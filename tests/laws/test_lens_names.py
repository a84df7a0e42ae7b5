"""A key that names a lens is obeyed, or the file is refused: all readers, all keys, all names."""

import json
from pathlib import Path

import numpy as np
import pytest

from calib.cameras import ABILITIES
from calib.cameras.formats import FORMATS, RIG_FORMATS
from calib.cameras.formats.lens_names import model_named, names_lens
from calib.cameras.formats.reading import open_camera
from calib.cameras.formats.rig_format import RigFiles
from designer.base.errors import InputError
from tests.support.foreign_cameras import lens_camera, text_of

LENS = [0.1, -0.02, 0.001, 0.0002]
PLAIN = {
    "image_width": 640,
    "image_height": 480,
    "camera_matrix": [[600.0, 0, 320.5], [0, 601, 241.5], [0, 0, 1]],
    "distortion_coefficients": LENS,
}
KEYS = (
    *(
        "camera_model",
        "distortion_model",
        "distortion_type",
        "model_type",
        "lens_model",
        "lens_type",
        "projection_type",
    ),
    *("cameraModel", "DistortionModel", "camera model", "model", "type", "distortion", "lens", "projection_model"),
)
FLAGS = ("fisheye", "is_fisheye", "isFisheye", "use_fisheye", "fisheye_model", "use_opencv_fisheye")
NAMES = {
    "fisheye": (
        *("fisheye", "Fisheye", "FISHEYE", "fish-eye", "equidistant", "equi", "KANNALA_BRANDT", "KANNALA_BRANDT4"),
        *(
            "kannala-brandt",
            "Kannala Brandt",
            "OPENCV_FISHEYE",
            "opencv_fisheye",
            "kb4",
            "pinhole-equi",
            "pinhole equi",
        ),
        *("KannalaBrandt", "cv2.fisheye", "fisheye (KB4)", "OpenCVFisheye", "kb", "KB8", "fisheye lens"),
    ),
    "opencv": (
        "plumb_bob",
        "radtan",
        "radial-tangential",
        "Brown-Conrady",
        "brown",
        "OPENCV",
        "pinhole-radtan",
        "PLUMB_BOB",
    ),
}
OTHERS = ("ds", "double-sphere", "eucm", "omni", "mei", "division", "thin_prism_fisheye")
UNKNOWN = ("fov", "ftheta", "scaramuzza", "fisheye_equisolid", "fisheye624", "inverse_brown_conrady", "mystery")


def read(tree: object, folder: Path) -> tuple[str, tuple[str, ...]]:
    """Model and remarks of a file, found out by its content, as JSON and as YAML."""
    answers = set()
    for text in (json.dumps(tree), "".join(f"{key}: {json.dumps(value)}\n" for key, value in dict(tree).items())):  # type: ignore[call-overload]
        (folder / "c").write_text(text)
        found = open_camera(str(folder / "c")).read
        answers.add((found.camera.model, found.remarks))
        if found.camera.model == "fisheye":
            assert found.camera.params[4:].tolist() == LENS
    (answer,) = answers
    return answer


@pytest.mark.parametrize("key", KEYS)
def test_a_name_under_any_key_is_obeyed_or_refused(key: str, tmp_path: Path) -> None:
    """At the top, or within another mapping; whatever the case, the marks between words, and the tool's own prefix."""
    for model, names in NAMES.items():
        for name in names:
            assert read({**PLAIN, key: name}, tmp_path) == (model, ()), name
        assert read({**PLAIN, "camera": {"settings": {key: names[0]}}}, tmp_path) == (model, ())
    for name in OTHERS:
        with pytest.raises(InputError, match="not supported"):
            read({**PLAIN, key: name}, tmp_path)


@pytest.mark.parametrize("key", KEYS)
@pytest.mark.parametrize("name", UNKNOWN)
def test_a_name_that_is_not_known_is_refused_or_said(key: str, name: str, tmp_path: Path) -> None:
    """Never taken for another: refused by name of the key, or, where it may be a product's name, said to be no lens."""
    if key in ("model", "type", "distortion", "lens") and "fish" not in name:
        model, remarks = read({**PLAIN, key: name}, tmp_path)
        assert model == "opencv"
        assert f"{key} is '{name}', which names no lens that is known" in remarks[0]
        assert "no lens is named: taken as k1 k2 p1 p2" in remarks[1]
    else:
        with pytest.raises(InputError, match=f"{key} '{name}': not supported"):
            read({**PLAIN, key: name}, tmp_path)


@pytest.mark.parametrize("key", FLAGS)
def test_a_flag_is_obeyed(key: str, tmp_path: Path) -> None:
    """`fisheye: true`, as a boolean, a number or a word; false means Brown's, and settles it; else it is refused."""
    for yes in (True, 1, "true", "yes", "1", 1.0, "equidistant"):
        assert read({**PLAIN, key: yes}, tmp_path) == ("fisheye", ())
    for no in (False, 0, "false", "no", 0.0):
        assert read({**PLAIN, key: no}, tmp_path) == ("opencv", ())
    with pytest.raises(InputError, match=f"{key} 'perhaps': not supported"):
        read({**PLAIN, key: "perhaps"}, tmp_path)


def test_nothing_named_is_said(tmp_path: Path) -> None:
    """Four numbers may be those of either lens: how they are taken, and how to name the other. Not so five, or none."""
    for nothing in ({}, {"camera_model": "pinhole"}, {"distortion_model": ""}, {"lens_model": None}):
        model, remarks = read({**PLAIN, **nothing}, tmp_path)
        assert model == "opencv"
        assert "if they are k1 k2 k3 k4 of a fisheye, add distortion_model: equidistant" in remarks[0]
    assert read({**PLAIN, "distortion_model": "equidistant"}, tmp_path) == ("fisheye", ())
    assert read({**PLAIN, "distortion_coefficients": [*LENS, 0.01]}, tmp_path) == ("opencv", ())
    assert read({**PLAIN, "distortion_coefficients": [0.0] * 4}, tmp_path) == ("opencv", ())


@pytest.mark.parametrize(
    "both",
    [
        {"camera_model": "fisheye", "distortion_model": "plumb_bob"},
        {"distortion_type": "radtan", "fisheye": True},
        {"model_type": "equidistant", "fisheye_model": 0},
        {"lens_model": "none"},
    ],
)
def test_two_names_that_contradict_each_other_are_refused(both: dict[str, object], tmp_path: Path) -> None:
    """And no lens, where there are numbers of one; but a pinhole may have any distortion."""
    with pytest.raises(InputError, match="leave the one that is right"):
        read({**PLAIN, **both}, tmp_path)
    assert read({**PLAIN, "camera_model": "pinhole", "distortion_model": "equidistant"}, tmp_path)[0] == "fisheye"


PLACES = {"kalibr": "  resolution:", "ros": "image_width:", "opencv": "image_width:", "mrcal": "    'lensmodel':"}


@pytest.mark.parametrize("name", [*PLACES, "basalt"])
def test_another_name_beside_a_formats_own_is_refused(name: str) -> None:
    """Every reader looks for other keys than its own: a file that says two lenses is nobody's."""
    text = text_of(
        name,
        lens_camera(
            name,
            "LENSMODEL_OPENCV5"
            if name == "mrcal"
            else {"kalibr": "pinhole-radtan", "ros": "plumb_bob", "opencv": "standard", "basalt": "pinhole-radtan8"}[
                name
            ],
        ),
    )
    for key, value in (("fisheye", "1"), ("lens_type", "equidistant")):
        if name == "basalt":
            changed = text.replace('"camera_type"', f'"{key}": "{value}", "camera_type"', 1)
        elif name == "mrcal":
            changed = text.replace(PLACES[name], f"    '{key}': '{value}',\n{PLACES[name]}", 1)
        else:
            indent = "  " if name == "kalibr" else ""
            changed = text.replace(PLACES[name], f"{indent}{key}: {value}\n{PLACES[name]}", 1)
        assert changed != text
        with pytest.raises(InputError, match="leave the one that is right"):
            FORMATS[name].read(changed, "c", None)


@pytest.mark.parametrize("name", ["anipose", "caliscope", "opencv"])
def test_rigs_obey_likewise(name: str) -> None:
    """Of one camera, or of all of them."""
    table = (
        "size = [640, 480]\nmatrix = [[600.0, 0.0, 320.5], [0.0, 601.0, 241.5], [0.0, 0.0, 1.0]]\n"
        f"distortions = {LENS}\nrotation = [0.0, 0.1, 0.0]\ntranslation = [LAST, 0.0, 0.0]\n"
    )
    head = {"anipose": "[cam_{}]\n", "caliscope": "[cameras.{}]\n"}.get(name, "")
    if name == "opencv":
        matrices = "".join(f"K{row}: {PLAIN['camera_matrix']}\nD{row}: {LENS}\n" for row in "12")
        text = f"image_width: 640\nimage_height: 480\n{matrices}R: {np.eye(3).tolist()}\nT: [100, 0, 0]\n"
        of_second, of_all = f"{text}distortion_model_2: KANNALA_BRANDT\n", f"{text}distortion_model: equidistant\n"
    else:
        first, second = head.format(1) + table.replace("LAST", "0.0"), head.format(2) + table.replace("LAST", "9.0")
        text = first + second
        of_second, of_all = f'{text}camera_model = "KANNALA_BRANDT"\n', f"[metadata]\nfisheye = 1\n{text}"

    def models(text: str) -> list[str]:
        found = RIG_FORMATS[name].read(RigFiles({"f": text}, "f", "mm"))
        assert any("no lens is named" in one for one in found.remarks) == (
            "opencv" in {camera.model for camera in found.rig.cameras}
        )
        return [camera.model for camera in found.rig.cameras]

    assert models(text) == ["opencv", "opencv"]
    assert models(of_second) == ["opencv", "fisheye"]
    assert models(of_all) == ["fisheye", "fisheye"]


def test_names_are_of_one_model_each() -> None:
    """No name stands for two models, and each model's own names it."""
    words = [word for model in ABILITIES.values() for word in model.also_called.split()]
    assert len(words) == len(set(words))
    for name, model in ABILITIES.items():
        assert {model_named(word) for word in (name, *model.also_called.split())} == {name}
    assert not any(
        map(names_lens, ("camera_matrix", "camera_name", "name", "image_width", "distortion_coefficients", "K"))
    )
