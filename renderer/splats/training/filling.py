"""Gives splats that no frame determines colours of the nearest seen surface of the same kind.

They stay marked as unseen. Hair takes its colour from hair, cloth from cloth, skin from skin; only
low frequencies are taken over: a logo or a lanyard on the chest does not show on the back.
"""

from __future__ import annotations

import numpy as np

from renderer.splats.layout import COLOUR, POSITION
from renderer.splats.training.evidence import Evidence
from renderer.splats.training.neighbours import neighbours_at_rest
from renderer.splats.training.surface_kinds import HEAD_KINDS, KINDS
from scene.arrays import Array, Bool, Float, Int

_DETERMINED_PX = 0.05
"""Evidence at which a splat's own colour weighs as much as one neighbour's, where one that lies
open has 1 px."""
_MOST = 1e4
"""Greatest weight: beyond, it is the colour's own anyway."""
_GUESS = 1.0
"""Weight of a guess, of the same measure: stray colours at the rim reach one or two splats far."""
_ALIKE = 0.1
"""Distance of two guessed colours at which they mix a third as much as if they were the same."""
_SAME = 0.2
"""Distance from the middle one at which a colour counts a third as much in the guess."""
_CELL_M = 0.02
"""Side of the cubes whose mean colours stand for what was seen: a bright logo of many small splats
counts no more than as much plain cloth."""
_MIRRORED_M = 0.04
"""How much farther than one beside it a cube counts whose mirror image that would be: people are
about the same on both sides."""
_CELLS = 60
"""Nearest cubes whose middle colour is the guess, mirrored ones among them."""
_CELL_PX = 0.5
"""Evidence in a cube from which it counts."""
_RANGE = (5.0, 95.0)
"""Percentiles of those cubes' colours between which that of a splat lies which only rims show."""
_FACED = 0.5
"""Share of its evidence from frames that a splat faces, below which only rims show it."""
_SLIVER_PX = 0.15
"""Evidence below which the rim shows a sliver of a splat, where one that lies open has 1 px."""
_FORWARD = 0.4
"""Depth of a normal at rest from which it belongs to the front of the face, not to a cheek."""
_ACROSS = 0.1
"""How much a distance across a limb or the trunk counts, against one along it: clothes end along
it, and light that falls on one side of a chest does not fall on the back."""
_SCALP, _FACE, _HANDS = (KINDS.index(kind) for kind in ("scalp", "face", "hands"))
_TRUNK, _LEGS = KINDS.index("trunk"), KINDS.index("legs")
_OVEREXPOSED = 0.75
"""Brightest channel from which a cube of the scalp shows a lamp's light rather than hair."""
_SIDEWAYS = [KINDS.index(kind) for kind in ("arms", "hands")]
"""Kinds whose bones lie along x at rest; those of others but the head lie along y."""
_COLOURS, _PLACE = slice(COLOUR, COLOUR + 3), slice(POSITION, POSITION + 3)


def fill_unseen(
    parameters: Float[Array, "N P"],
    evidence: Evidence,
    kinds: Int[Array, "N"],
) -> Float[Array, "N P"]:
    """`parameters` with the smoothest colours that agree with what frames determine.

    Colours minimise the squared differences between neighbours at rest plus, weighted by the
    fourth power of the evidence, those from the trained ones, plus those from a guess: the
    middle colour of the nearest seen surface of the same kind (screened membrane interpolation,
    Terzopoulos 1986). Neighbours of which different colours are guessed have no part in each
    other: a sleeve, a hem and hair end in a line, also where no frame shows it. What only the rim
    of outlines shows, a blend with splats in front and with the background, first comes to the
    range of the seen surface near it. Shape and opacity stay: training has made obstructing splats
    transparent.

    Args:
        kinds: index into `KINDS`, as of `surface_kinds`.
    """
    if evidence.open_px == 0.0:
        return parameters
    colours = parameters[:, _COLOURS].astype(np.float64)
    determined_px = _DETERMINED_PX * evidence.open_px
    weights = evidence_weights(evidence.pixels, determined_px)
    trust = _lent(evidence, kinds)
    # a hem hangs over hips, which move with the legs
    kinds = np.where(kinds == _LEGS, _TRUNK, kinds)
    guesses, lowest, highest = _guesses(parameters[:, _PLACE], colours, trust, kinds)
    rim = _only_at_rim(evidence)
    colours[rim] = np.clip(colours[rim], lowest[rim], highest[rim])
    edges = _between_alike(neighbours_at_rest(parameters[:, _PLACE]), guesses)
    pulls = weights[:, None] * colours + _GUESS * guesses
    filled = parameters.copy()
    filled[:, _COLOURS] = smoothest(edges, weights + _GUESS, pulls)
    return filled


def evidence_weights(pixels: Float[Array, "N"], as_one_px: float) -> Float[Array, "N"]:
    """Of splats' own colours, against the difference from a neighbour: the fourth power of their
    evidence, 1 at `as_one_px`."""
    return np.minimum((pixels.astype(np.float64) / as_one_px) ** 4, _MOST)


def smoothest(edges, weights: Float[Array, "N"], pulls: Float[Array, "N 3"]) -> Float[Array, "N 3"]:
    """Colours of the least squared differences along `edges` [N N] and, by `weights`, from
    `pulls` / `weights`."""
    from scipy.sparse import diags
    from scipy.sparse.linalg import splu

    diagonal = np.asarray(edges.sum(axis=1)).ravel() + weights
    # a sparse direct solver: far from all evidence, conjugate gradients take thousands of steps
    factors = splu(
        (diags(diagonal) - edges).tocsc(),
        permc_spec="MMD_AT_PLUS_A",
        options={"SymmetricMode": True},
    )
    return factors.solve(pulls)


