"""What `import calib` offers: every name is there, loaded when it is used, and says how it is called."""

import ast
import inspect
import pickle
import re
from collections.abc import Callable
from pathlib import Path

import pytest

import calib
import designer
from designer.spec.kind import KINDS, kind_named
from designer.spec.options import options_of
from tests.support.programs import modules_loaded_by

ROOT = Path(__file__).parents[2]
PUBLIC = [(package, name) for package in (calib, designer) for name in getattr(package, "__all__", ())]
EXAMPLE = re.compile(r": (`[^`]+`(, )?)+\.?$")


@pytest.mark.parametrize(("package", "name"), PUBLIC, ids=[f"{p.__name__}.{name}" for p, name in PUBLIC])
def test_each_public_name_opens_with_what_a_caller_types(package: object, name: str) -> None:
    """A public name loads, and its docstring's first line ends with an example that is Python."""
    found = getattr(package, name)
    line = (inspect.getdoc(found) or "").splitlines()[0]
    assert EXAMPLE.search(line), line
    for code in re.findall("`([^`]+)`", line):
        ast.parse(code if not code.startswith("except") else f"try: pass\n{code}")


@pytest.mark.parametrize("kind", KINDS)
def test_each_kind_of_target_is_a_function_with_help(kind: str) -> None:
    """Its name is the kind's, and its docstring tells all options of the command."""
    function = getattr(designer, kind)
    told = inspect.getdoc(function) or ""
    assert function.__name__ == kind
    assert told.startswith(f"Design {kind_named(kind).title}: `designer.{kind}(")
    assert all(f"    {name}: " in told for name in options_of(kind_named(kind).asked))


REFUSED = (
    (calib.budget, ("pair.rig.json",), {"seen_by": 9}),
    (calib.budget, ("pair.rig.json",), {"length_mm": -1.0}),
    (calib.budget, ("pair.rig.json",), {"noise_px": -1.0}),
    (calib.render, ("board.target.json",), {"views": 0}),
    (calib.render, ("board.target.json",), {"aside_rad": 9.0}),
    (calib.tolerance, ("board.target.json",), {"distance_mm": -1.0, "errors": "fdm-board"}),
    (calib.plan, ("board.target.json",), {"within_px": 0.0, "camera": "camera.json"}),
    (calib.evaluate, ("solved",), {"held_out": 99}),
    (calib.turntable, ("board.target.json", "photos"), {"step_deg": 0.0}),
    (calib.bootstrap, ("detections.csv", "board.target.json"), {"samples": 0}),
    (calib.measure, ("board.target.json",), {"rings": "square"}),
    (designer.ico, (), {"edge": "0mm"}),
    (designer.load, ("3d-board",), {"pitch": "0mm"}),
)


@pytest.mark.parametrize(("function", "values", "options"), REFUSED)
def test_python_is_told_of_its_own_names(
    function: Callable[..., object], values: tuple[str, ...], options: dict[str, object], scene: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    """What a function refuses it names as it was given, and not as on a command line, which has `--seen-by`."""
    monkeypatch.chdir(scene)
    with pytest.raises(designer.InputError) as error:
        function(*values, **options)
    assert next(iter(options)).removesuffix("_deg") in str(error.value)
    assert "--" not in str(error.value)


def test_another_process_finds_the_functions() -> None:
    """By the package's name, whichever module they come from."""
    for package, name in PUBLIC:
        assert pickle.loads(pickle.dumps(getattr(package, name))) is getattr(package, name)  # noqa: S301


def test_type_checkers_see_what_is_loaded_when_used() -> None:
    """The imports for type checkers, the public names and the places they are loaded from are the same."""
    tree = ast.parse((ROOT / "calib/__init__.py").read_text())
    block = next(node for node in tree.body if isinstance(node, ast.If))
    typed = {
        node.module: tuple(alias.name for alias in node.names)
        for node in block.body
        if isinstance(node, ast.ImportFrom)
    }
    assert typed == calib._HOMES
    assert sorted(name for names in typed.values() for name in names) == sorted(calib.__all__)
    assert set(calib.__all__) <= set(dir(calib))


def test_no_module_has_the_name_of_a_public_function() -> None:
    """Importing a module of a package puts it under its name there, where the function is expected."""
    for package in (calib, designer):
        inside = {path.stem for path in (ROOT / package.__name__).iterdir()}
        assert not inside & set(getattr(package, "__all__", ()))


def test_import_loads_nothing() -> None:
    """`import calib, designer` loads none of the libraries that take time; an unknown name is an AttributeError."""
    heavy = {"numpy", "cv2", "scipy", "numba", "pydantic", "typer", "rich", "matplotlib", "build123d"}
    assert not heavy & modules_loaded_by("import calib, designer")
    with pytest.raises(AttributeError, match="no attribute 'detekt'"):
        calib.detekt  # noqa: B018  # the access itself is what is tried


def test_the_docs_name_every_public_function() -> None:
    """A capability that nobody reads of is not there: `docs/python.md` names each function and class that is called."""
    said = (ROOT / "docs/python.md").read_text()
    offered = [name for name in calib.__all__ if not name[0].isupper()]
    assert [name for name in offered if f"calib.{name}(" not in said] == []
