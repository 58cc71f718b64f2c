"""Tubes of cloth on a body: which there may be, how one is cut, and how it hangs and swings."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np

from scene.arrays import Array, Float, Int
from scene.body import Body
from scene.checks import require_finite, require_indices, require_shape
from scene.errors import InvalidInput
from scene.motion import Motion
from scene.skeleton import JOINT_NAMES, Skeleton

STEP_S = 1.0 / 60.0
"""Of the simulation."""
SETTLING_S = 3.0
"""How long cloth settles in the first pose."""
_CLEARANCE_M = 0.01
"""Between cloth and skin."""
_SLICE_M = 0.025
_WIDEST = 97.0
"""Percentile of a limb's radii that its capsule has: the widest few are joints and folds."""
_RIGID = 0.6
"""Blend weight from which skin counts as a limb's own."""


@dataclass(frozen=True)
class Cut:
    """How a person's loose clothes are cut and swing: few numbers, found from outlines."""

    skirt_top_m: float = 0.05
    """Above the pelvis' joint."""
    skirt_length_m: float = 0.4
    skirt_flare: float = 0.2
    """How much wider, m of radius, a metre further down."""
    sleeve_start: float = 0.0
    """Along the forearm, as a share of it."""
    sleeve_end: float = 0.8
    sleeve_flare_m: float = 0.06
    """Radius at the end beyond that of the arm."""
    spring_hz: float = 0.8
    """Frequency at which cloth swings about where its joint alone would take it."""
    drag_hz: float = 1.5
    """Share of its speed that it loses in a second."""
    smoothing: float = 0.1
    """Share of the neighbours' mean offset that a vertex takes on a step, at 32 a ring."""

    def array(self) -> Float[Array, "P"]:
        """Its numbers, in order."""
        return np.array([getattr(self, one.name) for one in fields(self)])

    @classmethod
    def of(cls, numbers: Float[Array, "P"]) -> Cut:
        """From `array`."""
        return cls(*map(float, numbers))


