"""Which pixels a step sees."""

from __future__ import annotations

import pytest
import torch

from renderer.field.field import PersonField
from renderer.field.skinning.posed_body import Support
from renderer.field.training.views import TrainingView, read_views
from tests.renderer.field.performer import TINY, body, sequence

SIDE = 5


@pytest.fixture(scope="module")
def view() -> TrainingView:
    """The first frame, its rays' meetings with the body known."""
    field = PersonField.for_body(TINY.sizes, body())
    (first, *_) = read_views(sequence().train, torch.device("cpu"), least_px=20)
    volume = field.weight_volume()
    transforms = field.transforms(first.joint_angles, first.root_translation, refine=False)
    first.prepare(field, volume, Support.of(volume), transforms)
    return first


@pytest.mark.parametrize("on_body", [0.0, 0.8, 1.0])
def test_a_share_of_patches_is_centred_on_the_body(view, on_body):
    chance = torch.Generator().manual_seed(0)
    count = 3000
    pixels = view.pick_patches(count, SIDE, on_body, chance).view(count, SIDE, SIDE)
    height, width = view.shape
    assert (pixels[:, 1:] - pixels[:, :-1] == width).all()
    assert (pixels[:, :, 1:] - pixels[:, :, :-1] == 1).all()
    assert 0 <= int(pixels.min()) <= int(pixels.max()) < height * width
    centred = (view.truth(pixels[:, SIDE // 2, SIDE // 2])[:, 3] > 0.0).float().mean()
    anywhere = (view.truth(torch.arange(height * width))[:, 3] > 0.0).float().mean()
    # patches at the border are moved inwards, so their centres are not drawn evenly
    expected = on_body + (1.0 - on_body) * float(anywhere)
    assert float(centred) == pytest.approx(expected, abs=0.06)


def test_large_crops_are_shrunk_and_see_the_same_rays():
    source, cpu = sequence().train, torch.device("cpu")
    whole, small = read_views(source, cpu)[0], read_views(source, cpu, most_px=16)[0]
    assert max(small.shape) == 16 < max(whole.shape)
    every = (torch.arange(view.shape[0] * view.shape[1]) for view in (whole, small))
    means = [
        view.rays(pixels)[1].mean(dim=0) for view, pixels in zip((whole, small), every, strict=True)
    ]
    assert torch.allclose(means[0], means[1], atol=1e-3)


def test_one_seed_picks_the_same_patches(view):
    first, again = (
        view.pick_patches(4, SIDE, 0.8, torch.Generator().manual_seed(7)) for _ in range(2)
    )
    assert torch.equal(first, again)
