"""All that is seen of a lifelike performer as one textured surface."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from capture.body.eyes import EYES
from capture.errors import CaptureError
from capture.studio.lifelike.base_mesh import BaseMesh
from capture.studio.lifelike.eyes import Eyes
from capture.studio.lifelike.mhclo import FittedPiece, Piece, fit, read_piece, read_text
from capture.studio.lifelike.textures import Textures, pack, read_picture
from capture.studio.named_performers import LifelikePerformer
from scene.arrays import Array, Float, Int, UInt8
from scene.body import Body, vertex_normals

_LASHES = "eyelashes02"
_TEETH = "teeth_base"
_INSET_M = 0.006
"""How far covered skin draws back, so that it does not show through as limbs bend."""


@dataclass(frozen=True, eq=False)
class Surface:
    """Skin, eyes and pieces: N vertices, T triangles."""

    body: Body
    """As one body that is posed like any other."""
    texture: Float[Array, "T 3 2"]
    """Of the triangles' corners: right and up, 0 to 1."""
    picture: Int[Array, "T"]
    """Index of each triangle's picture in `textures`: 0 is the skin, 1 the eyes."""
    uv_per_m: Float[Array, "T"]
    """How far texture coordinates go in a metre."""
    textures: Textures

    @property
    def faces(self) -> Int[Array, "T 3"]:
        """Triangles."""
        assert self.body.faces is not None
        return self.body.faces


def dressed(
    row: LifelikePerformer,
    root: Path,
    body: Body,
    parts: Int[Array, "S"],
    base: BaseMesh,
    eyes: Eyes,
) -> Surface:
    """The surface of the performer of `row` on `body`; `root` is MakeHuman's folder `base`."""
    assert body.rest_vertices is not None
    assert body.faces is not None
    paths = _paths(row, root)
    pieces = _without_hidden_layers([read_piece(path) for path in paths])
    fitted = [fit(piece, base) for piece in pieces]
    covered = np.zeros(len(base.rest_vertices), bool)
    for piece in pieces:
        covered[piece.hidden] = True
    covered = covered[base.body_indices]
    shown = ~covered[body.faces].all(axis=1)
    is_eye = np.isin(parts, EYES)
    texture = np.where(
        is_eye[:, None, None], eyes.texture(body.rest_vertices)[body.faces], base.texture
    )
    inset = _INSET_M * covered[:, None] * vertex_normals(body.rest_vertices, body.faces)
    skin = replace(body, rest_vertices=body.rest_vertices - inset, faces=body.faces[shown])
    whole = _joined(skin, pieces, fitted)
    textures = [texture[shown], *(piece.texture for piece in pieces)]
    pictures = [is_eye[shown].astype(np.int64)]
    pictures += [np.full(len(piece.faces), 2 + n) for n, piece in enumerate(pieces)]
    joined_texture = np.concatenate(textures)
    return Surface(
        whole,
        joined_texture,
        np.concatenate(pictures),
        _uv_per_m(whole, joined_texture),
        pack(_pictures(row, root, paths, pieces)),
    )


def _without_hidden_layers(pieces: list[Piece]) -> list[Piece]:
    """Pieces without faces tied to base vertices that an earlier piece, worn over them, is tied to:
    socks under trousers."""
    kept, outer = [], np.zeros(0, np.int64)
    for piece in pieces:
        inner = np.asarray(np.isin(piece.base, outer).all(axis=1))
        hidden = inner[piece.faces].all(axis=1)
        kept.append(
            replace(
                piece,
                faces=piece.faces[~hidden],
                texture=piece.texture[~hidden],
            )
        )
        outer = np.union1d(outer, piece.base)
    return kept


def _paths(row: LifelikePerformer, root: Path) -> list[Path]:
    folders = [root / "clothes" / name for name in row.garments]
    folders += [root / "eyebrows" / row.brows, root / "eyelashes" / _LASHES]
    folders += [root / "teeth" / _TEETH]
    folders += [root / "hair" / row.hair] if row.hair else []
    return [folder / f"{folder.name}.mhclo" for folder in folders]


def _pictures(
    row: LifelikePerformer, root: Path, paths: list[Path], pieces: list[Piece]
) -> list[UInt8[Array, "H W 4"]]:
    """Of skin, eyes and every piece."""
    found = [
        _opaque(read_picture(root / "skins" / "textures" / f"{row.skin}.png")),
        _opaque(read_picture(root / "eyes" / "materials" / f"{row.eyes}_eye.png")),
    ]
    for path, piece in zip(paths, pieces, strict=True):
        material = (path.parent / piece.material).resolve()
        fields = dict(line.split(maxsplit=1) for line in _statements(read_text(material)))
        if "diffuseTexture" not in fields:
            raise CaptureError(
                f"{material.name} must name a diffuseTexture; got none; fetch it again"
            )
        picture = read_picture(material.parent / fields["diffuseTexture"].strip())
        transparent = fields.get("transparent", "False").strip().lower() == "true"
        found.append(picture if transparent else _opaque(picture))
    return found


def _statements(text: str) -> list[str]:
    return [line for line in text.splitlines() if len(line.split()) > 1]


def _opaque(picture: UInt8[Array, "H W 4"]) -> UInt8[Array, "H W 4"]:
    opaque = picture.copy()
    opaque[..., 3] = 255
    return opaque


def _joined(skin: Body, pieces: list[Piece], fitted: list[FittedPiece]) -> Body:
    assert skin.rest_vertices is not None
    assert skin.blend_weights is not None
    assert skin.faces is not None
    counts = [len(skin.rest_vertices), *(len(piece.rest_vertices) for piece in fitted)]
    firsts = np.cumsum(counts)[:-1]
    expressions = skin.expression_directions
    if expressions is not None:
        expressions = np.concatenate(
            [expressions, *(piece.expression_directions for piece in fitted)], axis=1
        )
    return Body(
        skin.skeleton,
        np.concatenate([skin.rest_vertices, *(piece.rest_vertices for piece in fitted)]),
        np.concatenate(
            [skin.faces, *(p.faces + first for p, first in zip(pieces, firsts, strict=True))]
        ),
        np.concatenate([skin.blend_weights, *(piece.blend_weights for piece in fitted)]),
        expressions,
    )


def _uv_per_m(body: Body, texture: Float[Array, "T 3 2"]) -> Float[Array, "T"]:
    assert body.rest_vertices is not None
    assert body.faces is not None
    a, b, c = (body.rest_vertices[body.faces[:, i]] for i in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    (u1, v1), (u2, v2) = (texture[:, k].T - texture[:, 0].T for k in (1, 2))
    return np.sqrt(np.abs(u1 * v2 - u2 * v1) / np.maximum(area, 1e-12))
