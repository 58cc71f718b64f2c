"""Tests use what the packages offer: no private name of a module or of an object."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
_TUPLES_OWN = {"_replace", "_asdict", "_fields"}
"""Public in spite of their names (collections.namedtuple)."""


def private(name: str) -> bool:
    return name.startswith("_") and not name.endswith("__") and name not in _TUPLES_OWN


def private_names(tree: ast.Module) -> Iterator[tuple[int, str]]:
    """Lines and names: imported, read of anything but `self`, or named to (set|get|del)attr."""
    for node in ast.walk(tree):
        match node:
            case ast.ImportFrom(module=module, names=names):
                words = [*(module or "").split("."), *(one.name for one in names)]
                yield from ((node.lineno, word) for word in words if private(word))
            case ast.Attribute(value=ast.Name(id="self" | "cls")):
                pass
            case ast.Attribute(attr=name) if private(name):
                yield node.lineno, name
            case ast.Call(func=ast.Name(id=called) | ast.Attribute(attr=called), args=[*given]) if (
                called in ("setattr", "getattr", "delattr", "hasattr")
            ):
                told = [one.value for one in given if isinstance(one, ast.Constant)]
                words = [word for one in told if isinstance(one, str) for word in one.split(".")]
                yield from ((node.lineno, word) for word in words if private(word))


def test_no_test_looks_behind_what_is_public():
    found = []
    for path in sorted((ROOT / "tests").rglob("*.py")):
        name = str(path.relative_to(ROOT))
        for line, word in private_names(ast.parse(path.read_text("utf-8"))):
            found.append(f"{name}:{line}: {word}")
    assert found == []
