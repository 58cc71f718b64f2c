"""What packages weigh on disk, each direct dependency with what only it pulls in."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable
from dataclasses import dataclass
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path
from typing import Any

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from benchmarks.reporting.checkout import ROOT


@dataclass(frozen=True)
class Dependency:
    """A direct dependency, and why it is one."""

    requirement: Requirement
    module: str
    """By which it is imported; empty: it is not."""
    use: str
    instead: str

    @property
    def name(self) -> str:
        """As PyPI compares names."""
        return canonicalize_name(self.requirement.name)


def dependencies(root: Path = ROOT) -> list[Dependency]:
    """The direct dependencies of the product. Raises KeyError for one that nothing is told of."""
    read = tomllib.loads((root / "pyproject.toml").read_text())
    told = read["tool"]["metanerf"]["dependencies"]
    wanted = map(Requirement, read["project"]["dependencies"])
    return [Dependency(one, **told[one.name]) for one in wanted]


def pulled_in(roots: Iterable[Requirement]) -> set[str]:
    """Names of the packages that are installed for `roots`, these among them."""
    found: set[tuple[str, frozenset[str]]] = set()
    left = list(roots)
    while left:
        wanted = left.pop()
        key = (canonicalize_name(wanted.name), frozenset(wanted.extras))
        if key in found or (package := _installed(key[0])) is None:
            continue
        found.add(key)
        for line in package.requires or ():
            needed = Requirement(line)
            if needed.marker is None or any(
                needed.marker.evaluate({"extra": extra}) for extra in ("", *wanted.extras)
            ):
                left.append(needed)
    return {name for name, _ in found}


def files_of(names: Iterable[str]) -> dict[Path, int]:
    """Bytes of each file of installed packages, once where several hold the same; compiled modules
    are not counted."""
    found = {}
    for package in filter(None, map(_installed, names)):
        for file in package.files or ():
            path = Path(str(package.locate_file(file))).resolve()
            if path.suffix != ".pyc" and path.is_file():
                found[path] = path.stat().st_size
    return found


def megabytes(files: dict[Path, int]) -> float:
    """Of all of them."""
    return round(sum(files.values()) / 1e6, 1)


def weights(direct: list[Dependency]) -> list[dict[str, Any]]:
    """Of each: its own megabytes, and what would go with it."""
    everything = pulled_in(one.requirement for one in direct)
    all_files = files_of(everything)
    rows = []
    for one in direct:
        others = pulled_in(other.requirement for other in direct if other is not one)
        kept = files_of(others)
        rows.append(
            {
                "name": one.name,
                "version": distribution(one.name).version,
                "module": one.module,
                "use": one.use,
                "instead": one.instead,
                "own_mb": megabytes(files_of([one.name])),
                "goes_with_it_mb": megabytes({k: v for k, v in all_files.items() if k not in kept}),
                "goes_with_it": sorted(everything - others - {one.name}),
            }
        )
    return rows


def _installed(name: str) -> Distribution | None:
    try:
        return distribution(name)
    except PackageNotFoundError:  # of another system, or an extra that nobody asked for
        return None
