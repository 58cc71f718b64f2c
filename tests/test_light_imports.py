"""scene/ and renderer/ import where only numpy and torch are installed (a bare GPU machine), and
what starts often does not wait for heavy packages."""

from __future__ import annotations

import ast
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

from capture.studio import make_sequence

BLOCK_AND_IMPORT = """
import importlib, importlib.abc, pkgutil, sys

BLOCKED = {"numba", "llvmlite", "safetensors", "torchmetrics", "jaxtyping", "beartype", "cv2",
           "scipy", "av", "PIL", "matplotlib", "anny", "mediapipe", "roma", "triton"}

class Blocker(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in BLOCKED:
            raise ImportError(f"{name} is blocked")

sys.meta_path.insert(0, Blocker())
for package in ("scene", "renderer"):
    root = importlib.import_module(package)
    for module in pkgutil.walk_packages(root.__path__, prefix=package + "."):
        if not module.name.endswith("kernels"):
            importlib.import_module(module.name)
            print(module.name)
"""


def test_scene_and_renderer_import_with_numpy_and_torch_alone():
    done = subprocess.run(
        [sys.executable, "-c", BLOCK_AND_IMPORT], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "scene.camera" in done.stdout


# services.otlp, not OpenTelemetry: the Redis client loads its SDK itself where it is installed
_HEAVY = {"torch", "numba", "mediapipe", "scipy", "ray", "services.otlp"}
_NETWORK = {"fastapi", "redis", "aiortc"}


@pytest.mark.parametrize(
    ("module", "more"),
    [
        ("scene", {"numpy"}),
        ("services.cli.app", _NETWORK | {"numpy", "pydantic", "sqlalchemy"}),
        ("services.app", {"redis"}),
        ("services.jobs.child", _NETWORK),
        ("services.jobs.ray_task", _NETWORK),
        ("services.jobs.worker", _NETWORK),
    ],
)
def test_what_starts_often_does_not_wait_for_torch_nor_ray(module: str, more: set[str]):
    slow = f"{_HEAVY | more} & set(sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", f"import sys, {module}; assert not {slow}, {slow}"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr


NUMPY_COMES_LAST = """
import os, sys

class Told:
    def find_spec(self, name, *_):
        if name == "numpy":
            wait = ("OMP_WAIT_POLICY", "OPENBLAS_THREAD_TIMEOUT")
            print({name: os.environ.get(name) for name in wait})

sys.meta_path.insert(0, Told())
import numpy
"""


@pytest.mark.parametrize("package", ["capture", "renderer", "services"])
def test_how_threads_wait_is_said_before_numpy_starts_them(package: str):
    told = NUMPY_COMES_LAST.replace("import numpy", f"import {package}, numpy")
    done = subprocess.run(
        [sys.executable, "-c", told], capture_output=True, text=True, check=True, env={}
    )
    assert done.stdout == "{'OMP_WAIT_POLICY': 'passive', 'OPENBLAS_THREAD_TIMEOUT': '4'}\n"


def test_every_word_of_scene_is_that_of_its_module():
    import scene

    tree = ast.parse(Path(scene.__file__).read_text())
    homes = {
        alias.name: node.module
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("scene.")
        for alias in node.names
    }
    assert sorted(homes) == sorted(scene.__all__)
    for name, module in homes.items():
        assert getattr(scene, name) is getattr(import_module(module), name)
    with pytest.raises(AttributeError, match="no attribute 'Nothing'"):
        _ = scene.Nothing


TRAIN = """
import sys, time
from pathlib import Path
from capture.storage import open_sequence
from renderer.training import train

train(open_sequence(Path(sys.argv[1])), iterations=3, clock=time.perf_counter)
print({"torch", "numba"} & set(sys.modules))
"""


def test_a_training_of_splats_does_without_torch(tmp_path: Path):
    make_sequence(tmp_path / "loose", look="loose", frames=12, size=64, test_cameras=1)
    done = subprocess.run(
        [sys.executable, "-c", TRAIN, str(tmp_path / "loose")],
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout == "{'numba'}\n"
