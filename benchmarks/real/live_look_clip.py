"""A few seconds of a webcam's frames, the model alone and with live look, as the view turns."""

from __future__ import annotations

from collections.abc import Sequence as Many
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from benchmarks.real.sheet import over_white, turned
from renderer.splats.model import SplatModel
from renderer.splats.rasteriser.renderer import SplatRenderer
from scene.arrays import Array, Float, UInt8
from scene.camera import Camera
from scene.live_appearance import LiveAppearance
from scene.motion import Pose

FARTHEST_DEG = 40.0
"""Beside the webcam, in the middle of the clip; it begins and ends at the webcam."""
_CELL_PX = (240, 320)
"""Width and height."""
_BAND_PX = 22
_QUALITY = 55
_CAPTIONS = ("webcam", "model alone", "live look")


@dataclass(frozen=True, eq=False)
class PlayedFrame:
    """A frame that played, and what live look made of it."""

    image: UInt8[Array, "H W 3"]
    """sRGB, as it was filmed."""
    camera: Camera
    """Of the image, in the world of `pose`."""
    pose: Pose
    appearance: LiveAppearance


def draw_clip(path: Path, model: SplatModel, played: Many[PlayedFrame], rate_hz: float) -> None:
    """Write an animated WebP of all `played`: the frame, and the model from ever farther beside."""
    renderer = SplatRenderer((model.filmed_parts(),))
    turns = FARTHEST_DEG * np.sin(np.pi * np.linspace(0.0, 1.0, len(played)))
    middle = np.median([_middle(model, one) for one in played], axis=0)
    animation = cv2.Animation()
    animation.frames = [
        _cells(renderer, model, one, float(degrees), middle)[..., ::-1].copy()
        for one, degrees in zip(played, turns, strict=True)
    ]
    animation.durations = [round(1e3 / rate_hz)] * len(played)
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwriteanimation(str(path), animation, [cv2.IMWRITE_WEBP_QUALITY, _QUALITY])


def _middle(model: SplatModel, one: PlayedFrame) -> Float[Array, "2"]:
    """Where the pelvis is in the picture, px."""
    pelvis = model.skeleton.rest_joints[0] + one.pose.root_translation
    return one.camera.project(pelvis[None])[0][0]


def _cells(
    renderer: SplatRenderer,
    model: SplatModel,
    one: PlayedFrame,
    degrees: float,
    middle: Float[Array, "2"],
) -> UInt8[Array, "_ _ 3"]:
    """The frame, the model alone and with live look, each with its caption."""
    height, pose = one.image.shape[0], one.pose
    width = round(height * _CELL_PX[0] / _CELL_PX[1])
    left = int(np.clip(middle[0] - 0.5 * width, 0, one.image.shape[1] - width))
    view = turned(one.camera.cropped(left, 0, width, height), pose, model, np.radians(degrees))
    transforms = model.skeleton.skinning_transforms(pose.joint_angles, pose.root_translation)
    pictures = [one.image[:, left : left + width] / np.float32(255.0)]
    for appearance in (None, one.appearance):
        drawn = renderer.render(
            view, [transforms], expressions=[pose.expression], appearances=[appearance]
        )
        pictures.append(over_white(drawn))
    cells = [
        _captioned(name if picture is pictures[0] else f"{name}, {degrees:.0f} deg", picture)
        for name, picture in zip(_CAPTIONS, pictures, strict=True)
    ]
    return np.concatenate(cells, axis=1)


def _captioned(text: str, picture: Float[Array, "H W 3"]) -> UInt8[Array, "_ _ 3"]:
    """`picture` at the size of a cell, above `text`."""
    pixels = (255.0 * np.clip(picture, 0.0, 1.0) + 0.5).astype(np.uint8)
    small = np.asarray(cv2.resize(pixels, _CELL_PX, interpolation=cv2.INTER_AREA))
    band = np.full((_BAND_PX, _CELL_PX[0], 3), 255, np.uint8)
    font, place = cv2.FONT_HERSHEY_SIMPLEX, (6, _BAND_PX - 7)
    cv2.putText(band, text, place, font, 0.45, (0, 0, 0), 1, cv2.LINE_AA)
    return np.concatenate([small, band])