def _between_alike(edges, guesses: Float[Array, "N 3"]):
    """`edges` as far as what is guessed of both ends is alike."""
    pairs = edges.tocoo()
    apart = ((guesses[pairs.row] - guesses[pairs.col]) ** 2).sum(axis=1)
    pairs.data *= np.exp(-apart / _ALIKE**2)
    return pairs.tocsr()


def held_colours(
    evidence: Evidence, kinds: Int[Array, "N"], normals: Float[Array, "N 3"]
) -> Bool[Array, "N"]:
    """Splats whose colour stays as filled while training goes on: those that no frame shows, and
    those that only the rim shows. Trained, they take the colour of the outline's last pixel all
    over, background and all. Hands and the front of the face, whose poses are followed most
    closely, learn on, but for splats of which the rim shows a sliver.

    Args:
        normals: at rest, outward, unit length.
    """
    front = (kinds == _FACE) & (normals[:, 2] > _FORWARD)
    sliver = evidence.pixels < _SLIVER_PX * evidence.open_px
    followed = (front | (kinds == _HANDS)) & ~sliver
    return ~evidence.seen | (_only_at_rim(evidence) & ~followed)


def _only_at_rim(evidence: Evidence) -> Bool[Array, "N"]:
    return evidence.facing < _FACED * evidence.pixels


def _lent(evidence: Evidence, kinds: Int[Array, "N"]) -> Float[Array, "N"]:
    """How much each splat's colour counts in guesses: where it faces a camera; hair, which stands
    up from the skull, also where that turns away."""
    lent = np.where(kinds == _SCALP, evidence.pixels, evidence.facing)
    return lent if lent.any() else evidence.pixels


def _guesses(
    rest: Float[Array, "N 3"],
    colours: Float[Array, "N 3"],
    trust: Float[Array, "N"],
    kinds: Int[Array, "N"],
) -> Float[Array, "3 N 3"]:
    """Median, low and high colour of the cubes of each splat's kind that lie nearest to it; of any
    kind where none of its own was seen."""
    cubes = np.column_stack([kinds, np.floor(rest / _CELL_M)]).astype(np.int64)
    cells, cell = np.unique(cubes, axis=0, return_inverse=True)
    cell = cell.ravel()
    total = np.bincount(cell, trust)
    known = total >= min(_CELL_PX, total.max())
    light = np.column_stack([np.bincount(cell, trust * channel) for channel in colours.T])
    means = light[known] / total[known, None]
    cell_kinds, places = cells[known, 0], (cells[known, 1:] + 0.5) * _CELL_M
    hairy = _hairy(cell_kinds, means)
    guesses = np.empty((3, *colours.shape))
    for kind in np.unique(kinds):
        mine, same = kinds == kind, cell_kinds == kind
        same = same if same.any() else np.ones_like(same)
        axes = _axes(int(kind))
        at, seen = rest[mine] * axes, places * axes
        near = _nearest(at, seen[same], means[same])
        guesses[1:, mine] = np.percentile(near, _RANGE, axis=1)
        if kind == _SCALP and hairy.any():
            near = _nearest(at, seen[hairy], means[hairy])
        guesses[0, mine] = _middle(near)
    return guesses


def _middle(near: Float[Array, "N K 3"]) -> Float[Array, "N 3"]:
    """The mean of those of each K that are like the one nearest to their median. Where two garments
    meet, the median of each channel by itself would be a colour of neither; and from that one alone
    to its neighbour's a shaded shirt would change in jags."""
    apart = ((near - np.median(near, axis=1, keepdims=True)) ** 2).sum(axis=2)
    middle = np.take_along_axis(near, apart.argmin(axis=1)[:, None, None], axis=1)
    alike = np.exp(-((near - middle) ** 2).sum(axis=2, keepdims=True) / _SAME**2)
    return (alike * near).sum(axis=1) / alike.sum(axis=1)


def _nearest(
    at: Float[Array, "N 3"], places: Float[Array, "C 3"], means: Float[Array, "C 3"]
) -> Float[Array, "N K 3"]:
    """`means` of the cubes whose `places`, or mirrored places, are nearest to each."""
    from scipy.spatial import KDTree

    count = min(_CELLS, len(places))
    apart, near = KDTree(places).query(at, k=count)
    beyond, opposite = KDTree(places * (-1.0, 1.0, 1.0)).query(at, k=count)
    apart, near, beyond, opposite = (
        np.reshape(one, (-1, count)) for one in (apart, near, beyond, opposite)
    )
    distances = np.concatenate([apart, np.hypot(beyond, _MIRRORED_M)], axis=1)
    both = np.concatenate([near, opposite], axis=1)
    chosen = np.argsort(distances, axis=1, kind="stable")[:, :_CELLS]
    return means[np.take_along_axis(both, chosen, axis=1)]


def _hairy(cell_kinds: Int[Array, "C"], means: Float[Array, "C 3"]) -> Bool[Array, "C"]:
    """Which cubes of the scalp show hair: the half that is least like the face, of those that are
    not overexposed. Where hair begins differs from head to head, and lamps shine on crowns."""
    scalp, face = cell_kinds == _SCALP, cell_kinds == _FACE
    shown = scalp & (means.max(axis=1) < _OVEREXPOSED)
    if not face.any() or not shown.any():
        return scalp
    unlike = np.linalg.norm(means - np.median(means[face], axis=0), axis=1)
    return shown & (unlike >= np.median(unlike[shown]))


def _axes(kind: int) -> Float[Array, "3"]:
    """How much a distance along each axis at rest counts."""
    axes = np.ones(3)
    if kind not in HEAD_KINDS:
        axes[[1, 2] if kind in _SIDEWAYS else [0, 2]] = _ACROSS
    return axes
