"""Picture metrics against worked values and torchmetrics."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from renderer.evaluation.metrics import over_black, psnr, ssim
from scene.errors import InvalidInput


def _pair(noise: float) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(0)
    truth = rng.uniform(size=(40, 33, 3)).astype(np.float32)
    return np.clip(truth + noise * rng.normal(size=truth.shape), 0, 1).astype(np.float32), truth


def test_psnr_golden():
    black = np.zeros((4, 4, 3), np.float32)
    assert psnr(black + np.float32(0.1), black) == pytest.approx(20.0, abs=1e-4)
    assert psnr(black, black) == np.inf


def test_ssim_agrees_with_torchmetrics():
    from torchmetrics.functional.image import structural_similarity_index_measure as reference

    made, truth = _pair(0.2)
    one, other = (torch.from_numpy(p).movedim(-1, 0)[None].double() for p in (made, truth))
    _, each = reference(one, other, data_range=1.0, return_full_image=True)
    within = each[..., 5:-5, 5:-5]  # theirs reflects at the border; ours stays inside
    assert ssim(made, truth) == pytest.approx(float(within.mean()), abs=1e-6)


def test_equal_pictures_are_wholly_similar():
    _, truth = _pair(0.0)
    assert ssim(truth, truth) == pytest.approx(1.0)


def test_sizes_must_agree(unchecked_annotations):
    with pytest.raises(InvalidInput, match=r"made must be as large as truth \(4, 4, 3\); got \(5"):
        psnr(np.zeros((5, 4, 3)), np.zeros((4, 4, 3)))
    with pytest.raises(InvalidInput, match="at least 11 px"):
        ssim(np.zeros((8, 20, 3)), np.zeros((8, 20, 3)))


def test_black_backgrounds_are_left_alone_and_others_cut():
    mask = np.zeros((4, 4), np.float32)
    mask[1:3, 1:3] = [[1.0, 0.5], [0.5, 1.0]]
    premultiplied = np.repeat(mask[..., None] * np.float32(0.8), 3, axis=2)
    assert np.array_equal(over_black(premultiplied, mask), premultiplied)
    room = np.full((4, 4, 3), 0.5, np.float32)
    assert np.allclose(over_black(room, mask), 0.5 * mask[..., None])
