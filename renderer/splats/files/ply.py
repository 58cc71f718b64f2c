"""Splats as a .ply that other viewers open."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from renderer.splats.layout import COLOUR, LOG_SCALE, OPACITY, POSITION, ROTATION
from renderer.splats.model import SplatModel

_SH_C0 = 0.28209479177387814
"""Band-0 spherical harmonic: .ply files of splats store colour as its coefficient."""


def write_ply(model: SplatModel, path: Path) -> None:
    """Write the splats in the T-pose as binary .ply (Kerbl et al. 2023's layout, colour band 0)."""
    names = ["x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity"]
    names += [f"scale_{i}" for i in range(3)] + [f"rot_{i}" for i in range(4)]
    p = model.parameters
    rows = np.concatenate(
        [
            p[:, POSITION : POSITION + 3],
            (p[:, COLOUR : COLOUR + 3] - 0.5) / _SH_C0,
            p[:, OPACITY : OPACITY + 1],
            p[:, LOG_SCALE : LOG_SCALE + 3],
            p[:, ROTATION : ROTATION + 4],
        ],
        axis=1,
    ).astype("<f4")
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(rows)}"]
    header += [f"property float {name}" for name in names] + ["end_header\n"]
    part = path.with_name(path.name + ".part")
    part.write_bytes("\n".join(header).encode() + rows.tobytes())
    part.replace(path)
