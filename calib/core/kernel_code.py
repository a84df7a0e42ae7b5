"""What a kernel's machine code depends on, as text: its own code and options, kernels it calls, constants, types."""

import ast
import hashlib
import importlib
import re
from collections.abc import Iterator
from functools import lru_cache
from types import CodeType, FunctionType, ModuleType
from typing import Protocol, cast

import numpy as np
from numba.core import types


class Kernel(Protocol):
    """A compiled function, as `numba.njit` makes it."""

    py_func: FunctionType
    targetoptions: dict[str, object]
    _cache: object

    def __hash__(self) -> int:
        """By identity."""

    def compile(self, sig: tuple[types.Type, ...]) -> object:
        """Compile it for arguments of such types, or take the code that is kept."""


def label(function: FunctionType) -> str:
    """`module:name` of a kernel."""
    return f"{function.__module__}:{function.__qualname__}"


def labelled(name: str) -> object:
    """What a label names: a kernel, or the class of a named tuple."""
    module, _, attribute = name.partition(":")
    return getattr(importlib.import_module(module), attribute)


def code_digest(kernel: Kernel) -> str:
    """A digest of a kernel's code and options, and of all kernels and constants that it takes from elsewhere."""
    reached = {label(kernel.py_func): kernel}
    parts: set[str] = set()
    for taken in (waiting := [kernel]):  # which grows by the kernels that are called
        own, called = _own_parts(taken)
        parts.update(own)
        new = [other for other in called if label(other.py_func) not in reached]
        reached.update((label(other.py_func), other) for other in new)
        waiting.extend(new)
    return hashlib.sha256("\n".join(sorted(parts)).encode()).hexdigest()


def called_kernels(kernel: Kernel) -> tuple[Kernel, ...]:
    """The kernels that a kernel names."""
    return _own_parts(kernel)[1]


@lru_cache(maxsize=4096)
def _own_parts(kernel: Kernel) -> tuple[tuple[str, ...], tuple[Kernel, ...]]:
    """What a kernel's own lines and options say, constants included, and the kernels that it names."""
    function, options = kernel.py_func, kernel.targetoptions
    told = sorted((key, sorted(value) if isinstance(value, set) else value) for key, value in options.items())
    parts = [f"{label(function)} {told} {function.__defaults__!r}", *_code_text(function.__code__, function.__doc__)]
    called = []
    for name, value in _taken(function):
        if hasattr(value, "py_func"):
            called.append(cast("Kernel", value))
            parts.append(f"{name} is {label(called[-1].py_func)}")
        elif (text := _constant_text(value)) is not None:
            parts.append(f"{name} {text}")
    return tuple(parts), tuple(called)


def _code_text(code: CodeType, doc: str | None) -> Iterator[str]:
    """What a function does, without its file, its lines' numbers and its docstring."""
    constants = [one for one in code.co_consts if not isinstance(one, CodeType) and (doc is None or one != doc)]
    names = (code.co_names, code.co_varnames, code.co_freevars, code.co_cellvars)
    counts = (code.co_argcount, code.co_kwonlyargcount, code.co_posonlyargcount, code.co_flags)
    yield f"{code.co_code.hex()} {code.co_exceptiontable.hex()} {constants!r} {names} {counts}"
    for part in code.co_consts:
        if isinstance(part, CodeType):
            yield from _code_text(part, None)


def _constant_text(value: object) -> str | None:
    """What a constant holds; None for what is no constant."""
    if isinstance(value, np.ndarray):
        return f"{value.dtype} {value.shape} {value.flags.writeable} {value.tobytes().hex()}"
    if isinstance(value, tuple):
        return f"({', '.join(str(_constant_text(one)) for one in value)})"
    if isinstance(value, int | float | complex | str | bytes | np.generic):
        return f"{type(value).__name__} {value!r}"
    return f"{_class_label(value)} {getattr(value, '_fields', '')}" if isinstance(value, type) else None


