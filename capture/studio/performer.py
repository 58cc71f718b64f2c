"""A synthetic performer and its anti-aliased renderer."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from capture.body.model import load_body_model
from capture.studio.face import Face
from capture.studio.garments import Garment, make_garments
from capture.studio.light import EnvironmentLight
from capture.studio.outfit import Outfit, albedo, cloth_albedo, make_outfit
from scene.arrays import Array, Float
from scene.body import Body, vertex_normals
from scene.camera import Camera
from scene.expression import EXPRESSION_COUNT, EXPRESSION_NAMES, PARTS
from scene.motion import Pose

SUPERSAMPLING = 4
"""Samples a pixel side: a pixel is the mean of its samples."""
_EXPRESSION_STRENGTH = (0.7, 1.3)
"""Range of a performer's own expressions as a share of the body model's; lids just close."""
_KEY_LIGHT = np.array([0.6, 0.55, 0.58])
"""Direction towards the key light of the lit room (front, left, above), unit length below."""


class FilmedPerformer(Protocol):
    """Who can be filmed in the studio."""

    @property
    def body(self) -> Body:
        """The body without clothes, which moves."""
        ...

    @property
    def known_body(self) -> Body:
        """The body as a capture knows it."""
        ...

    @property
    def garments(self) -> tuple[Garment, ...]:
        """Loose clothes, worn in the look `loose` only."""
        ...

    def render(
        self,
        pose: Pose,
        camera: Camera,
        look: str,
        cloth: Float[Array, "C 3"] | None = None,
        light: EnvironmentLight | None = None,
    ) -> tuple[Float[Array, "H W 3"], Float[Array, "H W"]]:
        """The picture (premultiplied over black, sRGB) and its alpha, see `render_performer`."""
        ...


@dataclass(frozen=True, eq=False)
class StudioPerformer:
    """A body with clothes, all of it ground truth."""

    body: Body
    outfit: Outfit
    vertex_joint: Array
    """[V], the joint that moves each vertex most."""
    rest_normals: Float[Array, "V 3"]
    garments: tuple[Garment, ...]
    """Loose clothes, worn in the look `loose` only."""
    known_body: Body
    """The body as a capture knows it, with the body model's expressions instead of their own."""
    face: Face | None = None
    """Eyes and mouth of a face that moves; None of one that does not."""

    def render(
        self,
        pose: Pose,
        camera: Camera,
        look: str,
        cloth: Float[Array, "C 3"] | None = None,
        light: EnvironmentLight | None = None,
    ) -> tuple[Float[Array, "H W 3"], Float[Array, "H W"]]:
        """See `render_performer`."""
        return render_performer(self, pose, camera, look, cloth, light=light)


def make_performer(
    seed: int, *, expressive: bool = False, uniform: bool = False
) -> StudioPerformer:
    """The performer of `seed`: shape and clothes; `expressive`, with a face and hands that move;
    `uniform`, in clothes of one colour each."""
    rng = np.random.default_rng(seed)
    shape = rng.uniform([-0.12, -0.2, -0.4, -0.2, -0.2], [0.12, 0.25, 0.4, 0.3, 0.2])
    model = load_body_model()
    body = model.body(shape)
    face = None
    if expressive:
        assert model.parts is not None
        face = Face.of(body, model.parts)
        known = body
    else:
        known = body = replace(body, expression_directions=None)
    assert body.rest_vertices is not None
    assert body.blend_weights is not None
    assert body.faces is not None
    normals = vertex_normals(body.rest_vertices, body.faces)
    joint = body.blend_weights.argmax(axis=1)
    outfit = replace(make_outfit(rng), uniform=uniform)
    if known.expression_directions is not None:
        own = own_strength(rng)[:, None, None] * known.expression_directions
        body = replace(known, expression_directions=own)
    return StudioPerformer(body, outfit, joint, normals, make_garments(body), known, face)


def own_strength(rng: np.random.Generator) -> Float[Array, "S"]:
    """A performer's own blend shapes as shares of the body model's, drawn from `rng`."""
    strength = np.ones(EXPRESSION_COUNT)
    own = [not name.startswith(("blink", "look")) for name in EXPRESSION_NAMES]
    strength[own] = rng.uniform(*_EXPRESSION_STRENGTH, sum(own))
    hands = [strength[PARTS[hand]] for hand in ("left_hand", "right_hand")]
    return np.concatenate([strength, *hands])


