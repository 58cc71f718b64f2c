"""Sequences from folders of any known layout: MetaNeRF's own, HumanNeRF's prepared one,
ZJU-MoCap's."""

from __future__ import annotations

from pathlib import Path

from capture.errors import BrokenSequence
from capture.sources.readers.humannerf import PICKLES, open_humannerf, write_humannerf
from capture.sources.readers.zju_mocap import open_zju_mocap
from capture.storage import open_sequence
from scene.sequence import Sequence

__all__ = ["open_folder", "open_humannerf", "open_zju_mocap", "write_humannerf"]


def open_folder(path: Path) -> Sequence:
    """The sequence in folder `path`, in any known layout, recognised by its files.

    Raises BrokenSequence for a folder of no known layout, and what that layout's reader raises.
    """
    if (path / "sequence.json").exists():
        return open_sequence(path)
    if all((path / name).exists() for name in PICKLES):
        return open_humannerf(path)
    if (path / "annots.npy").exists():
        return open_zju_mocap(path)
    raise BrokenSequence(
        f"{path} must be a sequence folder: with sequence.json (MetaNeRF), {', '.join(PICKLES)} "
        "(HumanNeRF) or annots.npy (ZJU-MoCap); got none of them; name another, or capture a clip"
    )