def _class_label(kind: type) -> str:
    return f"{kind.__module__}:{kind.__qualname__}"


def _taken(function: FunctionType) -> Iterator[tuple[str, object]]:
    """What the names of a function may stand for: globals, what modules among these have by such a name, and cells."""
    names = sorted(set(_names(function.__code__)))
    spaces = [function.__globals__]
    for space in spaces:  # which grows by the modules that are found
        for name in names:
            if name not in space:
                continue
            value = space[name]
            if not isinstance(value, ModuleType):
                yield f"{space['__name__']}.{name}", value
            elif not any(vars(value) is one for one in spaces):
                spaces.append(vars(value))
    for name, cell in zip(function.__code__.co_freevars, function.__closure__ or (), strict=True):
        yield name, cell.cell_contents


def _names(code: CodeType) -> Iterator[str]:
    """Names that a function looks up, those of its comprehensions, too."""
    yield from code.co_names
    for part in code.co_consts:
        if isinstance(part, CodeType):
            yield from _names(part)


# Types of arguments, as text and back -------------------------------------------------------------


def types_text(arguments: tuple[types.Type, ...]) -> str:
    """Types as text, `array(float64, 2, 'C'), int64`; what `parsed_types` does not read is in angle brackets."""
    return ", ".join(map(_type_text, arguments))


def _type_text(kind: types.Type) -> str:
    if isinstance(kind, types.Array) and kind.aligned:
        return f"array({kind.dtype}, {kind.ndim}, {kind.layout!r}{'' if kind.mutable else ', True'})"
    if isinstance(kind, types.Literal):
        return f"literal({kind.literal_value!r})"
    if isinstance(kind, types.UniTuple) and kind.count > 1:
        return f"repeated({_type_text(kind.dtype)}, {kind.count})"
    if isinstance(kind, types.BaseTuple):
        inner = types_text(tuple(getattr(kind, "types", ())))
        named = getattr(kind, "instance_class", None)
        # The fields are part of it, as a class of the same name may have others.
        return f"({inner},)" if named is None else f"named({_class_label(named)!r}, {named._fields!r}, {inner})"
    return str(kind) if re.fullmatch(r"\w+", str(kind)) else f"<{kind}>"


def parsed_types(text: str) -> tuple[types.Type, ...]:
    """Types from their text.

    Raises:
        ValueError: this is no text of types.
        LookupError: a class, or its fields, are not what they were.
    """
    try:
        tree = ast.parse(f"({text},)" if text else "()", mode="eval").body
    except SyntaxError as error:
        raise ValueError(text) from error
    if not isinstance(tree, ast.Tuple):
        raise ValueError(text)
    return tuple(_parsed(node) for node in tree.elts)


def _parsed(node: ast.expr) -> types.Type:
    if isinstance(node, ast.Name):
        return cast("types.Type", getattr(types, node.id))
    if isinstance(node, ast.Tuple):
        return types.Tuple([_parsed(part) for part in node.elts])
    if not isinstance(node, ast.Call) or not isinstance(node.func, ast.Name):
        raise ValueError(ast.unparse(node))
    first, *others = node.args
    match node.func.id:
        case "array":
            dimensions, layout, *is_read_only = map(ast.literal_eval, others)
            return types.Array(_parsed(first), dimensions, layout, readonly=bool(is_read_only))
        case "literal":
            return cast("types.Type", types.literal(ast.literal_eval(first)))
        case "repeated":
            return types.UniTuple(_parsed(first), ast.literal_eval(others[0]))
        case "named":
            kind = labelled(ast.literal_eval(first))
            if getattr(kind, "_fields", None) != ast.literal_eval(others[0]):
                raise LookupError(ast.unparse(first))
            return cast("types.Type", types.BaseTuple.from_types([_parsed(part) for part in others[1:]], kind))
    raise ValueError(node.func.id)
