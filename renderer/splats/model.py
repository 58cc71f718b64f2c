"""A person as canonical Gaussians that follow the skeleton."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any
from weakref import WeakKeyDictionary

import numpy as np

from renderer.splats.cloth.hanging import NO_CLOTH, BoundSplats, ClothSwing, MotionPath, on_no_cloth
from renderer.splats.cloth.tubes import Tubes
from renderer.splats.expressions import no_offsets, no_splats
from renderer.splats.layout import LOG_SCALE, PARAMETERS, POSITION
from renderer.splats.rasteriser.renderer import Geometry, SplatRenderer
from renderer.splats.unseen import fade_unseen
from scene.arrays import Array, Bool, Float, Int, UInt8
from scene.camera import Camera
from scene.checks import require_finite, require_indices, require_shape
from scene.errors import InvalidInput
from scene.expression import BLEND_SHAPE_COUNT, offsets_of_any_version
from scene.lighting import HARMONICS
from scene.motion import Motion, Pose
from scene.skeleton import Skeleton

if TYPE_CHECKING:
    from renderer.presets import Preset

_SURFACE = ("albedo", "normals")
"""Tensors of models whose light is known."""
_CLOTH = "cloth."
"""Before the names of those of loose clothes."""


@dataclass(frozen=True, eq=False)
class SplatModel:
    """Splats at rest, each bound to at most four joints (a `PerformerModel`)."""

    parameters: Float[Array, "N 14"]
    """Columns as in `renderer.splats.layout`: position, log scale, rotation, colour, opacity."""
    joints: UInt8[Array, "N 4"]
    weights: Float[Array, "N 4"]
    """Blend weights of `joints`; rows sum to one."""
    seen: Bool[Array, "N"]
    """Whether any training frame showed the splat; what was never seen is filled in."""
    skeleton: Skeleton
    motion: Motion
    data_hash: str
    preset: str = "splats"
    metrics: dict[str, Any] = field(default_factory=dict)
    albedo: Float[Array, "N 3"] | None = None
    """Linear colour without the light it was captured in; None where that was not estimated."""
    normals: Float[Array, "N 3"] | None = None
    """Of the surface at rest, outwards, unit length; known where the albedo is."""
    light: Float[Array, "9 3"] | None = None
    """Harmonics (`scene.lighting`) of the light that the person was captured in: times the albedo
    it gives linear colour. None: where no other light falls, colours are those of `parameters`."""
    expression_splats: Int[Array, "M"] = field(default_factory=no_splats)
    """Rows of the splats that the person's expressions move, of head and hands; none: not known."""
    expression_offsets: Float[Array, "M S 3"] = field(default_factory=no_offsets)
    """Metres at rest that each blend shape (`scene.expression`) at 1 moves them."""
    cloth: Tubes | None = None
    """Loose clothes, which swing; None: they are tight."""
    quads: Int[Array, "_"] = field(default_factory=lambda: np.zeros(0, np.int32))
    """Where on `cloth` each splat lies, see `BoundSplats`; left out, all are on the body."""

    def __post_init__(self) -> None:
        require_shape("parameters", self.parameters, (None, PARAMETERS))
        require_shape("joints", self.joints, (len(self.parameters), 4))
        require_shape("weights", self.weights, (len(self.parameters), 4))
        require_shape("seen", self.seen, (len(self.parameters),))
        require_finite("parameters", self.parameters)
        require_finite("weights", self.weights)
        # compiled code follows them without looking
        require_indices("joints", self.joints, len(self.skeleton.names))
        if self.cloth is None or not len(self.quads):
            object.__setattr__(self, "quads", on_no_cloth(len(self)))
        require_shape("quads", self.quads, (len(self),))
        if self.cloth is not None:
            on_cloth = self.quads[self.quads != NO_CLOTH]
            require_indices("quads", on_cloth, len(self.cloth.quads))
        for name in ("albedo", "normals"):
            if (known := getattr(self, name)) is not None:
                require_shape(name, known, (len(self.parameters), 3))
        sizes = (len(self.expression_splats), BLEND_SHAPE_COUNT, 3)
        require_shape("expression_offsets", self.expression_offsets, sizes)
        require_finite("expression_offsets", self.expression_offsets)
        require_shape("expression_splats", self.expression_splats, (None,))
        require_indices("expression_splats", self.expression_splats, len(self))
        if self.light is not None:
            require_shape("light", self.light, (HARMONICS, 3))
            require_finite("light", self.light)

    def __len__(self) -> int:
        return len(self.parameters)

    def render(
        self, camera: Camera, pose: Pose, hung: Float[Array, "V 3"] | None = None
    ) -> Float[Array, "H W 4"]:
        """Premultiplied sRGB and alpha, float32. For many views keep a `SplatRenderer`.

        Args: hung: where loose clothes are, see `MotionPath`; None: settled in this pose.
        """
        transforms = self.skeleton.skinning_transforms(pose.joint_angles, pose.root_translation)
        if hung is None and self.cloth is not None:
            hung = ClothSwing(self.cloth).hung(transforms, pose.time_s)
        return SplatRenderer((self,)).render(
            camera, [transforms], expressions=[pose.expression], hung=[hung]
        )

    def geometry(self, camera: Camera, pose: Pose) -> Geometry:
        """Depth and normals of the person in `pose` seen by `camera`."""
        renderer = SplatRenderer((self,))
        transforms = self.skeleton.skinning_transforms(pose.joint_angles, pose.root_translation)
        renderer.render(camera, [transforms], expressions=[pose.expression])
        return renderer.geometry([transforms])

    @property
    def kind(self) -> str:
        """As model files name it."""
        return "splats"

    @property
    def splats(self) -> SplatModel:
        """Itself."""
        return self

    def filmed_parts(self) -> SplatModel:
        """Parts never filmed faded out; made once and kept as long as the model lives."""
        if self.seen.all():
            return self
        if self not in _FILMED_PARTS:
            _FILMED_PARTS[self] = replace(self, parameters=fade_unseen(self.parameters, self.seen))
        return _FILMED_PARTS[self]

    def with_still_cloth(self) -> SplatModel:
        """With loose clothes where they are in the mean of the clip: for whom they can't swing."""
        if self.cloth is None:
            return self
        path = MotionPath.of(self.motion, self.skeleton, self.motion.times_s)
        bound, parameters = BoundSplats(self.parameters, self.quads, self.cloth), self.parameters
        parameters = parameters.copy()
        bound.hang(parameters, self.parameters[bound.rows], path.hung(self.cloth).mean(axis=0))
        return replace(self, parameters=parameters, cloth=None)

    def drawn_as(self, preset: Preset) -> SplatModel:
        """Itself: splats have no speed-ups. Raises InvalidInput for the preset of a field."""
        if preset.is_field:
            raise InvalidInput(f"preset must be one of splats; got {preset.name!r}; use 'splats'")
        return self

    def tensors(self) -> dict[str, Array]:
        """What a model file holds beside motion and skeleton.

        Positions keep float32 (a millimetre matters); the rest is float16, a quarter of a megabyte
        for 10,000 splats.
        """
        surface = {name: getattr(self, name) for name in _SURFACE}
        tensors = {
            **{name: of.astype(np.float16) for name, of in surface.items() if of is not None},
            **({} if self.light is None else {"light": self.light.astype(np.float32)}),
            "positions": self.parameters[:, POSITION : POSITION + 3].astype(np.float32),
            "appearance": self.parameters[:, LOG_SCALE:].astype(np.float16),
            "joints": self.joints,
            "weights": self.weights.astype(np.float16),
            "seen": self.seen,
        }
        if len(self.expression_splats):
            tensors["expression_splats"] = self.expression_splats.astype(np.uint32)
            tensors["expression_offsets"] = self.expression_offsets.astype(np.float16)
        if self.cloth is not None:
            tensors |= {_CLOTH + name: array for name, array in self.cloth.tensors().items()}
            tensors["quads"] = self.quads.astype(np.int32)
        return tensors

    @classmethod
    def from_tensors(
        cls, tensors: dict[str, Array], about: dict[str, Any], skeleton: Skeleton, motion: Motion
    ) -> SplatModel:
        """The model whose `tensors` these are; `about` holds the file's other entries."""
        positions = tensors["positions"]
        parameters = np.empty((len(positions), PARAMETERS), np.float32)
        parameters[:, POSITION : POSITION + 3] = positions
        parameters[:, LOG_SCALE:] = tensors["appearance"]
        weights = tensors["weights"].astype(np.float32)
        offsets = tensors.get("expression_offsets", no_offsets()).astype(np.float32)
        cloth = {
            name.removeprefix(_CLOTH): array
            for name, array in tensors.items()
            if name.startswith(_CLOTH)
        }
        return cls(
            parameters,
            tensors["joints"],
            weights / weights.sum(axis=1, keepdims=True),
            tensors["seen"].astype(bool),
            skeleton,
            motion,
            about["data_hash"],
            about["preset"],
            about["metrics"],
            **{name: tensors[name].astype(np.float32) for name in _SURFACE if name in tensors},
            light=tensors.get("light"),
            expression_splats=tensors.get("expression_splats", no_splats()).astype(np.int32),
            expression_offsets=offsets_of_any_version(offsets, axis=1),
            cloth=Tubes.from_tensors(cloth) if cloth else None,
            quads=tensors.get("quads", np.zeros(0, np.int32)),
        )

    def header(self) -> dict[str, Any]:
        """Nothing: the tensors say it all."""
        return {}


_FILMED_PARTS: WeakKeyDictionary[SplatModel, SplatModel] = WeakKeyDictionary()
