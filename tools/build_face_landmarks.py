"""Makes `capture/assets/face_landmarks.npz`:
`python -m tools.build_face_landmarks FACE_MODEL MAKEHUMAN_ASSETS`.

A face landmarker's points are known on its own mean face, not on the body model's. Here the
lifelike performers, who all have the body model's surface, are filmed from the front and shown to
it; where the line of sight through a point meets the naked surface, the point lies. Points about
which performers disagree, as those of a face's outline, and the irises are left out.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from capture.body.model import load_body_model
from capture.detection.face_and_hands import FaceAndHandDetector
from capture.fitting.face_shape import FACE_LANDMARKS_FILE
from capture.storage import open_sequence
from capture.studio import make_sequence
from capture.studio.mesh_kernels import rasterise
from capture.studio.named_performers import LIFELIKE_PERFORMERS
from scene.arrays import Array, Float, Int
from scene.body import Body
from scene.camera import Camera
from scene.motion import Pose
from scene.sequence import Sequence
from tools.build_head_landmarks import found_faces

_FRAMES, _SIZE_PX, _TURN_DEG = 12, 768, 30.0
_POINTS = 468
_MOST_SPREAD_M = 0.003
_NEAREST = 12


def main() -> None:
    """Film, look, cast, average, write."""
    model, means = load_body_model(), []
    with FaceAndHandDetector(Path(sys.argv[1]), None) as detector:
        for name in LIFELIKE_PERFORMERS:
            with tempfile.TemporaryDirectory() as folder:
                filmed = _film(Path(folder) / name, name, Path(sys.argv[2]))
                found = list(_points_on_surface(filmed, detector, model.rest_vertices))
            means.append(np.nanmedian(found, axis=0))
            print(f"{name}: found in {len(found)} of {_FRAMES} frames", flush=True)
    points = np.nanmedian(means, axis=0)[:_POINTS]
    spread = np.linalg.norm(np.array(means)[:, :_POINTS] - points, axis=2).mean(axis=0)
    kept = np.flatnonzero(spread < _MOST_SPREAD_M)
    triangles, mix = nearest_on_surface(points[kept], model.rest_vertices, model.faces)
    np.savez_compressed(
        FACE_LANDMARKS_FILE,
        numbers=kept.astype(np.uint16),
        triangles=triangles.astype(np.uint16),
        mix=mix.astype(np.float32),
    )
    print(
        f"{len(kept)} points kept, which performers place {1e3 * spread[kept].mean():.1f} mm apart"
    )


def _film(out: Path, name: str, assets: Path) -> Sequence:
    make_sequence(
        out,
        performer=name,
        assets=assets,
        frames=_FRAMES,
        size=_SIZE_PX,
        test_cameras=1,
        turn_deg=_TURN_DEG,
        framing="head",
    )
    return open_sequence(out)


def _points_on_surface(
    filmed: Sequence, detector: FaceAndHandDetector, mean: Float[Array, "V 3"]
) -> Iterator[Float[Array, "478 3"]]:
    """Of each frame, where the landmarks lie on the `mean` surface, m; NaN beside it."""
    body = filmed.body
    assert body.faces is not None
    for camera, pose, face in found_faces(filmed, detector, 0.5 * _SIZE_PX):
        triangle, mix = _cast(body, pose, camera)
        columns, rows = np.floor(face.pixels).astype(int).T
        inside = (columns >= 0) & (rows >= 0) & (columns < camera.width) & (rows < camera.height)
        at = np.where(inside, rows, 0), np.where(inside, columns, 0)
        on = np.einsum("pc,pcx->px", mix[at], mean[body.faces[np.maximum(triangle[at], 0)]])
        on[~inside | (triangle[at] < 0)] = np.nan
        yield on


def _cast(body: Body, pose: Pose, camera: Camera) -> tuple[Int[Array, "H W"], Array]:
    """The triangle that each pixel shows (-1: none), and where in it."""
    assert body.faces is not None
    pixels, depth = camera.project(body.posed_vertices(pose))
    size = camera.height, camera.width
    triangle, mix = np.empty(size, np.int32), np.empty((*size, 3), np.float32)
    nearest, bound = np.empty(size, np.float32), np.full(size, np.inf, np.float32)
    rasterise(pixels, depth, body.faces, triangle, mix, nearest, bound)
    return triangle, mix


def nearest_on_surface(
    points: Float[Array, "P 3"], vertices: Float[Array, "V 3"], faces: Int[Array, "T 3"]
) -> tuple[Int[Array, "P"], Float[Array, "P 3"]]:
    """The triangle nearest to each point, of those whose middles are nearest, and where in it."""
    from scipy.spatial import KDTree

    near = np.asarray(KDTree(vertices[faces].mean(axis=1)).query(points, k=_NEAREST)[1])
    a, b, c = np.moveaxis(vertices[faces[near]], 2, 0)
    ab, ac, ap = b - a, c - a, points[:, None] - a

    def dot(one: Array, other: Array) -> Array:
        return (one * other).sum(axis=-1)

    across = dot(ab, ab) * dot(ac, ac) - dot(ab, ac) ** 2
    v = (dot(ac, ac) * dot(ap, ab) - dot(ab, ac) * dot(ap, ac)) / across
    w = (dot(ab, ab) * dot(ap, ac) - dot(ab, ac) * dot(ap, ab)) / across
    mix = np.clip(np.stack([1.0 - v - w, v, w], axis=-1), 0.0, 1.0)
    mix /= mix.sum(axis=-1, keepdims=True)
    on = mix[..., :1] * a + mix[..., 1:2] * b + mix[..., 2:] * c
    best = np.linalg.norm(on - points[:, None], axis=-1).argmin(axis=1)
    rows = np.arange(len(points))
    return near[rows, best], mix[rows, best]


if __name__ == "__main__":
    main()
