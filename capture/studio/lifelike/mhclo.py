"""MakeHuman's garments: meshes with texture coordinates, tied to the base mesh.

A `.mhclo` ties each vertex to three base vertices by weights and an offset, which grows with the
person along each axis, or to one. Format: http://www.makehumancommunity.org/wiki/Documentation
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from capture.errors import CaptureError
from capture.studio.lifelike.base_mesh import BaseMesh
from scene.arrays import Array, Float, Int


@dataclass(frozen=True, eq=False)
class Piece:
    """A garment as its files have it."""

    base: Int[Array, "N 3"]
    """Base vertices that each vertex is tied to."""
    shares: Float[Array, "N 3"]
    """Their weights; rows sum to about one, and some are negative."""
    offsets: Float[Array, "N 3"]
    """In units of `scales`, MakeHuman's axes, which are ours."""
    scales: tuple[tuple[int, int, float], ...]
    """Of each axis two base vertices, and their distance in which offsets are given."""
    hidden: Int[Array, "D"]
    """Base vertices that the piece covers."""
    faces: Int[Array, "T 3"]
    texture: Float[Array, "T 3 2"]
    """Of the triangles' corners: right and up, 0 to 1."""
    material: str
    """Name of the `.mhmat` file."""


@dataclass(frozen=True, eq=False)
class FittedPiece:
    """A garment on a person at rest, and how it moves with them."""

    rest_vertices: Float[Array, "N 3"]
    blend_weights: Float[Array, "N 24"]
    expression_directions: Float[Array, "S N 3"]


def read_piece(path: Path) -> Piece:
    """The garment of a `.mhclo` file, whose `.obj` lies beside it.

    Raises CaptureError for a file that is missing or broken.
    """
    fields: dict[str, list[str]] = {}
    rows: list[list[str]] = []
    hidden: list[str] = []
    section = None
    for line in read_text(path).splitlines():
        words = line.split()
        if not words or words[0].startswith("#"):
            continue
        if words[0][0].isalpha():
            fields[words[0]] = words[1:]
            # other fields may stand between `verts` and its rows
            section = words[0] if words[0] in ("verts", "delete_verts") else section
        elif section == "verts":
            rows.append(words)
        elif section == "delete_verts":
            hidden += words
    try:
        ties = [_tie(row) for row in rows]
        faces, texture = _read_obj(path.parent / fields["obj_file"][0])
        piece = Piece(
            base=np.array([tie[0] for tie in ties], np.int64).reshape(-1, 3),
            shares=np.array([tie[1] for tie in ties], np.float64).reshape(-1, 3),
            offsets=np.array([tie[2] for tie in ties], np.float64).reshape(-1, 3),
            scales=tuple(_scale(fields[f"{axis}_scale"]) for axis in "xyz"),
            hidden=_spans(hidden),
            faces=faces,
            texture=texture,
            material=fields["material"][0],
        )
        if faces.max() >= len(rows):
            raise ValueError(f"{faces.max() + 1} vertices in its .obj")
    except (KeyError, ValueError, IndexError) as error:
        raise CaptureError(
            f"{path.name} must be a .mhclo file with scales, a material, an .obj and a tie for "
            f"each vertex; got {error!r}; fetch it again"
        ) from error
    return piece


def fit(piece: Piece, base: BaseMesh) -> FittedPiece:
    """`piece` on the person of `base`, moving with the base vertices that it is tied to."""

    def tied(of_base: Array) -> Array:
        return np.einsum("nk,nk...->n...", piece.shares, of_base[piece.base])

    along = [
        abs(base.rest_vertices[first, axis] - base.rest_vertices[second, axis]) / distance
        for axis, (first, second, distance) in enumerate(piece.scales)
    ]
    turns = tied(base.to_t_pose)
    weights = np.maximum(tied(base.blend_weights), 0.0)
    return FittedPiece(
        tied(base.rest_vertices) + np.einsum("nij,nj->ni", turns, piece.offsets * along),
        weights / weights.sum(axis=1, keepdims=True),
        np.stack([tied(direction) for direction in base.expression_directions]),
    )


def read_text(path: Path) -> str:
    """The text of an asset's file. Raises CaptureError where it is missing."""
    require_asset(path)
    return path.read_text("utf-8", errors="replace")


def require_asset(path: Path) -> None:
    """Raises CaptureError where the asset's file is missing."""
    if not path.is_file():
        raise CaptureError(
            f"assets must hold {path.name} in {path.parent}; got no such file; docs/data.md says "
            "where to fetch MakeHuman's assets"
        )


def _tie(words: list[str]) -> tuple[list[int], list[float], list[float]]:
    if len(words) == 1:
        return [int(words[0])] * 3, [1.0, 0.0, 0.0], [0.0] * 3
    if len(words) != 9:
        raise ValueError(f"a tie of {len(words)} numbers")
    numbers = [float(word) for word in words[3:]]
    return [int(word) for word in words[:3]], numbers[:3], numbers[3:]


def _scale(words: list[str]) -> tuple[int, int, float]:
    return int(words[0]), int(words[1]), float(words[2])


def _spans(words: list[str]) -> Int[Array, "D"]:
    """Numbers, and ranges such as `5 - 9`, whose ends are included."""
    found: list[int] = []
    until = False
    for word in words:
        if word == "-":
            until = True
        elif until:
            found += range(found[-1] + 1, int(word) + 1)
            until = False
        else:
            found.append(int(word))
    return np.array(found, np.int64)


def _read_obj(path: Path) -> tuple[Int[Array, "T 3"], Float[Array, "T 3 2"]]:
    """Triangles and the texture coordinates of their corners."""
    texture: list[list[float]] = []
    corners: list[list[list[int]]] = []
    for line in read_text(path).splitlines():
        words = line.split()
        if not words:
            continue
        if words[0] == "vt":
            texture.append([float(word) for word in words[1:3]])
        elif words[0] == "f":
            polygon = [[int(n) - 1 for n in word.split("/")[:2]] for word in words[1:]]
            corners += [[polygon[0], a, b] for a, b in pairwise(polygon[1:])]
    indices = np.array(corners, np.int64)
    return indices[..., 0], np.array(texture)[indices[..., 1]]
