"""Compiled kernels for a process that may not write where they are kept.

numba reads a cache only where it may write, and what is in one is run unseen: a process that reads
a stranger's file must not write into ours. So it is given a folder of its own full of links.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

_PACKAGES = ("scene", "capture")
"""Whose kernels a capture runs."""
_ROOT = Path(__file__).parents[2]


@dataclass(frozen=True)
class Kernels:
    """A cache to write to, and what it links to."""

    folder: Path
    """For NUMBA_CACHE_DIR."""
    behind: tuple[Path, ...]
    """To be readable."""


def linked_kernels(folder: Path) -> Kernels:
    """A cache in the new folder `folder` of all kernels that were compiled before."""
    folder.mkdir()
    ours = os.environ.get("NUMBA_CACHE_DIR")
    behind = (Path(ours).resolve(),) if ours else tuple(_ROOT / one for one in _PACKAGES)
    for kept, name in _caches(ours):
        to = folder / name
        to.mkdir()
        for file in kept.glob("*.nb[ci]"):
            (to / file.name).symlink_to(file.resolve())
    return Kernels(folder, behind)


def _caches(ours: str | None) -> Iterator[tuple[Path, str]]:
    """Folders of kernels, and what numba calls them in a folder of one's own."""
    if ours:
        yield from ((one, one.name) for one in Path(ours).resolve().glob("*/"))
        return
    from numba.core.caching import UserProvidedCacheLocator  # jobs that capture nothing do without

    for package in _PACKAGES:
        for kept in (_ROOT / package).rglob("__pycache__"):
            yield kept, UserProvidedCacheLocator.get_suitable_cache_subpath(str(kept.parent / "_"))
