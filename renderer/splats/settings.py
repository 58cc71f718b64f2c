"""Sizes and rates of the preset `splats`; every figure was chosen by measurement."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Size = Literal["auto", "full"] | int
"""How many splats are kept: as few as a clip shows a need for, all, or at most so many."""


@dataclass(frozen=True)
class SplatSettings:
    """How many splats, and how they are trained."""

    count: int = 10_000
    """Splats at least; on studio frames of 256 px, 5k lose 0.5 dB, 15k gain 0.4 dB in poses never
    seen. Splitting those that the pictures pull at most (30 % at a fifth of the time, or twice
    25 %) loses 0.2 to 0.6 dB in new views: the training frames alone gain."""
    most: int = 60_000
    """Splats at most: what is served at 1024 px in the time of a picture."""
    pixels_a_splat: float = 3.0
    """Of a part as frames show it, seen square on: a person at a webcam gets about 50,000 splats in
    place of 10,000, prints can be read, and LPIPS falls from 0.27 to 0.09."""
    unseen_density: float = 4000.0
    """A square metre, where no frame looks, though half of the surface lies there: placing 10,000
    splats so, in place of evenly, is worth 2.4 dB and 0.1 of LPIPS on a webcam clip."""
    densified_above: int = 20_000
    """Splats above which a training begins with a quarter of them, and makes those finer that
    pictures differ from: it has 10 to 25 % more steps than with all of them from the start."""
    whole_px: int = 512
    """Longest side of the pictures in which a step sees the whole person."""
    window_px: int = 256
    """Side of the squares of frames at the size in which they were filmed."""
    window_share: float = 0.25
    """Share of the steps that look at such a square, where frames are larger than `whole_px`: with
    half of them, the body loses half a decibel."""
    beside_share: float = 0.3
    """Share of the steps that look from beside at people who were filmed from one side."""
    beside_from: float = 0.3
    """Share of the training after which they do: once splats are as many as there will be."""
    beside_deg: tuple[float, float] = (15.0, 60.0)
    """How far beside the camera."""
    expressive_share: float = 0.5
    """Share of the squares that lie about face or hands."""
    expressive_density: float = 3.0
    """How much denser splats lie on face and hands, where the body model knows their expressions:
    1 dB on either's crop for 0.2 dB of the whole body (`metanerf bench expressions`)."""
    scale_share: float = 0.6
    """First standard deviation, as a share of the spacing on the surface."""
    uncertain_scale_share: float = 0.7
    """The same where poses are estimated, and sizes are held near the first: as small as leaves no
    gaps between splats that lie evenly. With 0.62 LPIPS is a few per cent lower, but temples crack
    where frames graze them; with 0.52 hands fray, too."""
    thickness: float = 0.2
    """First deviation along the surface's normal, as a share of that within it: flat splats hold
    up in poses never seen, where round ones lose 1.3 dB."""
    opacity_logit: float = 2.0
    position_rate: float = 2e-4
    """m a step, at the start."""
    uncertain_position_rate: float = 6e-4
    """The same where the surface is estimated: it may be centimetres off."""
    log_scale_rate: float = 1.2e-2
    rotation_rate: float = 4e-3
    colour_rate: float = 2e-2
    opacity_rate: float = 3e-2
    linear_from: float = 0.2
    """Difference in colour from which a pixel pulls no stronger: 0.2 to 0.3 dB above the same pull
    by all."""
    uncertain_linear_from: float = 0.02
    """The same where poses are estimated and pixels show another place: 0.2 loses 0.5 dB."""
    last_rate_share: float = 0.05
    """Every rate falls linearly to this share."""
    beta1: float = 0.9
    beta2: float = 0.99
    scale_range_m: tuple[float, float] = (5e-4, 0.02)
    """Longer ones grow into spikes where poses are off."""
    shape_pull: float = 0.005
    """Where poses are estimated: share by which a step draws places and sizes back to the surface.
    A person who does not turn is never seen sideways, so what they do in depth is else pure noise.
    """
    head_shape_pull: float = 0.015
    """The same on head and neck, whose surface landmarks of the face have shaped: with less, a
    profile frays; with as much everywhere, hands and cloth that the body model lacks are blurred.
    """
    roughness_m: float = 0.01
    """How far a splat may stand out from those beside it where depth is uncertain. If less,
    pictures from the camera are less sharp: what lies in front of what is then settled by chance.
    """
    filled_from: float = 0.8
    """Share of the training after which sides that no frame shows are filled in and keep their
    colour: what shines through from behind is then right, and what lies in front is trained before
    it."""
