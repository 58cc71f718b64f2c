"""Hair stands off the skull and hangs over the neck: from behind, the body model would be bald.

Frames from one side show the volume of hair in outlines: how far these lie off the skin, all round
the head. Sides that no frame shows are given what the outlines next to them, and those opposite,
have at that height, as far as all outlines allow. What stands off the neck counts as hair where it
has another colour than skin. Hair that hangs beside the face hangs straight down behind, too;
shorter hair follows the skull.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import numpy as np

from renderer.splats.layout import LOG_SCALE, POSITION
from renderer.splats.training.initialisation import FirstSplats
from renderer.splats.training.neighbours import mean_of_neighbours, neighbours_at_rest
from renderer.splats.training.surface_kinds import HEAD_KINDS, KINDS
from renderer.splats.training.views import View
from renderer.splats.training.visual_hull import share_within_outlines
from scene.arrays import Array, Bool, Float, Int
from scene.skeleton import HEAD, JOINT_NAMES, Skeleton

_SCALP, _FACE, _TRUNK, _THROAT = (KINDS.index(kind) for kind in ("scalp", "face", "trunk", "neck"))
_NECK = JOINT_NAMES.index("neck")
_RIM = 0.25
"""Cosine between surface and view below which a splat lies on the head's outline."""
_FACING = 0.5
"""Cosine from which a pixel shows the colour of the surface."""
_STEP_M, _STEPS = 0.002, 46
"""How an outline is looked for, from the skin outwards."""
_BEYOND_M, _BEYOND_WIDTHS = 0.003, 0.45
"""How far the outline of bare splats is found off the skin: always, and a deviation of a splat."""
_LEAST_M = 0.01
"""What stands off a neck by less is no hair."""
_UNLIKE_SKIN = 0.6
"""Difference from the skin's colour, as a share of the scalp's, from which it is hair."""
_LEAST_UNLIKE = 0.06
"""The same, sRGB: heads may be bald."""
_COLLAR_M = 0.04
"""Above the neck's joint: below, collars stand off the skin."""
_NAPE = (0.06, 0.12)
"""How far below the neck's joint, and to either side, the trunk holds hair down, m."""
_ACROSS = 0.35
"""How much a distance across the head counts, against one along it: hair ends at a height."""
_NEAREST = 40
"""Places on outlines whose median is the guess."""
_GUESS = 0.02
"""Weight of that guess, against the difference from a neighbour."""
_BACKWARD = -0.5
"""Along the head's depth: from here on hair hangs from the back of the skull, not from its side."""
_LONG = 0.65
"""Share of the sides of the face that have hair beside them, from which hair hangs: a bob has 0.9
and more, a man's short hair 0.4 and less."""
_SMOOTHING_ROUNDS = 12


@dataclass(frozen=True, eq=False)
class Hair:
    """Where hair covers splats that no frame shows."""

    covered: Bool[Array, "N"]
    moves: Float[Array, "N 3"]
    """From the body's surface, at rest, m; nil where nothing is covered."""
    growth: Float[Array, "N"]
    """Of the splats' sizes, logarithm: as many of them now lie on a larger surface."""
    long: bool = False
    """Whether it hangs."""

    def taken(self, splats: Int[Array, "K"]) -> Hair:
        """Over those `splats`, in this order."""
        return Hair(self.covered[splats], self.moves[splats], self.growth[splats], self.long)

    @classmethod
    def none(cls, count: int) -> Hair:
        """Over `count` splats."""
        return cls(np.zeros(count, bool), np.zeros((count, 3), np.float32), np.zeros(count))


@dataclass(frozen=True, eq=False)
class _Head:
    """The splats of head and neck, and of the trunk beside it, on the body's surface."""

    splats: Int[Array, "H"]
    kinds: Int[Array, "H"]
    surface: Float[Array, "H P"]
    normals: Float[Array, "H 3"]
    """Smooth: ears and lips do not count."""
    joints: Array
    weights: Float[Array, "H 4"]

    @property
    def rest(self) -> Float[Array, "H 3"]:
        return self.surface[:, POSITION : POSITION + 3]

    @property
    def bare_m(self) -> Float[Array, "H"]:
        """How far the outline of bare splats is found off the skin."""
        return _BEYOND_M + _BEYOND_WIDTHS * np.exp(self.surface[:, LOG_SCALE])

    @classmethod
    def of(
        cls,
        surface: Float[Array, "N P"],
        first: FirstSplats,
        kinds: Int[Array, "N"],
        skeleton: Skeleton,
    ) -> _Head:
        below, beside = _NAPE
        rest, neck = surface[:, POSITION : POSITION + 3], skeleton.rest_joints[_NECK]
        nape = (rest[:, 1] > neck[1] - below) & (np.abs(rest[:, 0] - neck[0]) < beside)
        splats = np.flatnonzero(np.isin(kinds, HEAD_KINDS) | ((kinds == _TRUNK) & nape))
        mean = mean_of_neighbours(rest[splats])
        normals = first.normals[splats].astype(np.float64)
        for _ in range(_SMOOTHING_ROUNDS):
            normals = 0.5 * (normals + mean @ normals)
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-9)
        return cls(
            splats,
            kinds[splats],
            surface[splats],
            normals.astype(np.float32),
            first.joints[splats],
            first.weights[splats],
        )


