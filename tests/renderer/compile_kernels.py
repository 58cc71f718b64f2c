"""Compiles every Triton kernel for GPUs that need not be present; prints each target that works.

Run without TRITON_INTERPRET: an interpreted kernel can't be compiled.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import triton
from triton.backends.compiler import GPUTarget
from triton.compiler import ASTSource

from renderer.field.rendering import gpu_kernels as of_fields
from renderer.fused import mlp_kernels as of_networks
from renderer.fused.mlp import WARPS
from renderer.splats.rasteriser import gpu_kernels as of_splats

_SHARED_BYTES = 99 * 1024
"""Shared memory that one program may use on every GPU since Ampere."""
_KINDS = {
    "i32": "rows inputs outputs run wide_in wide_out count rays width height depth across tiles_x "
    "blocks_x live_depth live_height live_width",
    "fp32": "dilation",
    "*fp16": "w_first w_hidden w_last h delta delta_last first hidden again last",
    "*i64": "order samples chosen ends",
    "*i32": "joints boxes lists lengths kept counts",
    "*i1": "busy live",
}
"""Names of arguments by their kind; every other is single precision numbers."""
_NETWORK = {
    "PADDED_INPUTS": 64,
    "WIDTH": 64,
    "PADDED_OUTPUTS": 16,
    "HIDDEN": 3,
    "RELU_LAST": False,
    "BLOCK": 32,
}
_WITHIN = {"INPUTS": 64, "WIDTH": 64, "OUTPUTS": 16, "DEPTH": 3, "SKIP": 2, "BLOCK": 32}
_RAYS = {"JOINTS": 24, "SLOTS": 128, "BLOCK": 128}


@dataclass(frozen=True)
class _Case:
    kernel: Any
    constants: dict[str, Any]
    warps: int = 4
    multiplies: bool = False
    """Whether it must use tensor cores."""
    kinds: dict[str, str] = field(default_factory=dict)


CASES = (
    _Case(of_networks.forward, {**_NETWORK, "KEEP": True}, WARPS, True),
    _Case(of_networks.backward, {**_NETWORK, "FOR_INPUTS": True}, WARPS, True),
    _Case(of_networks.weight_gradient, {"TILE_IN": 64, "TILE_OUT": 64, "BLOCK": 64}, 4, True),
    _Case(of_fields.march, {**_RAYS, "LEAST": 1e-3}, 1, kinds={"kept": "*i8"}),
    _Case(of_fields.skin, _RAYS),
    _Case(of_fields.move, {**_WITHIN, "MOVED": True}, WARPS, True),
    _Case(of_fields.evaluate, {**_WITHIN, "SCALE": 1.0, "START": 1.0, "SLOTS": 128}, WARPS, True),
    _Case(of_fields.composite, {"BLOCK": 128}),
    _Case(of_splats.project, {"BLOCK": 128}, kinds={"depth": "*fp32"}),
    _Case(of_splats.list_blocks, {"SIDE": 4, "PIECE": 1024}),
    _Case(of_splats.blend, {"SIDE": 4, "PIECE": 256}),
)


def _kind(case: _Case, name: str) -> str:
    if name in case.constants:
        return "constexpr"
    known = (kind for kind, names in _KINDS.items() if name in names.split())
    return case.kinds.get(name, next(known, "*fp32"))


for capability in (80, 90):
    for case in CASES:
        names = case.kernel.arg_names
        made = triton.compile(
            ASTSource(
                case.kernel,
                {name: _kind(case, name) for name in names},
                {(names.index(name),): value for name, value in case.constants.items()},
            ),
            target=GPUTarget("cuda", capability, 32),
            options={"num_warps": case.warps},
        )
        what = f"{case.kernel.__name__} on sm_{capability}"
        assembly = made.asm["ptx"]
        assert "mma" in assembly or not case.multiplies, f"{what} uses no tensor cores"
        assert "wgmma" not in assembly or case.warps > WARPS, f"{what} multiplies by warp groups"
        assert made.metadata.shared <= _SHARED_BYTES, f"{what} shares {made.metadata.shared} bytes"
    print(f"sm_{capability}")
