"""The built wheel, installed alone."""

import sys
import zipfile
from pathlib import Path

import pytest

from tests.support.programs import PYTHON, ROOT, run


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The project's wheel, built from this checkout."""
    folder = tmp_path_factory.mktemp("wheel")
    run(PYTHON, "-m", "pip", "wheel", "-q", "--no-deps", "-w", folder, ROOT)
    (path,) = folder.glob("ringsolid-*.whl")
    return path


def test_wheel_carries_the_data(wheel: Path) -> None:
    """The wheel holds the templates, the schema and both packages, and nothing of the tests."""
    names = set(zipfile.ZipFile(wheel).namelist())
    for name in ("designer/_templates/targets/matt-ico.toml", "designer/_templates/printers/prusa-xl.toml",
                 "designer/_templates/criteria/standard.toml", "designer/target.schema.json", "designer/cli.py",
                 "designer/page/parts/page.css", "designer/page/parts/page.html.j2",
                 "designer/page/parts/blocks.html.j2", "designer/page/parts/three.min.js", "calib/cli.py",
                 "calib/capture/parts/live.html", "calib/cameras/formats/readers/ringsolid_lut.h",
                 "designer/py.typed", "calib/py.typed"):  # fmt: skip
        assert name in names
    assert not [name for name in names if name.startswith("tests")]


def test_wheel_alone_makes_a_template_from_any_folder(wheel: Path, tmp_path: Path) -> None:
    """Installed alone in a fresh environment, `design make matt-ico` works from any folder.

    The environment sees the libraries of this one through a path file, but not this project.
    """
    environment = tmp_path / "environment"
    run(PYTHON, "-m", "venv", "--without-pip", environment)
    pip = (PYTHON, "-m", "pip", "--python", environment / "bin" / "python", "install", "-q", "--no-deps")
    run(*pip, "--no-index", "--no-compile", wheel)
    libraries = [path for path in sys.path if path.endswith("site-packages")]
    (site,) = (environment / "lib").glob("python*/site-packages")
    # Libraries are added as plain folders at the end: an editable install of this project there is not followed.
    (site / "libraries.pth").write_text("\n".join(libraries) + "\n")
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    run(environment / "bin" / "design", "make", "matt-ico", cwd=elsewhere, PYTHONPATH="")
    assert (elsewhere / "exports" / "matt-ico" / "matt-ico.prusa.3mf").stat().st_size > 1_000_000
