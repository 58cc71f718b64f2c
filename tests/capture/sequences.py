"""Small sequences to write and to break."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from capture.body.model import load_body_model
from capture.storage import write_sequence
from scene import Body, Camera, Pose, PoseTrust, Skeleton, look_at
from scene.sequence import NOVEL_VIEW, UNSEEN_POSE, Frame

WIDTH, HEIGHT = 12, 8


def make_camera(distortion: np.ndarray | None = None) -> Camera:
    """A small camera in front of the person."""
    intrinsics = np.array([[10.0, 0.0, 6.0], [0.0, 11.0, 4.0], [0.0, 0.0, 1.0]])
    view = look_at(np.array([0.0, 1.0, 4.0]), np.array([0.0, 1.0, 0.0]))
    return Camera(intrinsics, view, WIDTH, HEIGHT, distortion)


def make_frames(
    count: int, rng: np.random.Generator, distortion: np.ndarray | None = None
) -> list[Frame]:
    """Frames of noise, a tenth of a second apart."""
    camera = make_camera(distortion)
    return [
        Frame(
            rng.random((HEIGHT, WIDTH, 3), dtype=np.float32),
            rng.random((HEIGHT, WIDTH), dtype=np.float32),
            camera,
            Pose(0.3 * rng.normal(size=(24, 3)), rng.normal(size=3), 0.1 * index),
        )
        for index in range(count)
    ]


def make_body(surface: bool) -> Body:
    """The mean body, or its joints alone."""
    body = load_body_model().body(np.zeros(5))
    return body if surface else Body(Skeleton(body.skeleton.rest_joints))


def surface(body: Body) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rest vertices, faces and blend weights of a body that has them."""
    assert body.rest_vertices is not None
    assert body.faces is not None
    assert body.blend_weights is not None
    return body.rest_vertices, body.faces, body.blend_weights


def write_small(path: Path, *, seed: int = 0, surface: bool = False, **changed: Any) -> Path:
    """Three training frames and one of each test split at `path`."""
    rng = np.random.default_rng(seed)
    given: dict[str, Any] = {
        "person": "somebody",
        "frames_per_second": 10.0,
        "body": make_body(surface),
        "train": make_frames(3, rng),
        "test": {NOVEL_VIEW: make_frames(1, rng), UNSEEN_POSE: make_frames(1, rng)},
        "source": "a test",
        "pose_trust": PoseTrust.EXACT,
    }
    write_sequence(path, **{**given, **changed})
    return path
