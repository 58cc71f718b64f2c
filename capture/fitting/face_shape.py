"""The person's own face: the body model's, moved to where their landmarks are.

One body has one face at rest for all frames. The poses of the fit say where each landmark of the
body model's face should be in a frame; how far from there it is found says, to the right and up as
seen from the camera, how far it lies from there at rest. Over frames of a head that turns, depth
shows too; what does not show stays as it is. The offsets of some 400 landmarks become one smooth
field over the head by Gaussian-process regression (Rasmussen and Williams 2006, eq. 2.23), which
fades to nothing away from the face. An error of the fit that is the same in all frames, such as a
head that bows a little too far, is taken up too: the face is then where it is seen all the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

from scene.arrays import Array, Float, Int
from scene.body import Body, vertex_normals
from scene.camera import Camera
from scene.expression import blend_shape_weights
from scene.motion import Motion, Pose
from scene.skeleton import HEAD

FACE_LANDMARKS_FILE = Path(__file__).parents[1] / "assets" / "face_landmarks.npz"
_MIN_FRAMES = 5
_LEAST_FACING = 0.25
"""Cosine of the angle between a landmark's normal and the line of sight, from which it is seen."""
_AT_REST = 0.05
"""Share of a frame's evidence by which an offset is held at none, in depth above all."""
_SMOOTH_M, _NOISE = 0.035, 0.15
"""Distance within which offsets are alike, and how far a landmark is off, as a share of them."""


@dataclass(frozen=True, eq=False)
class FaceLandmarks:
    """Landmarks of a face landmarker, on the surface of the body model."""

    numbers: Int[Array, "P"]
    """Among the landmarker's 478."""
    triangles: Int[Array, "P"]
    mix: Float[Array, "P 3"]
    """Barycentric coordinates in them."""

    def at(self, values: Float[Array, "*S V X"], faces: Int[Array, "T 3"]) -> Array:
        """`values` of the vertices, at the landmarks: [*S P X]."""
        corners = values[..., faces[self.triangles], :]
        return np.einsum("pc,...pcx->...px", self.mix, corners)


@cache
def face_landmarks() -> FaceLandmarks:
    """As they lie on the surface that ships with the package (`tools.build_face_landmarks`)."""
    with np.load(FACE_LANDMARKS_FILE) as stored:
        return FaceLandmarks(
            stored["numbers"].astype(np.int64),
            stored["triangles"].astype(np.int64),
            stored["mix"].astype(np.float64),
        )


def with_own_face(
    body: Body, motion: Motion, camera: Camera, faces: Sequence[Float[Array, "478 2"] | None]
) -> Body:
    """`body`, of the default body model, with the face that is seen in the frames of `motion`.

    Args:
        camera: in whose pictures `faces` are, px.
        faces: the landmarks of each frame; None where no face was found. With fewer than five, the
            body is returned as it is.
    """
    seen = [index for index, face in enumerate(faces) if face is not None]
    if len(seen) < _MIN_FRAMES:
        return body
    known = _KnownFace.of(body)
    total, pulled = np.zeros((len(known.rest), 3, 3)), np.zeros((len(known.rest), 3))
    for index in seen:
        face = faces[index]
        assert face is not None
        across, lateral = known.observed(motion.pose(index), camera, face)
        total += across
        pulled += lateral
    held = _AT_REST * len(seen) * np.eye(3)
    offsets = np.linalg.solve(total + held, pulled[..., None])[..., 0]
    return _moved(body, known.rest, offsets)


@dataclass(frozen=True, eq=False)
class _KnownFace:
    """What a body's own surface says of the landmarks."""

    body: Body
    numbers: Int[Array, "P"]
    rest: Float[Array, "P 3"]
    normals: Float[Array, "P 3"]
    directions: Float[Array, "S P 3"] | None
    """How far blend shapes move them."""

    @classmethod
    def of(cls, body: Body) -> _KnownFace:
        assert body.rest_vertices is not None
        assert body.faces is not None
        landmarks, directions = face_landmarks(), body.expression_directions
        return cls(
            body,
            landmarks.numbers,
            landmarks.at(body.rest_vertices, body.faces),
            landmarks.at(vertex_normals(body.rest_vertices, body.faces), body.faces),
            None if directions is None else landmarks.at(directions, body.faces),
        )

    def observed(
        self, pose: Pose, camera: Camera, face: Float[Array, "478 2"]
    ) -> tuple[Float[Array, "P 3 3"], Float[Array, "P 3"]]:
        """What one frame says: across which plane, at rest, it shows each landmark, and how far (m)
        the landmark is off in that plane; nothing of those that face away."""
        rest, skeleton = self.rest, self.body.skeleton
        if self.directions is not None:
            rest = rest + np.tensordot(
                blend_shape_weights(pose.expression), self.directions, axes=1
            )
        moved = skeleton.skinning_transforms(pose.joint_angles, pose.root_translation)[HEAD]
        rotation = moved[:3, :3]
        places = rest @ rotation.T + moved[:3, 3]
        _, depth = camera.project(places)
        sight = (places - camera.position) @ rotation
        sight /= np.linalg.norm(sight, axis=1, keepdims=True)
        off = (camera.unproject(face[self.numbers], depth) - places) @ rotation
        seen = -(sight * self.normals).sum(axis=1) > _LEAST_FACING
        across = np.eye(3) - sight[:, :, None] * sight[:, None, :]
        across *= seen[:, None, None]
        return across, np.einsum("pij,pj->pi", across, off)


def _moved(body: Body, places: Float[Array, "P 3"], offsets: Float[Array, "P 3"]) -> Body:
    """`body` with the surface at `places` moved by `offsets`, and the head around them likewise."""
    assert body.rest_vertices is not None
    assert body.blend_weights is not None
    near = np.flatnonzero(body.blend_weights[:, HEAD] > 0.0)
    known = np.linalg.solve(_alike(places, places) + _NOISE**2 * np.eye(len(places)), offsets)
    moved = body.rest_vertices.copy()
    field = _alike(body.rest_vertices[near], places) @ known
    moved[near] += body.blend_weights[near, HEAD, None] * field
    return replace(body, rest_vertices=moved)


def _alike(a: Float[Array, "A 3"], b: Float[Array, "B 3"]) -> Float[Array, "A B"]:
    """How alike the offsets of places are (squared exponential covariance)."""
    squared = (a * a).sum(axis=1)[:, None] + (b * b).sum(axis=1) - 2.0 * a @ b.T
    return np.exp(-0.5 * squared / _SMOOTH_M**2)
