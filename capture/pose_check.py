"""Whether a clip's poses match its pictures, checked before training.

Cameras of another convention, millimetres for metres, frames in another order: all of them project
joints beside the person, and training on them gives fog. The written picture shows the cause.
"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from capture.errors import CaptureError
from capture.overlay import draw_overlay
from capture.sources.video import evenly_spaced
from scene.sequence import Sequence, read_frame

LEAST_ON_MASK = 0.6
"""Share of the joints in sight that must lie on the mask. Right poses reach 0.9 and more."""
_CHECKED_FRAMES = 12
_SHOWN_FRAMES = 4
_SHOWN_PX = 320


def joints_on_mask(sequence: Sequence) -> float:
    """Share of all joints within the training pictures that lie on the person's mask, in frames
    from the whole clip; 0 where no joint is within any picture."""
    hits = []
    for index in map(int, evenly_spaced(len(sequence.train), _CHECKED_FRAMES)):
        pose, mask = sequence.train.pose(index), sequence.train.mask(index)
        transforms = sequence.body.skeleton.joint_transforms(
            pose.joint_angles, pose.root_translation
        )
        pixels, depth = sequence.train.camera(index).project(transforms[..., :3, 3])
        height, width = mask.shape
        inside = (depth > 0.0) & ((pixels >= 0.0) & (pixels < (width, height))).all(axis=1)
        column, row = np.floor(pixels[inside]).astype(int).T
        hits.append(mask[row, column] > 0.5)
    on_mask = np.concatenate(hits)
    return float(on_mask.mean()) if len(on_mask) else 0.0


def write_pose_picture(sequence: Sequence, path: Path) -> None:
    """A few training frames side by side, with masks, skeletons and posed surfaces drawn in."""
    drawn = []
    for index in map(int, evenly_spaced(len(sequence.train), _SHOWN_FRAMES)):
        picture = draw_overlay(read_frame(sequence.train, index), sequence.body)
        width = round(picture.shape[1] * _SHOWN_PX / picture.shape[0])
        drawn.append(cv2.resize(picture, (width, _SHOWN_PX), interpolation=cv2.INTER_AREA))
    _, data = cv2.imencode(".png", cv2.cvtColor(np.hstack(drawn), cv2.COLOR_RGB2BGR))
    path.write_bytes(data.tobytes())


def require_poses_on_mask(sequence: Sequence, picture: Path) -> None:
    """Write `picture`, then raise CaptureError where the joints miss the person."""
    write_pose_picture(sequence, picture)
    share = joints_on_mask(sequence)
    if share < LEAST_ON_MASK:
        raise CaptureError(
            f"joints must lie on the person's mask; got {share:.0%} of those in sight, less than "
            f"{LEAST_ON_MASK:.0%}; look at {picture} and mend the clip's cameras, poses or masks"
        )
