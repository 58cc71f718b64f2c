"""What `make demo` sets up, step by step, in folders that are thrown away."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from benchmarks.reporting.checkout import ROOT

_WARM_UP = "from renderer.scene_renderer import warm_up; warm_up()"
_WARM_UP_FIT = "from capture.fitting.warm_up import warm_up; warm_up()"
_WARM_UP_LIVE = "from services.live.motion.live_motion import warm_up; warm_up()"


def fresh_install(root: Path = ROOT) -> dict[str, Any]:
    """Seconds and megabytes of the packages (torch, whose build differs by machine, left out), of
    the page with what it is built with, and of the compiled kernels: of the last commit."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        checkout, environment, kernels = folder / "checkout", folder / "venv", folder / "kernels"
        _run(["git", "clone", "--quiet", "--depth=1", root.as_uri(), str(checkout)])
        client = checkout / "client"
        return {
            "packages_s": _seconds(lambda: _packages(environment, root / "requirements.lock")),
            "packages_mb": _folder_mb(environment),
            "page_s": _seconds(lambda: _page(client)),
            "page_tools_mb": _folder_mb(client / "node_modules"),
            "page_mb": _folder_mb(client / "dist"),
            "kernels_s": _seconds(lambda: _kernels(root, kernels)),
            "kernels_mb": _folder_mb(kernels),
        }


def _packages(environment: Path, lock: Path) -> None:
    _run([sys.executable, "-m", "venv", str(environment)])
    pip = [str(environment / "bin" / "python"), "-m", "pip", "install", "--quiet"]
    options = ["--disable-pip-version-check", "--no-compile", "--no-deps", "--require-hashes"]
    _run([*pip, *options, "-r", str(lock)])


def _page(client: Path) -> None:
    _run(["npm", "ci", "--no-audit", "--no-fund", "--loglevel=error"], cwd=client)
    _run(["npm", "run", "build", "--silent"], cwd=client)


def _kernels(root: Path, cache: Path) -> None:
    def compiled(code: str) -> None:
        _run([sys.executable, "-c", code], cwd=root, NUMBA_CACHE_DIR=str(cache))

    with ThreadPoolExecutor() as pool:
        list(pool.map(compiled, (_WARM_UP, _WARM_UP_FIT, _WARM_UP_LIVE)))


def _run(command: list[str], cwd: Path | None = None, **environment: str) -> None:
    subprocess.run(
        command, check=True, stdout=subprocess.DEVNULL, cwd=cwd, env={**os.environ, **environment}
    )


def _seconds(work: Callable[[], None]) -> float:
    began = time.perf_counter()
    work()
    return round(time.perf_counter() - began, 1)


def _folder_mb(folder: Path) -> float:
    files = (one for one in folder.rglob("*") if one.is_file() and not one.is_symlink())
    return round(sum(one.stat().st_size for one in files) / 1e6, 1)