@dataclass(frozen=True, eq=False)
class Tubes:
    """G tubes of V vertices in all, and the C capsules that keep them off the limbs inside."""

    rest: Float[Array, "V 3"]
    """T-pose, m; tube by tube, ring by ring from the top."""
    tubes: Int[Array, "G 4"]
    """Joint that carries it, first vertex, rings, sides."""
    ends: Float[Array, "C 2 3"]
    """Of capsules, at rest."""
    movers: Int[Array, "C 2"]
    """Joints that move the ends."""
    radii: Float[Array, "C"]
    owners: Int[Array, "C"]
    """Which tube a capsule pushes."""
    constants: Float[Array, "3"]
    """Spring, 1/s^2; drag, 1/s; share of the neighbours' mean at 32 sides."""

    def __post_init__(self) -> None:
        require_shape("rest", self.rest, (None, 3))
        require_shape("tubes", self.tubes, (None, 4))
        capsules = len(self.radii)
        require_shape("ends", self.ends, (capsules, 2, 3))
        require_shape("movers", self.movers, (capsules, 2))
        require_shape("radii", self.radii, (capsules,))
        require_shape("owners", self.owners, (capsules,))
        require_shape("constants", self.constants, (3,))
        for name in ("rest", "ends", "radii", "constants"):
            require_finite(name, getattr(self, name))
        require_indices("movers", self.movers, len(JOINT_NAMES))
        require_indices("owners", self.owners, len(self.tubes))
        require_indices("tubes' joints", self.tubes[:, 0], len(JOINT_NAMES))
        vertices = 0
        for _, first, rings, sides in self.tubes.tolist():
            if first != vertices or rings < 2 or sides < 3:
                raise InvalidInput(
                    f"tubes must follow one another, of at least 2 rings of 3; got {rings} rings "
                    f"of {sides} from vertex {first} instead of {vertices}"
                )
            vertices += rings * sides
        if vertices != len(self.rest):
            raise InvalidInput(
                f"tubes must have as many vertices as lie at rest; got {vertices} of "
                f"{len(self.rest)}"
            )

    def tensors(self) -> dict[str, Array]:
        """What a model file holds of them: 8 kB for a skirt and two sleeves."""
        kinds = {np.dtype(np.float64): np.float32, np.dtype(np.int64): np.int32}
        arrays = {one.name: getattr(self, one.name) for one in fields(self)}
        return {name: array.astype(kinds[array.dtype]) for name, array in arrays.items()}

    @classmethod
    def from_tensors(cls, tensors: dict[str, Array]) -> Tubes:
        """Those whose `tensors` these are. Raises KeyError where one is missing."""
        arrays = [tensors[one.name] for one in fields(cls)]
        whole = [np.issubdtype(array.dtype, np.integer) for array in arrays]
        return cls(
            *(a.astype(np.int64 if w else np.float64) for a, w in zip(arrays, whole, strict=True))
        )

    @cached_property
    def lengths(self) -> Float[Array, "V"]:
        """Of each vertex' link to the ring above, m; nil on first rings."""
        lengths = np.zeros(len(self.rest))
        for _, first, rings, sides in self.tubes:
            ring = self.rest[first : first + rings * sides].reshape(rings, sides, 3)
            links = np.linalg.norm(np.diff(ring, axis=0), axis=2)
            lengths[first + sides : first + rings * sides] = links.ravel()
        return lengths

    @property
    def triangles(self) -> Int[Array, "T 3"]:
        """Two of each quad."""
        quads = self.quads
        return np.concatenate([quads[:, [0, 2, 1]], quads[:, [1, 2, 3]]])

    @cached_property
    def quads(self) -> Int[Array, "Q 4"]:
        """Corners of the cloth's quads: upper left, upper right, lower left, lower right."""
        corners = []
        for _, first, rings, sides in self.tubes:
            ring, side = np.divmod(np.arange((rings - 1) * sides), sides)
            left = first + ring * sides + side
            right = first + ring * sides + (side + 1) % sides
            corners.append(np.stack([left, right, left + sides, right + sides], axis=1))
        return np.concatenate(corners).astype(np.int32)

    @cached_property
    def carriers(self) -> Int[Array, "V"]:
        """The joint that carries each vertex."""
        return np.repeat(self.tubes[:, 0], self.tubes[:, 2] * self.tubes[:, 3])

    def over(self, transforms: Float[Array, "S K 4 4"]) -> Float[Array, "S V 3"]:
        """Where the cloth is at each of S steps, having settled in the first pose, world."""
        begun = self.at_rest(transforms[0])
        return self.stepped(begun, begun.copy(), transforms, round(SETTLING_S / STEP_S))

    def stepped(
        self,
        current: Float[Array, "V 3"],
        previous: Float[Array, "V 3"],
        transforms: Float[Array, "S K 4 4"],
        settling: int = 0,
    ) -> Float[Array, "S V 3"]:
        """Where the cloth is after each of S steps from `current`, and a step before that
        `previous`, both of which are moved on; after `settling` steps in the first pose."""
        from renderer.splats.cloth.simulation_kernels import simulate

        out = np.empty((len(transforms), *self.rest.shape))
        simulate(
            current,
            previous,
            np.ascontiguousarray(transforms, np.float64),
            self.rest,
            self.lengths,
            self.tubes,
            self.ends,
            self.movers,
            self.radii,
            self.owners,
            self.constants,
            STEP_S,
            settling,
            out,
        )
        return out

    def at_rest(self, transforms: Float[Array, "K 4 4"]) -> Float[Array, "V 3"]:
        """Where the joints alone would take the cloth, world."""
        m = transforms[self.carriers].astype(np.float64)
        return np.einsum("vij,vj->vi", m[:, :3, :3], self.rest) + m[:, :3, 3]


def steps_of(
    motion: Motion, skeleton: Skeleton
) -> tuple[Float[Array, "S"], Float[Array, "S K 4 4"]]:
    """Times of the simulation's steps over `motion`, s, and the skinning transforms there."""
    count = max(2, int(np.ceil(motion.duration_s / STEP_S - 1e-6)) + 1)
    times = motion.times_s[0] + np.arange(count) * STEP_S
    poses = [motion.pose_at(float(time)) for time in times]
    return times, skeleton.skinning_transforms(
        np.stack([pose.joint_angles for pose in poses]),
        np.stack([pose.root_translation for pose in poses]),
    )


def skirt_rings(body: Body, cut: Cut, rings: int, sides: int) -> Float[Array, "R A 3"]:
    """Round the hips: as wide as their convex hull down to each height, and flared."""
    assert body.rest_vertices is not None
    top = body.skeleton.rest_joints[0, 1] + cut.skirt_top_m
    heights = top - np.linspace(0.0, cut.skirt_length_m, rings)
    angles = 2.0 * np.pi * np.arange(sides) / sides
    outward = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    rest, widest = np.empty((rings, sides, 3)), np.zeros(sides)
    for ring, height in zip(rest, heights, strict=True):
        near = np.abs(body.rest_vertices[:, 1] - height) < _SLICE_M
        widest = np.maximum(
            widest, (body.rest_vertices[near][:, [0, 2]] @ outward.T).max(axis=0, initial=0.0)
        )
        radius = widest + _CLEARANCE_M + cut.skirt_flare * (top - height)
        ring[:, [0, 2]], ring[:, 1] = radius[:, None] * outward, height
    return rest


