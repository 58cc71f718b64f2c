"""A scene to a picture: all splat performers in one pass, fields at preview size, the room behind.

Splats hide each other rightly, sample by sample. A field performer is a layer of its own, sorted by
the distance of its pelvis: right unless people embrace.
"""

from __future__ import annotations

from collections.abc import Sequence as Many
from dataclasses import replace
from weakref import WeakKeyDictionary

import numpy as np

from renderer.model import PersonModel
from renderer.splats.compose import SplatRenderer
from renderer.splats.layout import PARAMETERS, ROTATION
from renderer.splats.model import SplatModel
from scene.arrays import Array, Float, UInt8
from scene.camera import Camera, orbit_camera
from scene.colour import to_srgb
from scene.environment import Environment, Performer, Scene
from scene.lighting import HARMONICS, Lighting
from scene.motion import Motion, Pose
from scene.skeleton import JOINT_COUNT, Skeleton

FIELD_PREVIEW_PX = 128
"""Longest side at which a field performer is rendered live; the layer is then enlarged."""
_ANKLES = (7, 8)
_SHADOW_RADIUS_M = 0.22
_FOOT_CLEARANCE_M = 0.35
"""Height of an ankle above the floor at which its contact shadow has vanished."""


class Stage:
    """Renders scenes into buffers that it keeps; one stage belongs to one thread."""

    def __init__(self) -> None:
        self._models: tuple[SplatModel, ...] = ()
        self._splats: SplatRenderer | None = None
        self._blank = np.zeros((0, 0, 4), np.float32)
        self._picture = np.zeros((0, 0, 3), np.uint8)

    def render(self, scene: Scene[PersonModel], camera: Camera) -> UInt8[Array, "H W 3"]:
        """sRGB bytes of `scene` seen by `camera`; the buffer is reused by the next call."""
        size = (camera.height, camera.width)
        if self._picture.shape[:2] != size:
            self._picture = np.zeros((*size, 3), np.uint8)
            self._blank = np.zeros((*size, 4), np.float32)
        layers = self._layers(scene, camera)
        _put_behind(self._picture, layers, camera, scene)
        return self._picture

    def _layers(self, scene: Scene[PersonModel], camera: Camera) -> Float[Array, "H W 4"]:
        """All performers, premultiplied, nothing behind them."""
        performers, lighting = scene.performers, scene.environment.lighting
        splats = [p for p in performers if isinstance(p.model, SplatModel)]
        fields = [p for p in performers if not isinstance(p.model, SplatModel)]
        layers = [(_distance(p, camera), _field_layer(p, camera)) for p in fields]
        if splats:
            nearest = min(_distance(p, camera) for p in splats)
            layers.append((nearest, self._splat_layer(splats, camera, lighting)))
        if len(layers) == 1:
            return layers[0][1]
        blended = self._blank.copy()
        for _, layer in sorted(layers, key=lambda item: -item[0]):
            blended = layer + (1.0 - layer[..., 3:]) * blended
        return blended

    def _splat_layer(
        self,
        performers: Many[Performer[PersonModel]],
        camera: Camera,
        lighting: Lighting | None,
    ) -> Float[Array, "H W 4"]:
        models = tuple(p.model for p in performers if isinstance(p.model, SplatModel))
        if self._splats is None or models != self._models:
            self._models, self._splats = models, SplatRenderer(models)
        transforms = [p.placement @ _skinning(p) for p in performers]
        return self._splats.render(camera, transforms, lighting)


def warm_up() -> None:
    """Load (or, the first time on a machine, compile) every kernel that a live view needs.

    Fields are drawn by one torch thread from then on: on shared cores small operations
    lose more by waiting for each other than a second thread brings.
    """
    import torch

    from renderer.yuv_kernels import to_yuv420

    torch.set_num_threads(1)
    row = np.zeros((1, PARAMETERS), np.float32)
    row[0, ROTATION] = 1.0
    rest = Pose.rest()
    model: PersonModel = SplatModel(
        row,
        np.zeros((1, 4), np.uint8),
        np.array([[1.0, 0.0, 0.0, 0.0]], np.float32),
        np.ones(1, bool),
        Skeleton(np.zeros((JOINT_COUNT, 3))),
        Motion.from_poses([rest]),
        data_hash="",
    )
    somebody = Performer("", model, np.zeros(3), 0.0, rest)
    camera = orbit_camera((0.0, 0.0, 0.0), 2.0, 0.0, 0.1, 32, 32)
    dark = Lighting(np.zeros((HARMONICS, 3)), np.array([0.0, 1.0, 0.0]), np.zeros(3))
    place = Environment(panorama=np.zeros((8, 16, 3), np.float32), lighting=dark)
    Stage().render(Scene(place, (somebody,)), camera)
    picture = Stage().render(Scene(Environment(), (somebody,)), camera)
    luma, chroma = np.zeros((32, 32), np.uint8), np.zeros((2, 16, 16), np.uint8)
    to_yuv420(picture, luma, *chroma)