def render_performer(
    performer: StudioPerformer,
    pose: Pose,
    camera: Camera,
    look: str,
    cloth: Float[Array, "C 3"] | None = None,
    supersampling: int = SUPERSAMPLING,
    light: EnvironmentLight | None = None,
) -> tuple[Float[Array, "H W 3"], Float[Array, "H W"]]:
    """The picture (premultiplied over black, sRGB) and its alpha.

    `cloth` holds the vertices of the performer's garments; None leaves them out. In the look
    `lit`, `light` takes the place of the studio's own.
    """
    from capture.studio.mesh_kernels import box_filter, rasterise

    supersampled = camera.resized(camera.width * supersampling, camera.height * supersampling)
    posed = performer.body.posed_vertices(pose)
    faces = performer.body.faces
    assert faces is not None
    vertices, triangles = posed, faces
    if cloth is not None:
        vertices = np.concatenate([posed, cloth])
        triangles = np.concatenate([faces, _garment_faces(performer, len(posed))])
    pixels, depth = supersampled.project(vertices)
    size = (supersampled.height, supersampled.width)
    triangle = np.empty(size, np.int32)
    barycentric, nearest = np.empty((*size, 3), np.float32), np.empty(size, np.float32)
    bound = np.full(size, np.inf, np.float32)
    rasterise(pixels, depth, triangles, triangle, barycentric, nearest, bound)
    samples = np.zeros((*size, 4), np.float32)
    is_skin, is_cloth = (triangle >= 0) & (triangle < len(faces)), triangle >= len(faces)
    samples[is_skin, :3] = _shade(
        performer, posed, triangle[is_skin], barycentric[is_skin].astype(np.float64), look, light
    )
    if cloth is not None:
        samples[is_cloth, :3] = _shade_cloth(
            performer,
            cloth,
            triangles[triangle[is_cloth]] - len(posed),
            barycentric[is_cloth],
            camera,
        )
    samples[..., 3] = triangle >= 0
    out = np.empty((camera.height, camera.width, 4), np.float32)
    box_filter(samples, supersampling, out)
    return out[..., :3], out[..., 3]


def _shade(
    performer: StudioPerformer,
    posed: Array,
    triangle: Array,
    weights: Array,
    look: str,
    light: EnvironmentLight | None,
) -> Float[Array, "N 3"]:
    rest_vertices = performer.body.rest_vertices
    assert rest_vertices is not None
    assert performer.body.faces is not None
    corners = performer.body.faces[triangle]
    rest = np.einsum("nc,ncx->nx", weights, rest_vertices[corners])
    normal = np.einsum("nc,ncx->nx", weights, performer.rest_normals[corners])
    joint = performer.vertex_joint[corners[np.arange(len(corners)), weights.argmax(axis=1)]]
    joints = performer.body.skeleton.rest_joints
    face = performer.face
    colour = albedo(performer.outfit, rest, normal, joint, joints, eyes=face is None)
    if face is not None:
        face.paint(colour, triangle, rest)
    if look != "lit":
        return colour
    posed_normals = vertex_normals(posed, performer.body.faces)
    normal = np.einsum("nc,ncx->nx", weights, posed_normals[corners])
    return lit(colour, normal, light)


def lit(
    colour: Float[Array, "N 3"], normal: Float[Array, "N 3"], light: EnvironmentLight | None
) -> Float[Array, "N 3"]:
    """sRGB `colour` of surfaces facing `normal` in the look `lit`; None: the studio's own light."""
    if light is not None:
        return light.shade(colour, normal).astype(np.float32)
    key = _KEY_LIGHT / np.linalg.norm(_KEY_LIGHT)
    diffuse = np.maximum(normal @ key, 0.0)
    sky = 0.5 + 0.5 * normal[:, 1]
    return colour * (0.72 + 0.08 * sky + 0.2 * diffuse)[:, None].astype(np.float32)


def _garment_faces(performer: StudioPerformer, first: int) -> Array:
    """Triangles of all garments, whose vertices are counted from `first`."""
    faces = []
    for garment in performer.garments:
        faces.append(garment.faces + first)
        first += garment.rest.shape[0] * garment.rest.shape[1]
    return np.concatenate(faces)


def _shade_cloth(
    performer: StudioPerformer, cloth: Array, corners: Array, weights: Array, camera: Camera
) -> Float[Array, "N 3"]:
    """Flat light, as on the rest of the look `loose`."""
    texture = np.concatenate([g.texture.reshape(-1, 2) for g in performer.garments])
    uv = np.einsum("nc,ncx->nx", weights, texture[corners])
    a, b, c = (cloth[corners[:, i]] for i in range(3))
    back_facing = np.einsum("nx,nx->n", np.cross(b - a, c - a), camera.position - a) > 0.0
    return cloth_albedo(performer.outfit, uv, back_facing)
