"""The fused network against its plain twin: Triton's interpreter on a CPU, or a CUDA device."""

from __future__ import annotations

import subprocess
import sys

import pytest
import torch

from renderer.field.networks.mlps import Mlp
from renderer.field.sizes import MlpSize
from renderer.fused.mlp import NotFusible, fused_mlp, require_fusible, runs_on
from renderer.reference.mlp import mlp as twin

DEVICE = torch.device("cuda" if torch.cuda.is_available() else "cpu")
SHAPES = [
    # width, hidden layers, inputs, outputs, rows
    (16, 1, 1, 2, 9),
    (16, 8, 3, 4, 33),
    (32, 3, 16, 3, 129),
    (64, 2, 63, 64, 150),
    (64, 5, 127, 4, 64),
    (128, 2, 128, 69, 70),
]


def _weights(width: int, hidden: int, inputs: int, outputs: int) -> list[torch.Tensor]:
    generator = torch.Generator().manual_seed(width + hidden)
    shapes = [(width, inputs), *[(width, width)] * (hidden - 1), (outputs, width)]
    # negative weights are rarer: an unlucky deep narrow network would else be dead
    return [
        ((torch.randn(shape, generator=generator) + 0.2) * (1.5 / shape[1]) ** 0.5)
        .to(DEVICE)
        .requires_grad_(True)
        for shape in shapes
    ]


def _inputs(rows: int, inputs: int) -> torch.Tensor:
    generator = torch.Generator().manual_seed(rows)
    return torch.randn(rows, inputs, generator=generator).to(DEVICE).requires_grad_(True)


def _agree(
    got: torch.Tensor, expected: torch.Tensor, cosine: float = 0.998, bias: float = 0.02
) -> None:
    """Same direction and no bias to either side; single elements may be apart where rounding put a
    unit on the other side of its ReLU."""
    one, other = got.double().flatten(), expected.double().flatten()
    assert one @ other > cosine * one.norm() * other.norm() > 0.0
    assert abs(float((one - other).sum() / other.abs().sum())) < bias


def test_the_kernels_run_here():
    assert runs_on(DEVICE)


@pytest.mark.parametrize("relu_last", [False, True])
@pytest.mark.parametrize("shape", SHAPES)
def test_outputs_and_gradients_agree_with_the_twin(shape, relu_last):
    width, hidden, inputs, outputs, rows = shape
    weights, x = _weights(width, hidden, inputs, outputs), _inputs(rows, inputs)
    made, expected = fused_mlp(x, weights, relu_last), twin(x, weights, relu_last)
    assert (expected != 0.0).any()
    assert (made - expected).abs().max() < 5e-3 * expected.abs().max() + 1e-4
    pull = torch.randn(made.shape, generator=torch.Generator().manual_seed(1)).to(DEVICE)
    wanted = torch.autograd.grad(expected, [x, *weights], pull)
    for got, true in zip(torch.autograd.grad(made, [x, *weights], pull), wanted, strict=True):
        assert got.shape == true.shape
        _agree(got, true)


def _rounded(value: torch.Tensor) -> torch.Tensor:
    """To half precision and back; the gradient passes as it is."""
    return value + (value.half().float() - value).detach()


def test_with_the_same_rounding_gradients_agree_to_it():
    """No unit lies on another side of its ReLU then: what is left is the rounding of deltas."""
    weights, x = _weights(16, 8, 3, 4), _inputs(33, 3)
    value = _rounded(x)
    for weight in weights[:-1]:
        value = _rounded(torch.relu(value @ _rounded(weight).T))
    expected = value @ _rounded(weights[-1]).T
    pull = torch.ones_like(expected)
    wanted = torch.autograd.grad(expected, [x, *weights], pull)
    made = torch.autograd.grad(fused_mlp(x, weights), [x, *weights], pull)
    for got, true in zip(made, wanted, strict=True):
        _agree(got, true, cosine=0.9999, bias=1e-3)


def test_gradients_against_finite_differences():
    """The twin in float64, moved by half a step to each side, is the truth."""
    weights, x = _weights(32, 3, 6, 2), _inputs(40, 6)
    made = fused_mlp(x, weights)
    pull = torch.randn(made.shape, generator=torch.Generator().manual_seed(2)).to(DEVICE)
    gradients = torch.autograd.grad(made, [x, *weights], pull)
    exact = [value.detach().double() for value in (x, *weights)]

    def total(values: list[torch.Tensor]) -> torch.Tensor:
        return (twin(values[0], values[1:]) * pull.double()).sum()

    for place, gradient in enumerate(gradients):
        generator = torch.Generator().manual_seed(place)
        for _ in range(3):
            way = torch.randn(exact[place].shape, generator=generator).to(DEVICE).double()
            sides = []
            for sign in (1.0, -1.0):
                moved = list(exact)
                moved[place] = exact[place] + sign * 1e-6 * way
                sides.append(total(moved))
            slope = float((sides[0] - sides[1]) / 2e-6)
            spread = float(gradient.double().norm() * way.norm())
            assert float((gradient.double() * way).sum()) == pytest.approx(slope, abs=3e-3 * spread)


