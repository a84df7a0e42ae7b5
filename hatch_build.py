"""The wheel for Linux x86-64 carries the kernels compiled ahead: `python -m build`.

They are compiled for processors of the level `calib.core.kernel_cache.BASELINE` from the list `calib/core/kernels.txt`,
in the environment that the wheel is built in, and serve the same versions of Python, Numba and NumPy. Elsewhere, and
where pip installs from the sources, who would wait for it, the wheel is pure and kernels are compiled when first used.
`RINGSOLID_KERNELS=carried` or `none` decides otherwise.
"""

import os
import platform
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

PLATFORM = "manylinux_2_28_x86_64"
COMPILE = """
from calib.core.compile_ahead import Teller, warm_up
from calib.core.compile_ahead import kernel_list, missing
warm_up(None, Teller())
left = missing(line for lines in kernel_list().values() for line in lines)
raise SystemExit("".join(f"{line.line} could not be compiled\\n" for line in left) or 0)
"""


class CarriedKernels(BuildHookInterface):
    """Compiles the kernels and puts them into the wheel."""

    PLUGIN_NAME = "custom"

    def dependencies(self) -> list[str]:
        """What compiling takes: what the package itself needs."""
        if not _is_wanted():
            return []
        project = tomllib.loads(Path(self.root, "pyproject.toml").read_text(encoding="utf-8"))["project"]
        return list(project["dependencies"])

    def initialize(self, version: str, build_data: dict[str, object]) -> None:
        """Compile before the wheel is put together; `version` is standard or editable."""
        if version == "editable" or not _is_wanted():
            return
        cache = Path(self.root, "build", "kernels")
        shutil.rmtree(cache, ignore_errors=True)
        from_sources = {"PYTHONPATH": self.root, "RINGSOLID_CACHE": str(cache)}
        told = "from calib.core.kernel_cache import BASELINE, baseline_features; print(BASELINE, baseline_features())"
        baseline, features = self._python(told, from_sources).split()
        processor = {"NUMBA_CPU_NAME": baseline, "NUMBA_CPU_FEATURES": features}
        self._python(COMPILE, {**from_sources, **processor})
        entries = sorted(cache.rglob("*.kernel"))
        self.app.display_info(f"{len(entries)} kernels for {baseline}")
        build_data["force_include"] = {str(path): f"calib/_kernels/{path.name}" for path in entries}
        build_data["pure_python"] = False
        python = f"cp{sys.version_info[0]}{sys.version_info[1]}"
        build_data["tag"] = f"{python}-{python}-{PLATFORM}"

    def _python(self, code: str, environment: dict[str, str]) -> str:
        """What a few lines print; what they say on standard error is seen."""
        command = [sys.executable, "-c", code]
        environment = {**os.environ, **environment}
        return subprocess.run(command, env=environment, check=True, stdout=subprocess.PIPE, text=True).stdout  # noqa: S603


def _is_wanted() -> bool:
    """Whether the wheel that is built carries kernels."""
    asked = os.environ.get("RINGSOLID_KERNELS", "")
    if asked not in {"", "carried", "none"}:
        raise SystemExit(f"RINGSOLID_KERNELS={asked}: it is carried or none")
    if asked:
        return asked == "carried"
    is_here = sys.platform == "linux" and platform.machine() == "x86_64" and sys.implementation.name == "cpython"
    return is_here and "PIP_BUILD_TRACKER" not in os.environ  # set while pip builds what it installs
