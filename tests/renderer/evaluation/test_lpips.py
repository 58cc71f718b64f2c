"""LPIPS on the backbones at hand."""

from __future__ import annotations

import pytest
import torch

from renderer.errors import RendererError
from renderer.evaluation.lpips import PACKAGED_BACKBONE, Lpips
from tests.shared_data import shared_data


@pytest.fixture(scope="module", params=["packaged", "alexnet"])
def lpips(request) -> Lpips:
    if request.param == "packaged":
        return Lpips(PACKAGED_BACKBONE)
    return Lpips(shared_data("models") / f"{request.param}_features.pth")


def _picture(seed: int = 0) -> torch.Tensor:
    generator = torch.Generator().manual_seed(seed)
    coarse = torch.rand(1, 3, 8, 8, generator=generator)
    return torch.nn.functional.interpolate(coarse, size=(64, 48), mode="bilinear")


def test_equal_pictures_are_at_no_distance(lpips):
    assert float(lpips(_picture(), _picture())) == 0.0


def test_distance_grows_with_noise_and_is_symmetric(lpips):
    truth = _picture()
    noise = torch.randn(truth.shape, generator=torch.Generator().manual_seed(1))
    noisy = [(truth + scale * noise).clamp(0.0, 1.0) for scale in (0.02, 0.05, 0.1, 0.2)]
    distances = [float(lpips(picture, truth)) for picture in noisy]
    assert distances == sorted(distances)
    assert distances[0] > 0.0
    assert distances[-1] > 5.0 * distances[0]
    assert float(lpips(truth, noisy[1])) == pytest.approx(distances[1], rel=1e-5)


def test_sees_blur_that_pixels_hardly_notice(lpips):
    truth = (_picture() > 0.5).float()
    blurred = torch.nn.functional.avg_pool2d(truth, 5, 1, 2)
    shifted = (truth + 0.05).clamp(0.0, 1.0)
    assert float(lpips(blurred, truth)) > 3.0 * float(lpips(shifted, truth))


def test_gradients_reach_the_picture_even_from_equality(lpips):
    made = _picture().requires_grad_(True)
    lpips(made, _picture(1)).sum().backward()
    assert made.grad is not None
    assert torch.isfinite(made.grad).all()
    assert made.grad.abs().max() > 0.0


def test_too_small_pictures_are_refused(lpips):
    tiny = torch.zeros(1, 3, 8, 8)
    with pytest.raises(RendererError, match="px a side for LPIPS"):
        lpips(tiny, tiny)


def test_a_file_that_is_no_backbone_is_refused(tmp_path):
    torch.save({"a": torch.zeros(1)}, tmp_path / "other.pth")
    with pytest.raises(RendererError, match=r"must be SqueezeNet 1\.1, AlexNet or VGG-16"):
        Lpips(tmp_path / "other.pth")
    (tmp_path / "text.pth").write_text("no tensors")
    with pytest.raises(RendererError, match=r"must be a \.pth or \.safetensors of tensors"):
        Lpips(tmp_path / "text.pth")