def sleeve_rings(body: Body, side: str, cut: Cut, rings: int, sides: int) -> Float[Array, "R A 3"]:
    """Round a forearm, open towards the hand."""
    elbow, wrist = (JOINT_NAMES.index(f"{side}_{name}") for name in ("elbow", "wrist"))
    start, end = body.skeleton.rest_joints[[elbow, wrist]]
    along = np.linspace(0.0, 1.0, rings)
    radius = limb_radius(body, elbow, wrist) + cut.sleeve_flare_m * along**1.5
    axis = (end - start) / np.linalg.norm(end - start)
    up = np.cross(axis, [0.0, 0.0, 1.0])
    up /= np.linalg.norm(up)
    angles = 2.0 * np.pi * np.arange(sides) / sides
    circle = np.cos(angles)[:, None] * up + np.sin(angles)[:, None] * np.cross(axis, up)
    middle = start + (cut.sleeve_start + (cut.sleeve_end - cut.sleeve_start) * along)[:, None] * (
        end - start
    )
    return middle[:, None] + radius[:, None, None] * circle


def limb_radius(body: Body, joint: int, child: int) -> float:
    """Of a capsule about the bone from `joint` to `child`, with clearance, m."""
    assert body.rest_vertices is not None
    assert body.blend_weights is not None
    start, end = body.skeleton.rest_joints[[joint, child]]
    bone = end - start
    own = body.blend_weights[:, joint] > _RIGID
    if not own.any():
        return _CLEARANCE_M
    skin = body.rest_vertices[own] - start
    along = np.clip(skin @ bone / (bone @ bone), 0.0, 1.0)
    away = np.linalg.norm(skin - along[:, None] * bone, axis=1)
    return float(np.percentile(away, _WIDEST)) + _CLEARANCE_M


SKIRT, SLEEVES = "skirt", "sleeves"


def cut_tubes(
    body: Body,
    cut: Cut,
    garments: tuple[str, ...] = (SKIRT, SLEEVES),
    skirt_size: tuple[int, int] = (12, 32),
    sleeve_size: tuple[int, int] = (8, 16),
) -> Tubes:
    """The `garments` as `cut` on `body`; sizes are rings and sides."""
    rest, tubes, ends, movers, radii, owners = [], [], [], [], [], []
    joints = body.skeleton.rest_joints

    def capsule(start: int, end: int, radius: float) -> None:
        ends.append(joints[[start, end]])
        movers.append((start, end))
        radii.append(radius)
        owners.append(len(tubes))

    def tube(joint: int, rings: Float[Array, "R A 3"]) -> None:
        tubes.append((joint, sum(map(len, rest)), *rings.shape[:2]))
        rest.append(rings.reshape(-1, 3))

    if SKIRT in garments:
        hips = [JOINT_NAMES.index(f"{side}_hip") for side in ("left", "right")]
        knees = [JOINT_NAMES.index(f"{side}_knee") for side in ("left", "right")]
        thighs = [limb_radius(body, hip, knee) for hip, knee in zip(hips, knees, strict=True)]
        for hip, knee, radius in zip(hips, knees, thighs, strict=True):
            capsule(hip, knee, radius)
        capsule(hips[0], hips[1], thighs[0])
        tube(0, skirt_rings(body, cut, *skirt_size))
    if SLEEVES in garments:
        for side in ("left", "right"):
            elbow, wrist = (JOINT_NAMES.index(f"{side}_{name}") for name in ("elbow", "wrist"))
            capsule(elbow, wrist, limb_radius(body, elbow, wrist))
            tube(elbow, sleeve_rings(body, side, cut, *sleeve_size))
    constants = [(2.0 * np.pi * cut.spring_hz) ** 2, cut.drag_hz, cut.smoothing]
    return Tubes(
        np.concatenate(rest) if rest else np.zeros((0, 3)),
        np.array(tubes, np.int64).reshape(-1, 4),
        np.array(ends).reshape(-1, 2, 3),
        np.array(movers, np.int64).reshape(-1, 2),
        np.array(radii, np.float64),
        np.array(owners, np.int64),
        np.array(constants),
    )
