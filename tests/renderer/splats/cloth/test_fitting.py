"""Outlines that tell whether clothes are loose."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import torch

from capture.storage import open_sequence
from capture.studio import make_sequence
from renderer.splats.cloth import fitting
from renderer.splats.cloth.fitting import Outlines, find_cut, shrunk
from renderer.training import train
from scene.arrays import Array, Float
from scene.camera import Camera
from scene.motion import Pose
from scene.sequence import FrameSource, Sequence


@pytest.mark.parametrize("size", [(33, 25), (100, 77), (7, 60)])
def test_masks_are_shrunk_as_pytorch_does(size):
    mask = np.random.default_rng(0).random((100, 77), dtype=np.float32)
    theirs = torch.nn.functional.interpolate(torch.from_numpy(mask)[None, None], size, mode="area")
    np.testing.assert_allclose(shrunk(mask, size), theirs[0, 0], atol=1e-6)


def _with_big_hair(sequence: Sequence) -> Sequence:
    """Masks that reach far beyond the head, and nowhere else."""
    frames = sequence.train
    masks = []
    for frame in range(len(frames)):
        mask = frames.mask(frame)
        top = int(np.flatnonzero(mask.max(axis=1) > 0.5)[0])
        head = mask[: top + mask.shape[0] // 6]
        mask = mask.copy()
        mask[: len(head)] = cv2.dilate(head, np.ones((25, 25), np.uint8))
        masks.append(mask)
    return replace(sequence, train=_Masked(frames, masks))


class _Masked:
    def __init__(self, frames: Any, masks: list[Any]) -> None:
        self._frames, self.mask = frames, masks.__getitem__

    def __len__(self) -> int:
        return len(self._frames)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._frames, name)


class _Ended:
    """Frames of `source`, each of which ends after `rows` of its own."""

    def __init__(self, source: FrameSource, rows: list[int]) -> None:
        self._source, self._rows = source, rows

    def __len__(self) -> int:
        return len(self._source)

    def camera(self, index: int) -> Camera:
        camera = self._source.camera(index)
        return camera.cropped(0, 0, camera.width, self._rows[index])

    def pose(self, index: int) -> Pose:
        return self._source.pose(index)

    def image(self, index: int) -> Float[Array, "H W 3"]:
        return self._source.image(index)[: self._rows[index]]

    def mask(self, index: int) -> Float[Array, "H W"]:
        return self._source.mask(index)[: self._rows[index]]


def test_frames_of_many_sizes_are_compared_where_all_have_pixels(tmp_path: Path):
    make_sequence(tmp_path / "plain", seed=1, frames=16, size=80, test_cameras=1)
    whole = open_sequence(tmp_path / "plain")
    ended = replace(whole, train=_Ended(whole.train, [50 + index for index in range(16)]))
    theirs, ours = Outlines.of(whole), Outlines.of(ended)
    assert theirs.body[:, :50].any()  # else nothing is tested
    np.testing.assert_array_equal(ours.masks, theirs.masks[:, :50])
    np.testing.assert_array_equal(ours.body, theirs.body[:, :50])
    assert train(ended, iterations=1, clock=float).metrics["steps"] == 1


def test_of_hair_that_stands_out_no_cut_is_fitted(tmp_path: Path, monkeypatch: Any):
    make_sequence(tmp_path / "plain", seed=1, frames=16, size=80, test_cameras=1)
    hairy = _with_big_hair(open_sequence(tmp_path / "plain"))
    assert Outlines.of(hairy).beyond > 0.05  # else nothing is tested
    monkeypatch.setattr(fitting, "descended", None)  # what takes long
    assert find_cut(hairy) is None


def test_holes_of_masks_in_the_body_hide_no_skirt(tmp_path: Path):
    make_sequence(tmp_path / "loose", seed=1, frames=12, size=80, test_cameras=1, look="loose")
    loose = open_sequence(tmp_path / "loose")
    masks = [loose.train.mask(frame).copy() for frame in range(len(loose.train))]
    for number, mask in enumerate(masks):
        rows, columns = (place[len(place) // 2] for place in np.nonzero(mask > 0.5))
        cv2.circle(mask, (int(columns) + number % 3 - 1, int(rows)), 6, 0.0, -1)
    holed = replace(loose, train=_Masked(loose.train, masks))
    whole, found = find_cut(loose), find_cut(holed)
    assert whole is not None
    assert found is not None
    assert found.garments == whole.garments
    assert found.cut.skirt_length_m == pytest.approx(whole.cut.skirt_length_m, abs=0.08)
