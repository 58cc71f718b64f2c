"""How much code there is, and how much of it can be set, called and typed."""

from __future__ import annotations

import tempfile
from pathlib import Path

from benchmarks.reporting.checkout import ROOT

PACKAGES = ("scene", "db", "capture", "renderer", "services", "client/src", "benchmarks", "tools")
TESTS = ("tests", "client/tests")
_SUFFIXES = {".py", ".ts"}


def lines(folder: Path) -> int:
    """Lines of Python and TypeScript under a folder that are not blank."""
    files = (one for one in folder.rglob("*") if one.suffix in _SUFFIXES and one.is_file())
    return sum(sum(bool(line.strip()) for line in file.read_text().splitlines()) for file in files)


def lines_by_package(root: Path = ROOT) -> dict[str, int]:
    """Of everything that is kept in the repository, tests too."""
    return {name: lines(root / name) for name in (*PACKAGES, *TESTS)}


def settings_count() -> int:
    """Variables METANERF_* that a process reads."""
    from services.settings import load_settings

    return len(load_settings().by_variable())


def operations_count() -> int:
    """Methods of paths that the description of the API names."""
    from services.app import create_app
    from services.composition import build_services
    from services.settings import load_settings

    with tempfile.TemporaryDirectory() as folder:
        services = build_services(load_settings(data_dir=Path(folder)))
        described = create_app(services).openapi()
        services.close()
    return sum(len(methods) for methods in described["paths"].values())


def commands() -> dict[str, int]:
    """Commands of `metanerf` that serve people, and their options; benchmarks are not counted."""
    from typer.core import TyperGroup
    from typer.main import get_command

    from services.cli.app import app

    tree = get_command(app)
    assert isinstance(tree, TyperGroup)
    leaves = tree.commands.values()
    options = (one for leaf in leaves for one in leaf.params if one.param_type_name == "option")
    return {"commands": len(leaves), "options": sum(1 for _ in options)}
