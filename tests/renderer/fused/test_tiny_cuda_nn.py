"""How weights reach tiny-cuda-nn, which runs on CUDA alone: its documented layout, read back."""

from __future__ import annotations

import torch

from renderer.fused.tiny_cuda_nn import flat_parameters


def _weights() -> list[torch.Tensor]:
    generator = torch.Generator().manual_seed(0)
    shapes = ((32, 21), (32, 32), (5, 32))
    return [0.2 * torch.randn(shape, generator=generator) for shape in shapes]


def test_the_flat_vector_holds_padded_layers_in_order():
    weights = _weights()
    flat = flat_parameters(weights)
    sizes = (32 * 32, 32 * 32, 16 * 32)
    first, hidden, last = (
        part.view(rows, 32) for part, rows in zip(flat.split(sizes), (32, 32, 16), strict=True)
    )
    assert torch.equal(first[:, :21], weights[0])
    assert (first[:, 21:] == 0.0).all()
    assert torch.equal(hidden, weights[1])
    assert torch.equal(last[:5], weights[2])
    assert (last[5:] == 0.0).all()


def test_gradients_flow_back_to_every_layer():
    weights = [weight.requires_grad_(True) for weight in _weights()]
    flat_parameters(weights).square().sum().backward()
    for weight in weights:
        assert weight.grad is not None
        assert torch.allclose(weight.grad, 2.0 * weight)
