"""What every model of a person can do, whether it is made of splats or of a neural field.

Nobody outside `renderer` asks of which class a model is: what only some models can do is a property
or a method here.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

from scene.arrays import Array, Float
from scene.camera import Camera
from scene.motion import Motion, Pose
from scene.skeleton import Skeleton

if TYPE_CHECKING:
    from renderer.presets import Preset
    from renderer.splats.model import SplatModel


@runtime_checkable
class PerformerModel(Protocol):
    """A trained model of one person."""

    @property
    def kind(self) -> str:
        """What it is made of, as model files name it: `splats` or `field`."""
        ...

    @property
    def preset(self) -> str:
        """Name of the preset that it was trained with."""
        ...

    @property
    def skeleton(self) -> Skeleton:
        """The person's own joints."""
        ...

    @property
    def motion(self) -> Motion:
        """The motion of the clip it was trained on, as training left it."""
        ...

    @property
    def data_hash(self) -> str:
        """sha256 of the data that it was trained on."""
        ...

    @property
    def metrics(self) -> dict[str, Any]:
        """What training reported: steps, seconds, loss, what was never seen."""
        ...

    @property
    def splats(self) -> SplatModel | None:
        """The Gaussians it is made of, which have depth, normals, albedo and files of their own;
        None for a field."""
        ...

    def render(self, camera: Camera, pose: Pose) -> Float[Array, "H W 4"]:
        """Premultiplied sRGB and alpha, float32, of the person in `pose` seen by `camera`."""
        ...

    def filmed_parts(self) -> PerformerModel:
        """The model with parts never filmed faded out; itself where it keeps no such record."""
        ...

    def drawn_as(self, preset: Preset) -> PerformerModel:
        """The same weights, drawn with the speed-ups of `preset`.

        Raises InvalidInput for a preset of another kind of model.
        """
        ...

    def tensors(self) -> dict[str, Array]:
        """What a model file holds beside skeleton and motion, by name."""
        ...

    def header(self) -> dict[str, Any]:
        """What its file's header says beside kind, preset, data hash and metrics, as JSON."""
        ...