@pytest.mark.parametrize("factor", [1e-12, 1e-7, 1.0, 1e6])
def test_loss_scaling_keeps_gradients_of_any_size(factor):
    weights, x = _weights(32, 2, 8, 3), _inputs(50, 8)
    pull = factor * torch.ones(50, 3, device=DEVICE)
    got = torch.autograd.grad(fused_mlp(x, weights), [x, *weights], pull)
    true = torch.autograd.grad(twin(x, weights), [x, *weights], pull)
    for one, other in zip(got, true, strict=True):
        _agree(one, other)


def test_nan_stays_in_its_row():
    weights, x = _weights(16, 3, 5, 2), _inputs(40, 5).detach()
    x[7, 2] = float("nan")
    made = fused_mlp(x, weights)
    assert made[7].isnan().all()
    assert made[torch.arange(40) != 7].isfinite().all()


@pytest.mark.filterwarnings("ignore:overflow encountered:RuntimeWarning")
@pytest.mark.filterwarnings("ignore:invalid value encountered:RuntimeWarning")
def test_numbers_past_half_precision_do_not_look_right():
    weights, x = _weights(16, 2, 4, 2), _inputs(20, 4)
    made = fused_mlp(1e7 * x, weights)
    assert not made.isfinite().all()
    (gradient,) = torch.autograd.grad(made.sum(), weights[0], allow_unused=True)
    assert not gradient.isfinite().all()


def test_gradients_that_are_not_finite_stay_so():
    weights, x = _weights(16, 2, 4, 2), _inputs(20, 4)
    pull = torch.ones(20, 2, device=DEVICE)
    pull[3, 1] = float("nan")
    gradient = torch.autograd.grad(fused_mlp(x, weights), weights[-1], pull)[0]
    assert gradient[1].isnan().all()


def test_no_rows_are_no_trouble():
    weights, x = _weights(16, 2, 4, 2), _inputs(0, 4)
    made = fused_mlp(x, weights)
    assert made.shape == (0, 2)
    made.sum().backward()


@pytest.mark.parametrize(
    ("shapes", "biased", "words"),
    [
        ([(48, 8), (3, 48)], False, "be 16, 32, 64, 128 wide; got 48"),
        ([(16, 8)], False, "have 1 to 8 hidden layers; got 0"),
        ([(16, 8), *[(16, 16)] * 8, (3, 16)], False, "have 1 to 8 hidden layers; got 9"),
        ([(16, 129), (3, 16)], False, "have 1 to 128 inputs; got 129"),
        ([(16, 8), (32, 16), (3, 32)], False, "keep one width; got layers of"),
        ([(16, 8), (3, 16)], True, "have no biases; got some"),
    ],
)
def test_what_can_not_be_fused_is_refused(shapes, biased, words):
    with pytest.raises(NotFusible, match=words):
        require_fusible(shapes, biased=biased)


@pytest.mark.parametrize("skip", [None, 3, 4])
def test_a_network_with_a_skip_runs_as_two_calls(skip):
    size = MlpSize(depth=5, width=16, skip=skip, bias=False)
    torch.manual_seed(0)
    fused = Mlp(6, 4, size, shared=3, backend="fused").to(DEVICE)
    plain = Mlp(6, 4, size, shared=3).to(DEVICE)
    plain.load_state_dict(fused.state_dict())
    x, pose = _inputs(30, 6), _inputs(1, 3)[0]
    made, expected = fused(x, pose), plain(x, pose)
    assert (made - expected).abs().max() < 5e-3 * expected.abs().max()
    for network, out in ((fused, made), (plain, expected)):
        (out * out).sum().backward()
        assert all(p.grad is not None for p in network.parameters())
    for one, other in zip(fused.parameters(), plain.parameters(), strict=True):
        assert one.grad is not None
        assert other.grad is not None
        _agree(one.grad, other.grad)


def test_one_call_gives_the_same_gradients_every_time():
    weights, x = _weights(32, 3, 8, 3), _inputs(300, 8)
    first, again = (torch.autograd.grad(fused_mlp(x, weights).sum(), weights) for _ in range(2))
    assert all(torch.equal(one, other) for one, other in zip(first, again, strict=True))


def test_without_triton_the_plain_network_takes_over():
    code = """
import sys
sys.modules["triton"] = None
import torch
from renderer.field.networks.mlps import Mlp
from renderer.field.sizes import MlpSize
size = MlpSize(3, 16, bias=False)
fused = Mlp(5, 2, size, backend="fused")
plain = Mlp(5, 2, size)
plain.load_state_dict(fused.state_dict())
x = torch.randn(7, 5)
assert torch.equal(fused(x), plain(x))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
