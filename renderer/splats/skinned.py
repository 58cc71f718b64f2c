"""What drawing and lighting need of a model of splats."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from renderer.splats.cloth.tubes import Tubes
from scene.arrays import Array, Float, Int, UInt8
from scene.skeleton import Skeleton


@runtime_checkable
class SkinnedSplats(Protocol):
    """What is drawn of a `SplatModel`; meanings and units are told there."""

    @property
    def parameters(self) -> Float[Array, "N 14"]: ...
    @property
    def joints(self) -> UInt8[Array, "N 4"]: ...
    @property
    def weights(self) -> Float[Array, "N 4"]: ...
    @property
    def skeleton(self) -> Skeleton: ...
    @property
    def albedo(self) -> Float[Array, "N 3"] | None: ...
    @property
    def normals(self) -> Float[Array, "N 3"] | None: ...
    @property
    def light(self) -> Float[Array, "9 3"] | None: ...
    @property
    def cloth(self) -> Tubes | None: ...
    @property
    def quads(self) -> Int[Array, "N"]: ...
    @property
    def expression_splats(self) -> Int[Array, "M"]: ...
    @property
    def expression_offsets(self) -> Float[Array, "M S 3"]: ...
