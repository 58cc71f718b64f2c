"""Lifelike performers: photographic skin, garments, hair and eyes on the body model.

Everything visible is one surface whose vertices follow the joints by the blend weights of the base
vertices that they are tied to. Hair, brows and lashes are see-through: layers of the z-buffer are
peeled off, nearest first (Everitt 2001, Interactive order-independent transparency).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from capture.body.model import load_body_model
from capture.errors import CaptureError
from capture.studio.garments import Garment
from capture.studio.lifelike.base_mesh import base_mesh_of
from capture.studio.lifelike.eyes import Eyes
from capture.studio.lifelike.surface import Surface, dressed
from capture.studio.light import EnvironmentLight
from capture.studio.named_performers import LifelikePerformer
from capture.studio.performer import SUPERSAMPLING, lit, own_strength
from scene.arrays import Array, Float
from scene.body import Body, vertex_normals
from scene.camera import Camera
from scene.expression import GAZE, gaze_of
from scene.motion import Pose

_LAYERS = 8
"""See-through layers at most; what lies behind eight of hair is not seen."""
_OPAQUE = 0.99
"""Alpha from which what lies behind cannot be seen."""


@dataclass(frozen=True, eq=False)
class DressedPerformer:
    """A lifelike performer; see `capture.studio.performer.FilmedPerformer`."""

    body: Body
    known_body: Body
    surface: Surface
    eyes: Eyes
    garments: tuple[Garment, ...] = ()

    def posed_vertices(self, pose: Pose) -> Float[Array, "N 3"]:
        """The whole surface in `pose`, world metres, eyes turned to where they look."""
        body = self.surface.body
        if pose.expression[GAZE].any():
            assert body.rest_vertices is not None
            turned = self.eyes.turned(body.rest_vertices, float(gaze_of(pose.expression)))
            body = replace(body, rest_vertices=turned)
        return body.posed_vertices(pose)

    def render(
        self,
        pose: Pose,
        camera: Camera,
        look: str,
        cloth: Float[Array, "C 3"] | None = None,
        light: EnvironmentLight | None = None,
        supersampling: int = SUPERSAMPLING,
    ) -> tuple[Float[Array, "H W 3"], Float[Array, "H W"]]:
        """The picture (premultiplied over black, sRGB) and its alpha; `cloth` must be None."""
        from capture.studio.lifelike.texture_kernels import sample_textures
        from capture.studio.mesh_kernels import box_filter, rasterise

        assert cloth is None
        surface, fine = (
            self.surface,
            camera.resized(camera.width * supersampling, camera.height * supersampling),
        )
        faces = surface.faces
        posed = self.posed_vertices(pose)
        normals = vertex_normals(posed, faces) if look == "lit" else None
        pixels, depth = fine.project(posed)
        size = (fine.height, fine.width)
        triangle = np.empty(size, np.int32)
        barycentric, nearest = np.empty((*size, 3), np.float32), np.empty(size, np.float32)
        bound = np.full(size, np.inf, np.float32)
        layer, samples = np.empty((*size, 4), np.float32), np.zeros((*size, 4), np.float32)
        for _ in range(_LAYERS):
            rasterise(pixels, depth, faces, triangle, barycentric, nearest, bound)
            sample_textures(
                triangle,
                barycentric,
                nearest,
                surface.texture,
                surface.picture,
                surface.uv_per_m,
                fine.focal_px,
                surface.textures.texels,
                surface.textures.places,
                layer,
            )
            if normals is not None:
                _light(layer, triangle, barycentric, faces, normals, light)
            samples += (1.0 - samples[..., 3:]) * layer
            bound = np.where((triangle >= 0) & (samples[..., 3] < _OPAQUE), nearest, 0.0)
            bound = bound.astype(np.float32)
            if not bound.any():
                break
        out = np.empty((camera.height, camera.width, 4), np.float32)
        box_filter(samples, supersampling, out)
        return out[..., :3], out[..., 3]


def make_lifelike_performer(
    row: LifelikePerformer, assets: Path, *, expressive: bool = False
) -> DressedPerformer:
    """The performer of `row`, from the folder with MakeHuman's `base`.

    Raises CaptureError where the folder or one of its files is missing or broken.
    """
    root = assets / "base"
    if not root.is_dir():
        raise CaptureError(
            f"assets must be a folder with MakeHuman's `base`; got {assets}; docs/data.md says "
            "where to fetch it"
        )
    model, shape = load_body_model(), np.array(row.shape)
    known = body = model.body(shape)
    if expressive:
        assert known.expression_directions is not None
        strength = own_strength(np.random.default_rng(row.seed))
        strength[GAZE] = 0.0  # eyes turn, and do not go along straight lines as those of models do
        body = replace(
            known, expression_directions=strength[:, None, None] * known.expression_directions
        )
    else:
        known = body = replace(known, expression_directions=None)
    assert model.parts is not None
    assert body.rest_vertices is not None
    eyes = Eyes.of(body, model.parts)
    base = base_mesh_of(shape, body)
    return DressedPerformer(
        body,
        known,
        dressed(row, root, body, model.parts, base, eyes),
        eyes,
    )


def _light(
    layer: Float[Array, "H W 4"],
    triangle: Array,
    barycentric: Array,
    faces: Array,
    normals: Float[Array, "N 3"],
    light: EnvironmentLight | None,
) -> None:
    seen = (triangle >= 0) & (layer[..., 3] > 0.0)
    normal = np.einsum("nc,ncx->nx", barycentric[seen], normals[faces[triangle[seen]]])
    alpha = layer[seen, 3:]
    layer[seen, :3] = alpha * lit(layer[seen, :3] / alpha, normal, light)
