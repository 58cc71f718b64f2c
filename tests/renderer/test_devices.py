"""Fields compute on one device: nothing is made on another one by accident.

There may be no second device to try, so the sources are read: torch makes tensors on the CPU
wherever it is not told otherwise.
"""

from __future__ import annotations

import ast
from pathlib import Path

import numpy as np
import pytest
import torch

from renderer.devices import best_device, on_device, on_host
from tests.renderer.field.performer import TINY, pose, sequence, view

FILES = sorted([*Path("renderer/field").glob("*.py"), *Path("renderer/fused").glob("*.py")])
MAKERS = {
    "arange",
    "empty",
    "eye",
    "from_numpy",
    "full",
    "linspace",
    "ones",
    "rand",
    "randint",
    "randn",
    "randperm",
    "scalar_tensor",
    "tensor",
    "zeros",
}
BUILDERS = {"__init__", "for_shape", "around", "_resampled"}
"""Functions that build a network or what it starts from: on the CPU, then `.to(device)`."""


def _astray(tree: ast.AST) -> list[str]:
    """Tensors made without a device. A generator's numbers are drawn on the CPU, so that one seed
    gives the same ones everywhere, and must then be moved or become Python's."""
    moved = {
        id(node.func.value)
        for node in ast.walk(tree)
        if isinstance(node, ast.Call)
        and isinstance(node.func, ast.Attribute)
        and node.func.attr in ("to", "tolist")
    }
    building = {
        id(inner)
        for node in ast.walk(tree)
        if isinstance(node, ast.FunctionDef) and node.name in BUILDERS
        for inner in ast.walk(node)
    }
    found = []
    for node in ast.walk(tree):
        match node:
            case ast.Call(func=ast.Attribute(value=ast.Name(id="torch"), attr=maker)) if (
                maker in MAKERS and id(node) not in building
            ):
                given = {keyword.arg for keyword in node.keywords}
                if "device" not in given and not ("generator" in given and id(node) in moved):
                    found.append(f"line {node.lineno}: torch.{maker}")
            case _:
                pass
    return found


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_every_tensor_is_made_on_a_device_that_is_named(path):
    assert not _astray(ast.parse(path.read_text()))


@pytest.mark.parametrize(
    ("code", "astray"),
    [
        ("torch.zeros(3)", True),
        ("torch.zeros(3, device=x.device)", False),
        ("torch.rand(3, generator=g)", True),
        ("torch.rand(3, generator=g).to(device)", False),
        ("x.new_zeros(3)", False),
        ("torch.from_numpy(a).to(device)", True),
    ],
)
def test_a_tensor_on_no_named_device_is_found(code, astray):
    assert bool(_astray(ast.parse(code))) is astray


def test_arrays_go_there_and_back():
    values = np.arange(6.0).reshape(2, 3).T  # not contiguous
    there = on_device(values, best_device(), torch.float32)
    assert there.device.type == best_device().type
    assert there.dtype == torch.float32
    assert np.array_equal(on_host(there), values)


def test_a_field_trains_and_draws_on_the_best_device():
    from renderer.field.training.trainer import FieldTrainer

    trainer = FieldTrainer(sequence(), "fast", TINY, 0)
    assert np.isfinite(trainer.step(0.0))
    state = trainer.state()
    trainer.restore(state)
    model = trainer.finish({})
    kinds = {tensor.device.type for tensor in (*model.field.parameters(), *model.field.buffers())}
    assert kinds == {best_device().type}
    assert isinstance(model.render(view(), pose(0.3)), np.ndarray)
