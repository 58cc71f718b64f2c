"""Compiles the fused kernels for GPUs that need not be present; prints each target that works.

Run without TRITON_INTERPRET: an interpreted kernel can't be compiled.
"""

from __future__ import annotations

from typing import Any

import triton
from triton.backends.compiler import GPUTarget
from triton.compiler import ASTSource

from renderer.fused import mlp_kernels

_SHARED_BYTES = 99 * 1024
"""Shared memory that one program may use on every GPU since Ampere."""
_HALF = {"w_first", "w_hidden", "w_last", "h", "delta", "delta_last"}
_COUNTS = {"rows", "inputs", "outputs", "run", "wide_in", "wide_out"}
_NETWORK = {"PADDED_INPUTS": 64, "WIDTH": 64, "PADDED_OUTPUTS": 16, "HIDDEN": 3,
            "RELU_LAST": False, "BLOCK": 128}  # fmt: skip
KERNELS: list[tuple[Any, dict[str, Any]]] = [
    (mlp_kernels.forward, {**_NETWORK, "KEEP": True}),
    (mlp_kernels.backward, {**_NETWORK, "FOR_INPUTS": True}),
    (mlp_kernels.weight_gradient, {"TILE_IN": 64, "TILE_OUT": 64, "BLOCK": 64}),
]


def _kind(name: str) -> str:
    if name in _COUNTS:
        return "i32"
    return "*fp16" if name in _HALF else "*fp32"


for capability in (80, 90):
    for kernel, constants in KERNELS:
        signature = {
            name: "constexpr" if name in constants else _kind(name) for name in kernel.arg_names
        }
        values = {(kernel.arg_names.index(name),): value for name, value in constants.items()}
        made = triton.compile(
            ASTSource(kernel, signature, values), target=GPUTarget("cuda", capability, 32)
        )
        assembly = made.asm["ptx"]
        assert "mma" in assembly, f"{kernel.__name__} uses no tensor cores on sm_{capability}"
        assert made.metadata.shared <= _SHARED_BYTES, made.metadata.shared
    print(f"sm_{capability}")