def _put_behind(
    out: UInt8[Array, "H W 3"],
    layers: Float[Array, "H W 4"],
    camera: Camera,
    scene: Scene[PersonModel],
) -> None:
    """Write the performers over the room that they are in."""
    environment, shadows = scene.environment, contact_shadows(scene.environment, scene.performers)
    view = (camera.intrinsics, camera.rotation, camera.position)
    if environment.panorama is None:
        from renderer.backdrop_kernels import compose

        colours = np.array([environment.horizon, environment.zenith, environment.floor], np.float32)
        compose(out, layers, *view, colours, shadows)
    else:
        from renderer.panorama_kernels import compose_panorama

        compose_panorama(out, layers, *view, panorama_picture(environment), shadows)


def panorama_picture(environment: Environment) -> Float[Array, "h _ 3"]:
    """The environment's panorama in sRGB, its first column once more at the end; made once."""
    if environment not in _PICTURES:
        assert environment.panorama is not None
        shown = to_srgb(environment.panorama).astype(np.float32)
        _PICTURES[environment] = np.concatenate([shown, shown[:, :1]], axis=1)
    return _PICTURES[environment]


_PICTURES: WeakKeyDictionary[Environment, Float[Array, "h w 3"]] = WeakKeyDictionary()


def contact_shadows(
    environment: Environment, performers: Many[Performer[PersonModel]]
) -> Float[Array, "S 4"]:
    """x, z, radius (m) and strength of the soft shadow under each ankle."""
    rows = []
    for performer in performers:
        skeleton = performer.model.skeleton
        ankles = (performer.placement @ _joints(performer))[list(_ANKLES), :3, 3]
        rest_height = skeleton.rest_joints[list(_ANKLES), 1]
        for ankle, rest in zip(ankles, rest_height, strict=True):
            lifted = max(0.0, float(ankle[1] - rest)) / _FOOT_CLEARANCE_M
            strength = environment.shadow_strength * max(0.0, 1.0 - lifted)
            rows.append((ankle[0], ankle[2], _SHADOW_RADIUS_M * (1.0 + lifted), strength))
    return np.array(rows, np.float32).reshape(-1, 4)


def _joints(performer: Performer[PersonModel]) -> Float[Array, "K 4 4"]:
    pose = performer.pose
    return performer.model.skeleton.joint_transforms(pose.joint_angles, pose.root_translation)


def _skinning(performer: Performer[PersonModel]) -> Float[Array, "K 4 4"]:
    pose = performer.pose
    return performer.model.skeleton.skinning_transforms(pose.joint_angles, pose.root_translation)


def _distance(performer: Performer[PersonModel], camera: Camera) -> float:
    pelvis = (performer.placement @ _joints(performer)[0])[:3, 3]
    return float(np.linalg.norm(pelvis - camera.position))


def _field_layer(performer: Performer[PersonModel], camera: Camera) -> Float[Array, "H W 4"]:
    """The performer's field at preview size, enlarged to the camera's."""
    import torch

    scale = min(1.0, FIELD_PREVIEW_PX / max(camera.width, camera.height))
    small = camera.resized(
        max(1, round(camera.width * scale)), max(1, round(camera.height * scale))
    )
    inside = np.vstack([small.world_to_camera, [0.0, 0.0, 0.0, 1.0]]) @ performer.placement
    layer = performer.model.render(replace(small, world_to_camera=inside[:3]), performer.pose)
    enlarged = torch.nn.functional.interpolate(
        torch.from_numpy(np.ascontiguousarray(layer)).permute(2, 0, 1)[None],
        size=(camera.height, camera.width),
        mode="bilinear",
        align_corners=False,
    )
    return enlarged[0].permute(1, 2, 0).contiguous().numpy()
