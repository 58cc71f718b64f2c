"""Overlays: silhouette, box, skeleton and fitted surface drawn over the frames.

White box and magenta outline: the person's mask. Green outline: the fitted body. They lie on each
other where the capture went well. Left limbs are orange, right limbs blue.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from types import MappingProxyType

import av
import cv2
import numpy as np

from scene.arrays import Array, Float, UInt8
from scene.body import Body
from scene.camera import Camera
from scene.motion import Pose
from scene.sequence import Frame, Sequence
from scene.skeleton import JOINT_NAMES, PARENTS

_LEFT, _RIGHT, _MIDDLE = (255, 140, 30), (40, 160, 255), (255, 240, 120)
_SURFACE, _SILHOUETTE, _BOX = (60, 255, 120), (255, 60, 220), (255, 255, 255)
_SUPERSAMPLING = 4
"""Supersampling of the drawn surface."""


def draw_overlay(frame: Frame, body: Body) -> UInt8[Array, "H W 3"]:
    """sRGB picture of `frame` with the mask's box and outline, skeleton and posed surface."""
    picture = np.ascontiguousarray((np.clip(frame.image, 0.0, 1.0) * 255.0).astype(np.uint8))
    _outline(picture, (frame.mask > 0.5).astype(np.uint8), _SILHOUETTE)
    covered = surface_mask(frame, body)
    if covered is not None:
        _outline(picture, covered, _SURFACE)
    rows, columns = np.nonzero(frame.mask > 0.5)
    if len(rows):
        corners = [(int(columns.min()), int(rows.min())), (int(columns.max()), int(rows.max()))]
        cv2.rectangle(picture, corners[0], corners[1], _BOX, 1)
    _draw_skeleton(picture, frame, body)
    return picture


def surface_mask(frame: Frame, body: Body) -> UInt8[Array, "H W"] | None:
    """1 where the posed surface covers a pixel; None for a body without a surface."""
    if body.faces is None:
        return None
    return project_surface(frame.camera, body, frame.pose)


def project_surface(camera: Camera, body: Body, pose: Pose) -> UInt8[Array, "H W"]:
    """1 where `body` in `pose` covers most of a pixel of `camera`; the body needs a surface."""
    covered = np.zeros(
        (_SUPERSAMPLING * camera.height, _SUPERSAMPLING * camera.width), dtype=np.uint8
    )
    pixels, depth = camera.project(body.posed_vertices(pose))
    assert body.faces is not None  # posed_vertices has refused a body without
    whole = (depth[body.faces] > 0.05).all(axis=1)
    corners = _SUPERSAMPLING * pixels[body.faces[whole]] - 0.5  # cv2 counts from pixel centres
    scaled = np.round(np.clip(corners, -16000, 32000) * 16.0).astype(np.int32)
    for triangle in scaled:
        cv2.fillConvexPoly(covered, triangle, 1, shift=4)
    # a polygon is drawn with all that its edge touches: finer pixels leave little of that
    share = cv2.resize(255 * covered, (camera.width, camera.height), interpolation=cv2.INTER_AREA)
    return np.greater(share, 127).astype(np.uint8)


def write_overlay_video(sequence: Sequence, path: Path) -> None:
    """An MP4 of all training frames with their overlays, at the sequence's own rate."""
    frames = (
        draw_overlay(sequence.frame(index), sequence.body) for index in range(len(sequence.train))
    )
    write_video(frames, path, sequence.frames_per_second)


def write_video(
    pictures: Iterable[UInt8[Array, "H W 3"]],
    path: Path,
    frames_per_second: float,
    metadata: Mapping[str, str] = MappingProxyType({}),
) -> None:
    """Write RGB pictures of one size as H264; odd sides lose their last row or column.

    `metadata` is the container's.
    """
    with av.open(str(path), "w") as container:
        container.metadata.update(metadata)
        stream = None
        for picture in pictures:
            even = picture[: picture.shape[0] // 2 * 2, : picture.shape[1] // 2 * 2]
            if stream is None:
                rate = max(1, round(frames_per_second))
                stream = container.add_stream("libx264", rate=rate)
                stream.height, stream.width = even.shape[:2]
                stream.pix_fmt = "yuv420p"
            frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(even), format="rgb24")
            container.mux(stream.encode(frame))
        if stream is not None:
            container.mux(stream.encode())


def _outline(picture: Array, covered: Array, colour: tuple[int, int, int]) -> None:
    outlines, _ = cv2.findContours(covered, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    cv2.drawContours(picture, outlines, -1, colour, 1, cv2.LINE_AA)


def _draw_skeleton(picture: Array, frame: Frame, body: Body) -> None:
    placed = body.skeleton.joint_transforms(frame.pose.joint_angles, frame.pose.root_translation)
    pixels, depth = frame.camera.project(placed[:, :3, 3])
    points: Float[Array, "24 2"] = np.clip(pixels, -4000, 8000).round()
    for joint, parent in enumerate(PARENTS):
        if parent < 0 or min(depth[joint], depth[parent]) <= 0.05:
            continue
        name = JOINT_NAMES[joint]
        colour = _LEFT if "left" in name else _RIGHT if "right" in name else _MIDDLE
        ends = [tuple(int(c) for c in points[j]) for j in (parent, joint)]
        cv2.line(picture, ends[0], ends[1], colour, 2, cv2.LINE_AA)
        cv2.circle(picture, ends[1], 3, colour, -1, cv2.LINE_AA)