@dataclass(eq=False)
class _Outlines:
    """What frames show round a head; NaN where they do not."""

    head: _Head
    distances: list[Float[Array, "H"]] = field(default_factory=list)
    """From the skin to the outline, m."""
    colours: list[Float[Array, "H 3"]] = field(default_factory=list)
    """Between the two, as filmed."""
    skin: list[Float[Array, "_ 3"]] = field(default_factory=list)
    """Pixels that show the face."""
    faced: Float[Array, "H"] = field(init=False)
    """Greatest cosine between the surface and any frame's view."""

    def __post_init__(self) -> None:
        self.faced = np.full(len(self.head.splats), -1.0)

    def look(self, view: View, transforms: Float[Array, "K 4 4"]) -> None:
        """Take in one frame, in which `transforms` pose the head."""
        from renderer.splats.training.beside_kernels import pose_surface

        head, count = self.head, len(self.head.splats)
        places, normals = np.empty((2, count, 3), np.float32)
        pose_surface(
            head.surface, head.normals, head.joints, head.weights, transforms, places, normals
        )
        towards = view.window.position - places
        towards /= np.linalg.norm(towards, axis=1, keepdims=True)
        cosines = np.einsum("hx,hx->h", normals, towards)
        self.faced = np.maximum(self.faced, cosines)
        open_face = (cosines > _FACING) & (head.kinds == _FACE)
        self.skin.append(_pixels(view, places[open_face])[0][:, :3])
        rim = np.flatnonzero(np.abs(cosines) < _RIM)
        outward = normals[rim] - cosines[rim, None] * towards[rim]
        outward /= np.linalg.norm(outward, axis=1, keepdims=True)
        along = (_STEP_M * np.arange(_STEPS))[:, None] * outward[:, None]
        pixels, below = _pixels(view, places[rim, None] + along)
        ended = np.maximum.accumulate(pixels[..., 3] < 0.5, axis=1)
        known = ended[:, -1] & ~(below & ~ended).any(axis=1)
        light = np.where(ended[..., None], 0.0, pixels).sum(axis=1)
        distances, colours = np.full(count, np.nan), np.full((count, 3), np.nan)
        distances[rim[known]] = _STEP_M * ended.argmax(axis=1)[known]
        some = known & (light[:, 3] > 1.0)
        colours[rim[some]] = light[some, :3] / light[some, 3:]
        self.distances.append(distances)
        self.colours.append(colours)


def hair_of_unseen_sides(
    frames: Iterable[tuple[View, Float[Array, "K 4 4"]]],
    surface: Float[Array, "N P"],
    first: FirstSplats,
    kinds: Int[Array, "N"],
    unseen: Bool[Array, "N"],
    skeleton: Skeleton,
) -> Hair:
    """What outlines tell of hair where no frame shows it.

    Args:
        frames: some, with the transforms that pose the body in them.
        surface: the body's, where `first` lies on it at rest.
        kinds: index into `KINDS`, as of `surface_kinds`.
    """
    head = _Head.of(surface, first, kinds, skeleton)
    outlines, none = _Outlines(head), Hair.none(len(surface))
    if not unseen[head.splats].any():
        return none
    looked_at = list(frames)
    for view, transforms in looked_at:
        outlines.look(view, transforms)
    if not any(len(pixels) for pixels in outlines.skin):
        return none
    distances, share = _spread(outlines, skeleton)
    joint = skeleton.rest_joints[HEAD]
    behind = (share > 0.5) & (head.rest[:, 2] < joint[2]) & (head.kinds != _TRUNK)
    behind &= outlines.faced < 0.0
    covered = unseen[head.splats] & ((head.kinds == _SCALP) | behind)
    covered &= (outlines.faced < _FACING) & (distances > 0.0)
    if not covered.any():
        return none
    beside_face = share[head.kinds == _FACE] > 0.5
    long = bool(len(beside_face) and beside_face.mean() > _LONG)
    moves = _hanging(head, joint, distances, covered, (share > 0.5) & long)
    within = share_within_outlines(
        head.surface[covered],
        head.joints[covered],
        head.weights[covered],
        moves,
        head.bare_m[covered],
        looked_at,
    )
    moves *= within[:, None]
    rows = head.splats[covered]
    none.covered[rows] = True
    none.moves[rows] = moves
    radii = np.linalg.norm(head.rest[covered] - joint, axis=1)
    none.growth[rows] = np.log1p(np.linalg.norm(moves, axis=1) / np.maximum(radii, 1e-6))
    return replace(none, long=long)


