"""A scene to a picture: all splat performers in one pass, fields at preview size, over the
background.

While the camera rests, only those blocks of 16 x 16 px are redrawn in which a performer or a shadow
is or was: the others are still in the buffer.

Splats occlude each other correctly. A field performer is a layer of its own, sorted by
the distance of its pelvis: correct unless people embrace.
"""

from __future__ import annotations

from collections.abc import Sequence as Many
from dataclasses import replace
from weakref import WeakKeyDictionary

import numpy as np

from renderer.performer_model import PerformerModel
from renderer.splats.cloth.hanging import ClothSwing
from renderer.splats.cloth.tubes import Tubes
from renderer.splats.layout import NEAR_M, OPACITY, PARAMETERS, ROTATION, TILE
from renderer.splats.levels.detail import ViewDetail
from renderer.splats.levels.tree import LevelTree, tree_soon
from renderer.splats.model import SplatModel
from renderer.splats.rasteriser.renderer import Geometry, SplatRenderer
from scene.arrays import Array, Bool, Float, UInt8
from scene.camera import Camera, orbit_camera
from scene.colour import to_srgb
from scene.environment import Environment, Performer, Scene
from scene.errors import InvalidInput
from scene.expression import BLEND_SHAPE_COUNT
from scene.lighting import HARMONICS, Lighting
from scene.live_appearance import LiveAppearance
from scene.motion import Motion, Pose
from scene.skeleton import HEAD, JOINT_COUNT, Skeleton

FIELD_PREVIEW_PX = 128
"""Longest side at which a field performer is rendered live; the layer is then enlarged."""
_ANKLES = (7, 8)
_SHADOW_RADIUS_M = 0.22
_FOOT_CLEARANCE_M = 0.35
"""Height of an ankle above the floor at which its contact shadow has vanished."""
_HEAD_M = 0.6
"""Whose head is so near to the camera is not drawn: it looks through their eyes, or from a little
behind them (`services.arrangement`), however they lean. As OWN_HEAD_M of
client/src/splats/ownHead.ts."""
_FAINTEST_SHADOW = 1.0 / 1024.0
"""Darkness that changes no byte."""


