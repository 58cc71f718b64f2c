"""The ruler: true masks and points of test frames, frozen in this repository.

`ruler/CLIP/` holds, for some pairs of successive frames of one clip at its own resolution,

    ruler.json     the clip's file, its sha256, its size in px, the numbers of the frames
    masks/N.png    the person, 8 bit, as `tools.build_real_ruler` cut them out, corrected by eye
    hidden/N.png   what stands in front of the person there, 255: not judged; for some frames
    points.npz     face [K 478 2] and hands [K 2 21 2], px, NaN where none is seen

No part of capture is asked when a model is measured, so a change there can't move the ruler.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import cv2
import numpy as np

from scene.arrays import Array, Float
from scene.errors import InvalidInput

RULERS = Path(__file__).parent / "ruler"


@dataclass(frozen=True, eq=False)
class Ruler:
    """Truth about some frames of one clip."""

    folder: Path
    file: str
    """The clip, below the folder of footage."""
    sha256: str
    size: tuple[int, int]
    """Width and height of its frames, px."""
    clip_frames: int
    indices: tuple[int, ...]
    """Numbers of the frames, in pairs of successive ones."""

    @classmethod
    def read(cls, name: str, root: Path = RULERS) -> Ruler:
        """The ruler of the clip `name`. Raises InvalidInput where there is none."""
        path = root / name / "ruler.json"
        if not path.is_file():
            known = sorted(each.parent.name for each in root.glob("*/ruler.json"))
            raise InvalidInput(f"a clip must have a ruler; got {name!r}; there are {known}")
        about = json.loads(path.read_text())
        return cls(
            path.parent,
            about["file"],
            about["sha256"],
            tuple(about["size"]),
            about["clip_frames"],
            tuple(about["indices"]),
        )

    def require_footage(self, footage: Path) -> Path:
        """The clip's file below `footage`. Raises InvalidInput where it is another one."""
        path = footage / self.file
        found = hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else "no file"
        if found != self.sha256:
            raise InvalidInput(
                f"{self.file} must be the clip that its ruler was made for, sha256 "
                f"{self.sha256[:12]}...; got {found[:12]} in {footage}; fetch it again, or make "
                "its ruler anew with tools.build_real_ruler and look at every mask"
            )
        return path

    def mask(self, index: int) -> Float[Array, "H W"]:
        """Alpha of the person in frame `index`, [0, 1]."""
        pixels = cv2.imread(str(self.folder / "masks" / f"{index:04d}.png"), cv2.IMREAD_GRAYSCALE)
        if pixels is None:
            raise InvalidInput(f"frame must be one of {self.indices}; got {index}")
        return pixels.astype(np.float32) / np.float32(255.0)

    def hidden(self, index: int) -> Float[Array, "H W"]:
        """1 where something in front hides the person in frame `index`, else 0."""
        path = self.folder / "hidden" / f"{index:04d}.png"
        pixels = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) if path.exists() else None
        if pixels is None:
            return np.zeros(self.size[::-1], np.float32)
        return (pixels > 0).astype(np.float32)

    def face(self, index: int) -> Float[Array, "478 2"] | None:
        """Points of the face in frame `index`, px; None where it is not seen."""
        return _seen(self._points["face"][self.indices.index(index)])

    def hands(self, index: int) -> list[Float[Array, "21 2"]]:
        """Points of the hands that are seen in frame `index`, px."""
        hands = self._points["hands"][self.indices.index(index)]
        return [hand for hand in map(_seen, hands) if hand is not None]

    @cached_property
    def _points(self) -> dict[str, Array]:
        with np.load(self.folder / "points.npz", allow_pickle=False) as stored:
            return {name: stored[name].astype(np.float64) for name in ("face", "hands")}


def _seen(points: Array) -> Array | None:
    return points if np.isfinite(points).all() else None