def _spread(outlines: _Outlines, skeleton: Skeleton) -> tuple[Float[Array, "H"], Float[Array, "H"]]:
    """How far hair stands off the skin, m, and the share of hair in what is there, all round.

    Both are the smoothest that agree with the outlines and, weakly, with the median of those at
    about the same height on either side."""
    from scipy.sparse import diags
    from scipy.sparse.linalg import splu
    from scipy.spatial import KDTree

    head = outlines.head
    off, hairy, known = _hair_on_outlines(outlines, skeleton)
    values = np.stack([off, hairy], axis=1)
    axes = np.array([_ACROSS, 1.0, _ACROSS])
    shown = head.rest[known] * axes
    guesses = np.zeros_like(values)
    if known.any():
        both = np.concatenate([shown, shown * (-1.0, 1.0, 1.0)])
        _, near = KDTree(both).query(head.rest * axes, k=min(_NEAREST, len(both)))
        guesses = np.median(np.tile(values[known], (2, 1))[near.reshape(len(values), -1)], axis=1)
    sure = (known | (head.kinds == _TRUNK)).astype(np.float64)
    edges = neighbours_at_rest(head.rest)
    diagonal = np.asarray(edges.sum(axis=1)).ravel() + sure + _GUESS
    solved = splu((diags(diagonal) - edges).tocsc()).solve(
        sure[:, None] * values + _GUESS * guesses
    )
    return np.maximum(solved[:, 0], 0.0), solved[:, 1]


def _hair_on_outlines(
    outlines: _Outlines, skeleton: Skeleton
) -> tuple[Float[Array, "H"], Float[Array, "H"], Bool[Array, "H"]]:
    """How far hair stands off the skin, m, whether it is hair, and where outlines tell so."""
    head = outlines.head
    off = _medians(np.stack(outlines.distances))
    colours = _medians(np.stack(outlines.colours))
    skin = np.median(np.concatenate(outlines.skin), axis=0)
    scalp = colours[(head.kinds == _SCALP) & np.isfinite(colours[:, 0])]
    known = np.isfinite(off) & np.isfinite(colours[:, 0]) & (head.kinds != _TRUNK)
    off = np.maximum(off - head.bare_m, 0.0)
    unlike = np.linalg.norm(colours - skin, axis=1)
    apart = np.linalg.norm(np.median(scalp, axis=0) - skin) if len(scalp) else np.inf
    least = max(_UNLIKE_SKIN * apart, _LEAST_UNLIKE)
    above = head.rest[:, 1] > skeleton.rest_joints[_NECK][1] + _COLLAR_M
    on_skull = (head.kinds == _SCALP) & (apart > _LEAST_UNLIKE)
    hairy = known & (unlike > least) & (on_skull | ((off > _LEAST_M) & above))
    off = np.where(known & (hairy | on_skull), off, 0.0)
    return off, hairy.astype(np.float64), known


def _hanging(
    head: _Head,
    joint: Float[Array, "3"],
    distances: Float[Array, "H"],
    covered: Bool[Array, "H"],
    hangs: Bool[Array, "H"],
) -> Float[Array, "C 3"]:
    """How the `covered` splats move: `distances` off the skin; and below where the skull is widest,
    where hair `hangs`, straight down from it."""
    from scipy.spatial import KDTree

    rest = head.rest.astype(np.float64)
    across = (rest - joint) * (1.0, 0.0, 1.0)
    radii = np.linalg.norm(across, axis=1)
    outward = across / np.maximum(radii, 1e-6)[:, None]
    moved = distances[:, None] * head.normals
    skull = covered & (head.kinds == _SCALP)
    if not skull.any():
        return moved[covered]
    reaches = radii[skull] + np.einsum("hx,hx->h", moved[skull], outward[skull])
    near = KDTree(outward[skull]).query(outward, k=min(_NEAREST, len(reaches)))[1]
    near = near.reshape(len(rest), -1)
    widest = np.take_along_axis(near, reaches[near].argmax(axis=1)[:, None], axis=1)[:, 0]
    below = hangs & (rest[:, 1] < rest[skull][widest, 1]) & (outward[:, 2] < _BACKWARD)
    straight = np.maximum(reaches[widest] - radii, 0.0)[:, None] * outward
    return np.where(below[:, None], straight, moved)[covered]


def _medians(values: Float[Array, "F H ..."]) -> Float[Array, "H ..."]:
    """Of the frames that tell; NaN where none does."""
    return np.ma.median(np.ma.masked_invalid(values), axis=0).filled(np.nan)


def _pixels(
    view: View, places: Float[Array, "*batch 3"]
) -> tuple[Float[Array, "*batch 4"], Bool[Array, "*batch"]]:
    """What `view` shows at `places`, from 0 to 1, and nothing outside the picture; which lie below
    the picture."""
    pixels, inside, below = view.pixels_at(places)
    return np.where(inside[..., None], pixels / np.float32(255.0), 0.0), below