class SceneRenderer:
    """Renders scenes into buffers that it keeps; for one thread.

    `detail` chooses how many splats each person is drawn by; None: all that they have.
    """

    def __init__(self, detail: ViewDetail | None = None) -> None:
        self._detail = detail
        self._models: tuple[SplatModel, ...] = ()
        self._splats: SplatRenderer | None = None
        self._swings: dict[tuple[int, str, int], ClothSwing] = {}
        """Loose clothes of whom was drawn last: by model, name, and how many there were of it."""
        self._empty = np.zeros((0, 0, 4), np.float32)
        self._picture = np.zeros((0, 0, 3), np.uint8)
        self._background: tuple[Environment, Camera] | None = None
        """Environment and camera of the background in the buffer."""
        self._occupied = np.zeros((0, 0), bool)
        """Blocks of the last picture that hold more than background."""
        self.changed: Bool[Array, "bH bW"] = self._occupied
        """Blocks of 16 x 16 px in which the last picture may differ from the one before."""

    def render(self, scene: Scene[PerformerModel], camera: Camera) -> UInt8[Array, "H W 3"]:
        """sRGB bytes of `scene` seen by `camera`; the buffer is reused by the next call."""
        size = (camera.height, camera.width)
        if self._picture.shape[:2] != size:
            self._picture = np.zeros((*size, 3), np.uint8)
            self._empty = np.zeros((*size, 4), np.float32)
            self._background = None
        layers = self._layers(scene, camera)
        shadows = contact_shadows(scene.environment, scene.performers)
        occupied = self._blocks(scene, camera) | shadow_blocks(shadows, camera)
        self.changed = (
            occupied | self._occupied
            if self._has_background(scene, camera)
            else np.ones_like(occupied)
        )
        _composite_background(
            self._picture, layers, camera, scene.environment, shadows, self.changed
        )
        self._background, self._occupied = (scene.environment, camera), occupied
        return self._picture

    def geometry(self, scene: Scene[PerformerModel], camera: Camera) -> Geometry:
        """How far away the performers of `scene` are and how their surfaces lie, seen by `camera`.

        Raises InvalidInput for performers who are fields: these are pictures alone.
        """
        if fields := [p.name for p in scene.performers if p.model.splats is None]:
            raise InvalidInput(
                f"geometry must be asked of performers who are splats; got {fields[0]!r}, who is a "
                "field; train them with a preset of splats"
            )
        if not scene.performers:
            size = (camera.height, camera.width)
            return Geometry(np.zeros(size), np.zeros((*size, 3)), np.zeros(size))
        self._splat_layer(scene.performers, camera, None)
        assert self._splats is not None
        return self._splats.geometry([_skinning_transforms(p) for p in scene.performers])

    def _has_background(self, scene: Scene[PerformerModel], camera: Camera) -> bool:
        """Whether the buffer holds this scene's background from this camera."""
        if self._background is None:
            return False
        environment, before = self._background
        return environment is scene.environment and (
            np.array_equal(before.world_to_camera, camera.world_to_camera)
            and np.array_equal(before.intrinsics, camera.intrinsics)
        )

    def _blocks(self, scene: Scene[PerformerModel], camera: Camera) -> Bool[Array, "bH bW"]:
        """Blocks that performers may cover; all of them for fields."""
        blocks = np.zeros((-(-camera.height // TILE), -(-camera.width // TILE)), bool)
        for performer in scene.performers:
            if performer.model.splats is None:
                return np.ones_like(blocks)
        return self._splats.tiles if self._splats and scene.performers else blocks

    def _layers(self, scene: Scene[PerformerModel], camera: Camera) -> Float[Array, "H W 4"]:
        """All performers, premultiplied, nothing behind them."""
        performers = [p for p in scene.performers if not _inside_head(p, camera)]
        lighting = scene.environment.lighting
        splats = [p for p in performers if p.model.splats is not None]
        fields = [p for p in performers if p.model.splats is None]
        if splats and not fields:
            return self._splat_layer(splats, camera, lighting)
        layers = [(_distance(p, camera), _field_layer(p, camera)) for p in fields]
        if splats:
            nearest = min(_distance(p, camera) for p in splats)
            layers.append((nearest, self._splat_layer(splats, camera, lighting)))
        if len(layers) == 1:
            return layers[0][1]
        blended = self._empty.copy()
        for _, layer in sorted(layers, key=lambda item: -item[0]):
            blended = layer + (1.0 - layer[..., 3:]) * blended
        return blended

    def _splat_layer(
        self,
        performers: Many[Performer[PerformerModel]],
        camera: Camera,
        lighting: Lighting | None,
    ) -> Float[Array, "H W 4"]:
        whole = [model for p in performers if (model := p.model.splats) is not None]
        levels = [None if self._detail is None else tree_soon(model) for model in whole]
        pairs = list(zip(whole, levels, strict=True))
        models = tuple(model if tree is None else tree.nodes for model, tree in pairs)
        if self._splats is None or models != self._models:
            from renderer.splats.rasteriser.gpu import splat_renderer

            self._models, self._splats = models, splat_renderer(models)
        if self._detail is not None:
            heights = [_height_px(p, camera) for p in performers]
            self._splats.draw_only(self._detail.drawn(pairs, heights))
        transforms, placements = (
            [_skinning_transforms(p) for p in performers],
            [p.placement for p in performers],
        )
        shown = [p.pose.expression for p in performers]
        looks = [
            p.appearance if p.appearance is None or tree is None else _spread(p.appearance, tree)
            for p, tree in zip(performers, levels, strict=True)
        ]
        hung = self._hung(performers, transforms)
        return self._splats.render(camera, transforms, lighting, placements, shown, looks, hung)

    def _hung(
        self, performers: Many[Performer[PerformerModel]], transforms: Many[Float[Array, "K 4 4"]]
    ) -> list[Float[Array, "V 3"] | None]:
        """How everybody's loose clothes hang now; those of others are forgotten."""
        swings, hung = dict[tuple[int, str, int], ClothSwing](), list[Float[Array, "V 3"] | None]()
        for performer, posed in zip(performers, transforms, strict=True):
            model = performer.model.splats
            if model is None or model.cloth is None:
                hung.append(None)
                continue
            alike = sum(key[:2] == (id(model), performer.name) for key in swings)
            key = (id(model), performer.name, alike)
            swings[key] = self._swings.get(key) or ClothSwing(model.cloth)
            hung.append(swings[key].hung(posed, performer.pose.time_s))
        self._swings = swings
        return hung


def _spread(appearance: LiveAppearance, tree: LevelTree) -> LiveAppearance:
    """Of the splats of all levels."""
    laid = appearance.laid_picture
    return LiveAppearance(
        tree.spread(appearance.change),
        None if laid is None else replace(laid, places=tree.spread(laid.places)),
    )


def warm_up() -> None:
    """Load (or, the first time on a machine, compile) every kernel that a live view needs.

    Fields are drawn by one torch thread from then on: on shared cores small operations
    lose more by waiting for each other than a second thread brings.
    """
    import torch

    from renderer.compositing.yuv_kernels import to_yuv420
    from renderer.live_look.live_look import LiveLook
    from renderer.live_look.picture import WebcamPicture
    from renderer.splats.levels.level_kernels import average_upwards

    torch.set_num_threads(1)
    row = np.zeros((1, PARAMETERS), np.float32)
    row[0, ROTATION], row[0, OPACITY] = 1.0, 4.0
    rest = Pose.rest()
    model = SplatModel(
        row,
        np.zeros((1, 4), np.uint8),
        np.array([[1.0, 0.0, 0.0, 0.0]], np.float32),
        np.ones(1, bool),
        Skeleton(np.zeros((JOINT_COUNT, 3))),
        Motion.from_poses([rest]),
        data_hash="",
        expression_splats=np.zeros(1, np.int32),
        expression_offsets=np.zeros((1, BLEND_SHAPE_COUNT, 3)),
    )
    performer: Performer[PerformerModel] = Performer("", model, np.zeros(3), 0.0, rest)
    camera = orbit_camera((0.0, 0.0, 0.0), 2.0, 0.0, 0.1, 32, 32)
    dark = Lighting(np.zeros((HARMONICS, 3)), np.array([0.0, 1.0, 0.0]), np.zeros(3))
    place = Environment(panorama=np.zeros((8, 16, 3), np.float32), lighting=dark)
    SceneRenderer().render(Scene(place, (performer,)), camera)
    dressed = replace(performer, model=_in_loose_clothes(model))
    SceneRenderer().render(Scene(Environment(), (dressed,)), camera)
    stage = SceneRenderer()
    picture = stage.render(Scene(Environment(), (performer,)), camera)
    luma, chroma = np.zeros((32, 32), np.uint8), np.zeros((2, 16, 16), np.uint8)
    to_yuv420(picture, stage.changed, luma, *chroma)
    look, seen = LiveLook(model), WebcamPicture(picture, luma, camera, rest)
    appearance = look.take_colours(seen, look.align(seen))
    now = replace(performer, appearance=appearance)
    SceneRenderer().render(Scene(Environment(), (now, now)), camera)
    change = appearance.change
    average_upwards(change, np.zeros(0, np.int32), np.zeros(0, np.float32), len(change))


def _in_loose_clothes(model: SplatModel) -> SplatModel:
    """`model` with its splats on the smallest piece of cloth."""
    cloth = Tubes(
        np.random.default_rng(0).normal(size=(6, 3)),
        np.array([[0, 0, 2, 3]], np.int64),
        np.array([[[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]]]),
        np.zeros((1, 2), np.int64),
        np.ones(1),
        np.zeros(1, np.int64),
        np.ones(3),
    )
    return replace(model, cloth=cloth, quads=np.zeros(len(model), np.int32))


def _composite_background(
    out: UInt8[Array, "H W 3"],
    layers: Float[Array, "H W 4"],
    camera: Camera,
    environment: Environment,
    shadows: Float[Array, "S 4"],
    drawn: Bool[Array, "bH bW"],
) -> None:
    """Composite the performers over the background, in the blocks `drawn`."""
    view = (camera.intrinsics, camera.rotation, camera.position)
    if environment.panorama is None:
        from renderer.compositing.backdrop_kernels import compose

        colours = np.array([environment.horizon, environment.zenith, environment.floor], np.float32)
        compose(out, layers, *view, colours, shadows, drawn)
    else:
        from renderer.compositing.panorama_kernels import compose_panorama

        compose_panorama(out, layers, *view, panorama_picture(environment), shadows, drawn)


def panorama_picture(environment: Environment) -> Float[Array, "h _ 3"]:
    """The environment's panorama in sRGB, its first column once more at the end; made once."""
    if environment not in _PICTURES:
        assert environment.panorama is not None
        shown = to_srgb(environment.panorama).astype(np.float32)
        _PICTURES[environment] = np.concatenate([shown, shown[:, :1]], axis=1)
    return _PICTURES[environment]


_PICTURES: WeakKeyDictionary[Environment, Float[Array, "h w 3"]] = WeakKeyDictionary()


def contact_shadows(
    environment: Environment, performers: Many[Performer[PerformerModel]]
) -> Float[Array, "S 4"]:
    """x, z, radius (m) and strength of the soft shadow under each ankle."""
    rows = []
    for performer in performers:
        for joint in _ANKLES:
            ankle = _joint_position(performer, joint)
            rest = performer.model.skeleton.rest_joints[joint, 1]
            lifted = max(0.0, float(ankle[1] - rest)) / _FOOT_CLEARANCE_M
            strength = environment.shadow_strength * max(0.0, 1.0 - lifted)
            rows.append((ankle[0], ankle[2], _SHADOW_RADIUS_M * (1.0 + lifted), strength))
    return np.array(rows, np.float32).reshape(-1, 4)


def shadow_blocks(shadows: Float[Array, "S 4"], camera: Camera) -> Bool[Array, "bH bW"]:
    """Blocks of 16 x 16 px in which a shadow changes a byte: those round the square it lies in."""
    blocks = np.zeros((-(-camera.height // TILE), -(-camera.width // TILE)), bool)
    for x, z, radius, strength in shadows:
        if strength < _FAINTEST_SHADOW:
            continue
        reach = radius * np.sqrt(np.log(strength / _FAINTEST_SHADOW))
        corners = np.array([(x + a, 0.0, z + b) for a in (-reach, reach) for b in (-reach, reach)])
        seen = corners @ camera.rotation.T + camera.world_to_camera[:, 3]
        if seen[:, 2].max() < NEAR_M:
            continue
        if seen[:, 2].min() < NEAR_M:
            return np.ones_like(blocks)
        points = seen @ camera.intrinsics.T
        tiles = points[:, :2] / (points[:, 2:] * TILE)
        left, top = np.maximum(tiles.min(axis=0), 0.0).astype(int)
        right, bottom = np.maximum(tiles.max(axis=0) + 1.0, 0.0).astype(int)
        blocks[top:bottom, left:right] = True
    return blocks


def _skinning_transforms(performer: Performer[PerformerModel]) -> Float[Array, "K 4 4"]:
    """Skinning transforms, rest -> room; computed once for all viewers of this pose."""
    from scene.kinematics_kernels import skinning

    if performer not in _TRANSFORMS:
        skeleton, pose = performer.model.skeleton, performer.pose
        # copies: kernels compile anew for arrays of another memory layout
        rest, angles = np.array(skeleton.rest_joints), np.array(pose.joint_angles)
        _TRANSFORMS[performer] = skinning(
            angles,
            rest[0] + pose.root_translation,
            rest,
            np.array(skeleton.parents),
            performer.placement,
        )
    return _TRANSFORMS[performer]


_TRANSFORMS: WeakKeyDictionary[Performer[PerformerModel], Float[Array, "K 4 4"]] = (
    WeakKeyDictionary()
)


def _joint_position(performer: Performer[PerformerModel], joint: int) -> Float[Array, "3"]:
    """Where a joint is in the room, m."""
    transforms = _skinning_transforms(performer)[joint]
    return transforms[:3, :3] @ performer.model.skeleton.rest_joints[joint] + transforms[:3, 3]


def _inside_head(performer: Performer[PerformerModel], camera: Camera) -> bool:
    """Whether `camera` looks through the eyes of a performer."""
    return float(np.linalg.norm(_joint_position(performer, HEAD) - camera.position)) < _HEAD_M


def _distance(performer: Performer[PerformerModel], camera: Camera) -> float:
    return float(np.linalg.norm(_joint_position(performer, 0) - camera.position))


def _height_px(performer: Performer[PerformerModel], camera: Camera) -> float:
    """How high somebody who stood upright there would be in the picture."""
    distance = max(_distance(performer, camera), _HEAD_M)
    return float(camera.intrinsics[1, 1]) * performer.model.skeleton.height_m / distance


def _field_layer(performer: Performer[PerformerModel], camera: Camera) -> Float[Array, "H W 4"]:
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
