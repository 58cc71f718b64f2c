"""What only some models can do is asked of the model (`PerformerModel`), never of its class."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
CLASSES = {"SplatModel", "FieldModel", "PerformerModel", "SplatSettings", "FieldSettings"}


def switches(path: Path) -> list[int]:
    """Lines of `path` that ask of which class a model or its settings are."""
    lines = []
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.MatchClass):
            names = ast.walk(node.cls)
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            names = (name for part in node.args[1:] for name in ast.walk(part))
            names = names if node.func.id in ("isinstance", "issubclass") else ()
        else:
            continue
        if any(isinstance(name, ast.Name) and name.id in CLASSES for name in names):
            lines.append(node.lineno)
    return lines


@pytest.mark.parametrize("package", ["scene", "db", "capture", "services", "benchmarks", "tools"])
def test_nobody_outside_the_renderer_asks_for_the_class_of_a_model(package):
    files = sorted((ROOT / package).rglob("*.py"))
    assert files
    assert {str(path): lines for path in files if (lines := switches(path))} == {}


def test_a_switch_is_found(tmp_path):
    path = tmp_path / "module.py"
    path.write_text("if isinstance(model, (int, SplatModel)):\n    pass\n", "utf-8")
    assert switches(path) == [1]
