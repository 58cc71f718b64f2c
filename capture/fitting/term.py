"""What every term of the fit's energy is."""

from __future__ import annotations

from capture.fitting.observations import Observations
from capture.fitting.state import FitBody, PosedClip
from scene.arrays import Float, Tensor


class Term:
    """One clue about body, motion or camera: `weight * energy` is added to what the fit minimises.

    A new clue is a file in `capture/fitting/terms/` with a subclass, and its name in
    `LANDMARK_TERMS` or `IMAGE_TERMS` there. Energies are means over frames, in squared deviations,
    so that they compare across clips of any length; what holds once a clip is not divided.
    """

    weight = 1.0

    def __init__(self, body: FitBody, seen: Observations) -> None:
        self.body, self.seen = body, seen

    def prepare(self, clip: PosedClip, *, coarse: bool) -> None:
        """Called without gradients as a stage begins: look for what stays for all of its steps.

        `coarse` while poses may still be off by much.
        """

    def associate(self, clip: PosedClip) -> None:
        """Called without gradients every few steps: pair what was seen with the present body."""

    def energy(self, clip: PosedClip) -> Float[Tensor, ""]:
        """How badly `clip` explains what was seen, differentiable."""
        raise NotImplementedError
