"""Garments' files, and how garments sit on a person."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from capture.errors import CaptureError
from capture.studio.lifelike.base_mesh import BaseMesh
from capture.studio.lifelike.mhclo import fit, read_piece
from scene.expression import BLEND_SHAPE_COUNT

MHCLO = """# a square
obj_file patch.obj
x_scale 0 1 2.0
y_scale 0 2 4.0
z_scale 0 3 5.0
verts 0
material patch.mhmat
  0 1 2 0.5 0.25 0.25 0.1 0.2 0.3
  0 1 2 1.0 0.0 0.0 0.0 0.0 0.0
  1
  2
delete_verts
0 - 2 5
7 9 - 10
"""
OBJ = """v 0 0 0
v 1 0 0
v 1 1 0
v 0 1 0
vt 0.0 0.25
vt 1.0 0.25
vt 1.0 0.75
f 1/1 2/2 3/3 4/1
"""


@pytest.fixture
def path(tmp_path) -> Path:
    (tmp_path / "patch.obj").write_text(OBJ)
    (tmp_path / "patch.mhclo").write_text(MHCLO)
    return tmp_path / "patch.mhclo"


def base_mesh() -> BaseMesh:
    """Four vertices a metre or so apart, of which the second belongs to joint 1."""
    vertices = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 1.0]])
    weights = np.zeros((4, 24))
    weights[[0, 1, 2, 3], [0, 1, 0, 0]] = 1.0
    expressions = np.zeros((BLEND_SHAPE_COUNT, 4, 3))
    expressions[2, 1] = [0.0, 0.0, 0.04]
    return BaseMesh(
        vertices,
        weights,
        expressions,
        np.tile(np.eye(3), (4, 1, 1)),
        np.arange(4),
        np.zeros((1, 3, 2)),
    )


def test_a_piece_is_read_golden(path):
    piece = read_piece(path)

    assert piece.base.tolist() == [[0, 1, 2], [0, 1, 2], [1, 1, 1], [2, 2, 2]]
    assert piece.shares[0].tolist() == [0.5, 0.25, 0.25]
    assert piece.shares[2].tolist() == [1.0, 0.0, 0.0]
    assert piece.offsets[0].tolist() == [0.1, 0.2, 0.3]
    assert piece.scales == ((0, 1, 2.0), (0, 2, 4.0), (0, 3, 5.0))
    assert piece.hidden.tolist() == [0, 1, 2, 5, 7, 9, 10]
    assert piece.faces.tolist() == [[0, 1, 2], [0, 2, 3]]
    assert piece.texture[1].tolist() == [[0.0, 0.25], [1.0, 0.75], [0.0, 0.25]]
    assert piece.material == "patch.mhmat"


def test_a_piece_fits_golden(path):
    fitted = fit(read_piece(path), base_mesh())

    # 0.25 * (1, 0, 0) + 0.25 * (0, 2, 0), and offsets times 1/2, 2/4 and 1/5
    np.testing.assert_allclose(fitted.rest_vertices[0], [0.25 + 0.05, 0.5 + 0.1, 0.06])
    np.testing.assert_allclose(fitted.rest_vertices[2], [1.0, 0.0, 0.0])
    np.testing.assert_allclose(fitted.blend_weights[0, :2], [0.75, 0.25])
    np.testing.assert_allclose(fitted.expression_directions[2, 0], [0.0, 0.0, 0.01])


def test_offsets_turn_with_the_limb_into_the_t_pose(path):
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    base = replace(base_mesh(), to_t_pose=np.tile(quarter, (4, 1, 1)))

    fitted = fit(read_piece(path), base)

    np.testing.assert_allclose(fitted.rest_vertices[0], [0.25 - 0.1, 0.5 + 0.05, 0.06])


def test_garments_grow_with_the_person(path):
    small = base_mesh()
    large = replace(small, rest_vertices=2.0 * small.rest_vertices)

    piece = read_piece(path)

    np.testing.assert_allclose(
        fit(piece, large).rest_vertices, 2.0 * fit(piece, small).rest_vertices
    )


@pytest.mark.parametrize("line", ["obj_file patch.obj", "x_scale 0 1 2.0", "  1", "  2"])
def test_a_broken_piece_is_refused(path, line):
    path.write_text(MHCLO.replace(f"{line}\n", "", 1))

    with pytest.raises(CaptureError, match=r"patch\.mhclo must be a \.mhclo file"):
        read_piece(path)


def test_a_missing_mesh_is_named(path):
    (path.parent / "patch.obj").unlink()

    with pytest.raises(CaptureError, match=r"assets must hold patch\.obj in"):
        read_piece(path)
