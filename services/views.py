"""Renders one view of a model for a request: camera and pose in, an encoded picture out."""

from __future__ import annotations

import math
from typing import Literal

import cv2
import numpy as np

from renderer.performer_model import PerformerModel
from renderer.splats.model import SplatModel
from renderer.splats.rasteriser.renderer import Geometry
from scene.arrays import Array, Float
from scene.camera import Camera
from scene.checks import require_shape
from scene.errors import InvalidInput
from scene.expression import EXPRESSION_COUNT
from scene.motion import Motion, Pose
from scene.skeleton import JOINT_COUNT, Skeleton
from services.api.view_shapes import NewView, Orbit, ViewCamera, ViewPose
from services.person_view import person_camera
from services.synthetic import mark_picture

_ENCODERS = {
    "png": (".png", [cv2.IMWRITE_PNG_COMPRESSION, 4]),
    "jpeg": (".jpg", [cv2.IMWRITE_JPEG_QUALITY, 92]),
    "webp": (".webp", [cv2.IMWRITE_WEBP_QUALITY, 92]),
}
_SOLID = 0.5
"""Alpha from which a pixel has a depth."""
MEDIA_TYPES = {"png": "image/png", "jpeg": "image/jpeg", "webp": "image/webp"}


def render_view(model: PerformerModel, motion: Motion, asked: NewView) -> bytes:
    """The picture that `asked` describes. Raises InvalidInput for a bad camera or pose, and for
    what the model can't tell."""
    pose = view_pose(motion, asked)
    shown = motion if asked.pose is None else Motion.from_poses([pose])
    camera = view_camera(model.skeleton, shown, pose, asked.camera, asked.width, asked.height)
    if asked.hide_unseen:
        model = model.filmed_parts()
    if asked.shows == "colour":
        return encode(model.render(camera, pose), asked.background, asked.format)
    if asked.format != "png" or asked.background is not None:
        raise InvalidInput(
            f"{asked.shows} must be asked for as png without a background, which keeps every bit; "
            f"got {asked.format}{'' if asked.background is None else ' with a background'}"
        )
    splats = _splats(model, asked.shows, "whose surface is known")
    return _encode_geometry(splats.geometry(camera, pose), asked.shows)


def view_pose(motion: Motion, asked: NewView) -> Pose:
    """The pose given, or the motion's at the moment asked for."""
    if asked.pose is not None:
        return _own_pose(asked.pose)
    return motion.pose_at(asked.time_s if asked.time_s is not None else float(motion.times_s[0]))


def view_camera(
    skeleton: Skeleton, motion: Motion, pose: Pose, asked: ViewCamera, width: int, height: int
) -> Camera:
    """The camera given by matrices, or on its orbit round the person in a `pose` of `motion`."""
    if asked.intrinsics is not None or asked.world_to_camera is not None:
        if asked.intrinsics is None or asked.world_to_camera is None or asked.orbit is not None:
            raise InvalidInput(
                "camera must be an orbit, or intrinsics and world_to_camera together; got "
                f"{sorted(asked.model_dump(exclude_none=True))}; leave one of the two out"
            )
        intrinsics = _array("intrinsics", asked.intrinsics, (3, 3))
        world_to_camera = _array("world_to_camera", asked.world_to_camera, (3, 4))
        return Camera(intrinsics, world_to_camera, width, height)
    orbit = asked.orbit or Orbit()
    return person_camera(
        skeleton,
        motion,
        pose,
        azimuth_deg=orbit.azimuth_deg,
        elevation_deg=orbit.elevation_deg,
        distance_m=orbit.distance_m,
        width=width,
        height=height,
        fov_y_rad=math.radians(asked.fov_deg),
    )


def encode(
    picture: Float[Array, "H W 4"], background: tuple[float, float, float] | None, kind: str
) -> bytes:
    """An encoded picture of premultiplied RGBA, marked as synthetic.

    A JPEG, which has no alpha, lies on white.
    """
    alpha = picture[..., 3:]
    if background is None and kind == "jpeg":
        background = (1.0, 1.0, 1.0)
    if background is not None:
        flat = picture[..., :3] + (1.0 - alpha) * np.asarray(background, dtype=np.float32)
        pixels = flat[..., ::-1]
    else:
        straight = picture[..., :3] / np.maximum(alpha, 1e-6)
        pixels = np.concatenate([straight[..., ::-1], alpha], axis=-1)
    data = (np.clip(pixels, 0.0, 1.0) * 255.0 + 0.5).astype(np.uint8)
    return _encode(data, kind)


def _encode(pixels: Array, kind: str) -> bytes:
    suffix, options = _ENCODERS[kind]
    encoded = cv2.imencode(suffix, np.ascontiguousarray(pixels), options)[1].tobytes()
    return mark_picture(encoded, pixels.shape[1], pixels.shape[0])


def _splats(model: PerformerModel, asked: str, why: str) -> SplatModel:
    if model.splats is None:
        raise InvalidInput(
            f"{asked} must be asked of a model of splats, {why}; got preset {model.preset!r}; "
            "leave it out"
        )
    return model.splats


def _encode_geometry(geometry: Geometry, shows: Literal["depth", "normal"]) -> bytes:
    """A PNG of depth, mm, or of normals, where the person hides more than shines through."""
    alpha = geometry.alpha
    solid = alpha > _SOLID
    if shows == "depth":
        depth = np.where(solid, geometry.depth / np.maximum(alpha, _SOLID), 0.0)
        pixels = np.clip(1000.0 * depth + 0.5, 0, 65535).astype(np.uint16)
    else:
        length = np.linalg.norm(geometry.normal, axis=2, keepdims=True)
        shown = 0.5 + 0.5 * geometry.normal / np.maximum(length, 1e-6)
        colours = np.concatenate([shown[..., ::-1], solid[..., None]], axis=2)
        pixels = (255.0 * colours * solid[..., None] + 0.5).astype(np.uint8)
    return _encode(pixels, "png")


def _own_pose(asked: ViewPose) -> Pose:
    return Pose(
        _array("joint_angles", asked.joint_angles, (JOINT_COUNT, 3)),
        _array("root_translation", asked.root_translation, (3,)),
        expression=_array("expression", asked.expression, (EXPRESSION_COUNT,)),
    )


def _array(name: str, value: list, shape: tuple[int, ...]) -> Array:
    try:
        array = np.asarray(value, dtype=np.float64)
    except ValueError as error:
        raise InvalidInput(f"{name} must be a full matrix; got rows of unequal length") from error
    require_shape(name, array, shape)
    return array
