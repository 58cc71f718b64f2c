"""The estimated light of a clip, while splats are trained on it.

Whoever turns is brighter now and darker then: a colour that knows nothing of light learns what it
was last seen in. Here a splat's colour columns hold the root of its albedo instead, against which
sRGB is nearly straight, and each frame is drawn as the light falls on the body in its pose.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from renderer.relighting.shading import IDENTITY_ROTATION, NO_KEY_LIGHT, srgb_table
from renderer.splats.layout import COLOUR
from renderer.splats.model import SplatModel
from scene.arrays import Array, Float
from scene.colour import to_linear, to_srgb

_COLOURS = slice(COLOUR, COLOUR + 3)
_DARKEST = 0.02
"""Root of an albedo, below which the slope of what is shown is taken to be that of this one."""


@dataclass(frozen=True, eq=False)
class CapturedLight:
    """Light of a clip, on the normals of the splats that are learnt from it."""

    harmonics: Float[Array, "9 3"]
    """Of `scene.lighting`; times an albedo they give linear colour."""
    normals: Float[Array, "N 3"]
    """At rest, outwards, unit length."""
    mean: Float[Array, "N 3"]
    """Mean irradiance of each splat over the frames that saw it."""

    def without_light(self, parameters: Float[Array, "N P"]) -> Float[Array, "N P"]:
        """`parameters` with the roots of albedos as colours."""
        changed = parameters.copy()
        light = to_linear(np.clip(parameters[:, _COLOURS], 0.0, 1.0))
        changed[:, _COLOURS] = np.sqrt(light / self.mean)
        return changed

    def with_mean_light(self, parameters: Float[Array, "N P"]) -> Float[Array, "N P"]:
        """The inverse: colours as captured on the mean."""
        changed = parameters.copy()
        light = parameters[:, _COLOURS] ** 2 * self.mean
        changed[:, _COLOURS] = to_srgb(np.clip(light, 0.0, 1.0))
        return changed

    def lit(self, model: SplatModel) -> SplatModel:
        """`model`, in whose colour columns the roots of albedos are, as it was captured."""
        return replace(
            model,
            parameters=self.with_mean_light(model.parameters),
            albedo=np.clip(model.parameters[:, _COLOURS] ** 2, 0.0, 1.0),
            normals=self.normals,
            light=self.harmonics.astype(np.float32),
        )

    def shade(
        self,
        parameters: Float[Array, "N P"],
        joints: Array,
        weights: Float[Array, "N 4"],
        transforms: Float[Array, "K 4 4"],
        eye: Float[Array, "3"],
    ) -> Float[Array, "N P"]:
        """`parameters` with the colours that the light gives them in a pose, seen from `eye`."""
        from renderer.relighting.shading_kernels import shade

        shown = parameters.copy()
        shade(
            parameters[:, _COLOURS] ** 2,
            self.normals,
            joints,
            weights,
            transforms,
            eye.astype(np.float32),
            np.zeros(len(shown), np.uint8),
            self.harmonics[None].astype(np.float32),
            IDENTITY_ROTATION,
            NO_KEY_LIGHT,
            NO_KEY_LIGHT,
            srgb_table(),
            shown,
        )
        return shown

    def chain_to_albedo(
        self,
        gradient: Float[Array, "N P"],
        parameters: Float[Array, "N P"],
        shown: Float[Array, "N P"],
    ) -> None:
        """Turn the gradient by the colours `shown` into that by the roots, in place."""
        roots = np.maximum(parameters[:, _COLOURS], _DARKEST)
        gradient[:, _COLOURS] *= shown[:, _COLOURS] / roots

    def merged(self, mean: Callable[[Array], Array]) -> CapturedLight:
        """The same light on splats of which each is a `mean` of some of these."""
        normals = mean(self.normals)
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-9)
        return CapturedLight(
            self.harmonics, normals.astype(np.float32), mean(self.mean).astype(np.float32)
        )

    def state(self) -> dict[str, Array]:
        """What `restored` needs."""
        return {"light": self.harmonics, "light_normals": self.normals, "light_mean": self.mean}

    @staticmethod
    def restored(state: dict[str, Array]) -> CapturedLight | None:
        """What was put into `state`; None where no light was known yet."""
        if "light" not in state:
            return None
        return CapturedLight(state["light"], state["light_normals"], state["light_mean"])
