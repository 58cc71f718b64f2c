"""First splats: spread over the rest surface or, where none is known, over capsules round bones."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from renderer.splats.cloth.hanging import on_no_cloth
from renderer.splats.expressions import moving_rows, moving_splats, no_offsets, no_splats
from renderer.splats.layout import COLOUR, LOG_SCALE, OPACITY, PARAMETERS, POSITION, ROTATION
from renderer.splats.model import SplatModel
from renderer.splats.settings import SplatSettings
from renderer.splats.training.detail import shown_density
from renderer.splats.training.even_places import even_places
from scene.arrays import Array, Bool, Float, Int
from scene.body import Body
from scene.errors import InvalidInput
from scene.expression import EXPRESSION_COUNT, GAZE, PARTS
from scene.rotations import rotation_between
from scene.sequence import PoseTrust, Sequence
from scene.skeleton import JOINT_NAMES, Skeleton

_CAPSULE_RADIUS_M = {
    "spine": 0.13,
    "pelvis": 0.14,
    "hip": 0.1,
    "knee": 0.08,
    "ankle": 0.06,
    "foot": 0.05,
    "neck": 0.07,
    "head": 0.11,
    "collar": 0.1,
    "shoulder": 0.08,
    "elbow": 0.06,
    "wrist": 0.05,
    "hand": 0.05,
}
_CANDIDATES = 3
"""Points drawn for every one kept: on a surface the most even, on capsules those that the masks
leave."""
_MOVED_M = 1e-3
"""How far an expression must move the surface for more splats to lie there."""
_MASK_VOTES = 0.9
"""Share of the frames whose mask must cover a capsule's point."""


@dataclass(frozen=True, eq=False)
class FirstSplats:
    """Splats at rest, before training."""

    parameters: Float[Array, "N P"]
    joints: Array
    """[N 4] uint16."""
    weights: Float[Array, "N 4"]
    normals: Float[Array, "N 3"]
    """Outward, unit length."""
    expression_splats: Int[Array, "M"] = field(default_factory=no_splats)
    expression_offsets: Float[Array, "M S 3"] = field(default_factory=no_offsets)
    """As the body's surface moves, m; empty where that is not known."""
    quads: Int[Array, "_"] = field(default_factory=lambda: np.zeros(0, np.int32))
    """Where on loose clothes each lies, see `BoundSplats`; left out, all are on the body."""

    def __post_init__(self) -> None:
        if len(self.quads) != len(self.parameters):
            object.__setattr__(self, "quads", on_no_cloth(len(self.parameters)))

    def taken(self, rows: Int[Array, "G"]) -> FirstSplats:
        """Those of `rows`, each as often as it is named."""
        moving, places = moving_rows(self.expression_splats, rows, len(self.parameters))
        return FirstSplats(
            self.parameters[rows],
            self.joints[rows],
            self.weights[rows],
            self.normals[rows],
            moving,
            self.expression_offsets[places],
            self.quads[rows],
        )

    def with_bones(self, before: Skeleton, after: Skeleton) -> FirstSplats:
        """These, on the skeleton `before`, on the one of other bone lengths `after`."""
        moved = moved_with_bones(self.parameters, self.joints, self.weights, before, after)
        return replace(self, parameters=moved)

    def joined(self, others: FirstSplats) -> FirstSplats:
        """These, then `others`."""
        moving = others.expression_splats + np.int32(len(self.parameters))
        return FirstSplats(
            np.concatenate([self.parameters, others.parameters]),
            np.concatenate([self.joints, others.joints]),
            np.concatenate([self.weights, others.weights]),
            np.concatenate([self.normals, others.normals]),
            np.concatenate([self.expression_splats, moving]),
            np.concatenate([self.expression_offsets, others.expression_offsets]),
            np.concatenate([self.quads, others.quads]),
        )


def first_splats(
    sequence: Sequence, settings: SplatSettings, rng: np.random.Generator
) -> FirstSplats:
    """`settings.count` splats at rest.

    Raises InvalidInput where capsules and masks have nothing in common.
    """
    body, estimated = sequence.body, sequence.pose_trust is PoseTrust.ESTIMATED
    share = settings.uncertain_scale_share if estimated else settings.scale_share
    if body.has_surface:
        places = SurfacePlaces.drawn(body, *splat_density(sequence, settings), rng)
        first = splats_at(places, body, share * places.spacing[:, None], settings.thickness)
    else:
        points, normals, weights, area = _sample_capsules(sequence, settings.count, rng)
        deviation = share * np.sqrt(area / len(points))
        first = flat_splats(points, normals, weights, deviation, settings.thickness)
    first.parameters[:, OPACITY] = settings.opacity_logit
    return first


def splats_at(
    places: SurfacePlaces, body: Body, deviation: Float[Array, "N 1"] | float, thickness: float
) -> FirstSplats:
    """Grey, half transparent splats at `places` on `body`, that move as it does.

    Args:
        deviation: within the surface, m.
        thickness: deviation along the normal, as a share of that.
    """
    points, normals, weights, _ = places.sampled(body)
    splats, offsets = no_splats(), no_offsets()
    if body.expression_directions is not None:
        splats, offsets = moving_splats(places.blended(body, body.expression_directions))
    first = flat_splats(points, normals, weights, deviation, thickness)
    return replace(first, expression_splats=splats, expression_offsets=offsets)


def flat_splats(
    points: Float[Array, "N 3"],
    normals: Float[Array, "N 3"],
    weights: Float[Array, "N K"],
    deviation: Float[Array, "N 1"] | float,
    thickness: float,
) -> FirstSplats:
    """Grey ones at `points`, m; other arguments as of `splats_at`."""
    strongest = np.argsort(-weights, axis=1)[:, :4]
    top = np.take_along_axis(weights, strongest, axis=1)
    top /= top.sum(axis=1, keepdims=True)
    parameters = np.zeros((len(points), PARAMETERS), np.float32)
    parameters[:, POSITION : POSITION + 3] = points
    parameters[:, LOG_SCALE : LOG_SCALE + 3] = np.log(deviation)
    parameters[:, LOG_SCALE + 2] += np.log(thickness)
    parameters[:, ROTATION : ROTATION + 4] = _quaternions_from_z(normals)
    parameters[:, COLOUR : COLOUR + 3] = 0.5
    return FirstSplats(
        parameters,
        strongest.astype(np.uint16),
        top.astype(np.float32),
        normals.astype(np.float32),
    )


def splats_of_model(model: SplatModel, first: FirstSplats, skeleton: Skeleton) -> FirstSplats:
    """The splats of an earlier `model` on `skeleton`, on which `first` are, too.

    Their normals are those of `first`; so are offsets of expressions where the model knows none, or
    was made before fingers had in-betweens, or eyes could turn. Where the model shows what no frame
    did, `first` stand in for it, in its colours: finer sides, hollows and hair are guessed anew, on
    the body's surface and not on an earlier guess.
    """
    from scipy.spatial import KDTree

    joints = model.joints.astype(np.uint16)
    parameters = moved_with_bones(model.parameters, joints, model.weights, model.skeleton, skeleton)
    place = slice(POSITION, POSITION + 3)
    _, nearest = KDTree(first.parameters[:, place]).query(parameters[:, place])
    splats, offsets = model.expression_splats, model.expression_offsets
    has_all = offsets[:, EXPRESSION_COUNT:].any() and offsets[:, GAZE].any()
    if not has_all and len(first.expression_splats):
        all_offsets = np.zeros((len(first.parameters), *offsets.shape[1:]), np.float32)
        all_offsets[first.expression_splats] = first.expression_offsets
        splats, offsets = moving_splats(all_offsets[nearest])
    known = FirstSplats(
        parameters, joints, model.weights, first.normals[nearest], splats, offsets, model.quads
    )
    if model.seen.all():
        return known
    near = np.asarray(KDTree(parameters[:, place]).query(first.parameters[:, place])[1])
    anew = ~model.seen[near]
    guessed = first.taken(np.flatnonzero(anew))
    guessed.parameters[:, COLOUR : COLOUR + 3] = parameters[near[anew], COLOUR : COLOUR + 3]
    return known.taken(np.flatnonzero(model.seen)).joined(guessed)


def moved_with_bones(
    parameters: Float[Array, "N P"],
    joints: Array,
    weights: Float[Array, "N 4"],
    before: Skeleton,
    after: Skeleton,
) -> Float[Array, "N P"]:
    """`parameters` of splats on the skeleton `before`, on the one of other bone lengths `after`."""
    moved, longer = parameters.copy(), after.rest_joints - before.rest_joints
    shift = np.einsum("ns,nsx->nx", weights, longer[joints])
    moved[:, POSITION : POSITION + 3] += shift.astype(np.float32)
    return moved


def _quaternions_from_z(directions: Float[Array, "N 3"]) -> Float[Array, "N 4"]:
    """Quaternions (w, x, y, z) that turn +z to unit `directions`, the shortest way."""
    x, y, z = directions.T
    turns = np.stack([1.0 + z, -y, x, np.zeros_like(z)], axis=1)
    turns[turns[:, 0] < 1e-6] = [0.0, 1.0, 0.0, 0.0]
    return turns / np.linalg.norm(turns, axis=1, keepdims=True)


@dataclass(frozen=True, eq=False)
class SurfacePlaces:
    """Places spread over a rest surface, evenly by area but for face and hands."""

    face: Int[Array, "N"]
    mix: Float[Array, "N 3"]
    """Barycentric coordinates in it."""
    normals: Float[Array, "N 3"]
    spacing: Float[Array, "N"]
    """Between neighbours, m."""
    area: float
    """Of the whole surface, m^2."""

    @classmethod
    def drawn(
        cls, body: Body, count: int, density: Float[Array, "T"] | float, rng: np.random.Generator
    ) -> SurfacePlaces:
        """`count` places on `body`, as dense on each triangle as `density` says, up to a factor.

        Raises InvalidInput for a body without a surface.
        """
        drawn = cls._by_chance(body, _CANDIDATES * count, density, rng)
        points, normals, _, area = drawn.sampled(body)
        kept = even_places(points, normals, drawn.spacing, count)
        spacing = drawn.spacing[kept] * np.sqrt(_CANDIDATES)
        return cls(drawn.face[kept], drawn.mix[kept], normals[kept], spacing, area)

    @classmethod
    def _by_chance(
        cls, body: Body, count: int, density: Float[Array, "T"] | float, rng: np.random.Generator
    ) -> SurfacePlaces:
        """As `drawn`, in clumps."""
        normal = _face_normals(body)
        areas = 0.5 * np.linalg.norm(normal, axis=1)
        density = np.broadcast_to(density, areas.shape)
        share = areas * density
        # stratified along the faces' running area: more even than independent draws
        at = (np.arange(count) + rng.uniform(size=count)) / count * share.sum()
        face = np.minimum(np.searchsorted(np.cumsum(share), at), len(areas) - 1)
        root = np.sqrt(rng.uniform(size=count))
        v = rng.uniform(size=count)
        mix = np.stack([1.0 - root, root * (1.0 - v), root * v], axis=1)
        unit = normal[face] / np.maximum(2.0 * areas[face, None], 1e-12)
        spacing = np.sqrt(share.sum() / count / density[face])
        return cls(face, mix, unit, spacing, float(areas.sum()))

    @classmethod
    def even(cls, body: Body, density: float, rng: np.random.Generator) -> SurfacePlaces:
        """`density` places a square metre of `body`, everywhere.

        Raises InvalidInput for a body without a surface.
        """
        area_m2 = 0.5 * np.linalg.norm(_face_normals(body), axis=1).sum()
        return cls.drawn(body, round(density * area_m2), 1.0, rng)

    def blended(self, body: Body, directions: Float[Array, "S V 3"]) -> Float[Array, "N S 3"]:
        """`directions` of the vertices of `body`, at the places."""
        assert body.faces is not None
        return np.einsum("nc,sncx->nsx", self.mix, directions[:, body.faces[self.face]])

    def sampled(
        self, body: Body
    ) -> tuple[Float[Array, "N 3"], Float[Array, "N 3"], Float[Array, "N K"], float]:
        """Points, normals, blend weights, and the surface's area (m^2)."""
        assert body.rest_vertices is not None
        assert body.faces is not None
        assert body.blend_weights is not None
        corners = body.faces[self.face]
        points = np.einsum("nc,ncx->nx", self.mix, body.rest_vertices[corners])
        weights = np.einsum("nc,nck->nk", self.mix, body.blend_weights[corners])
        return points, self.normals, weights, self.area


def splat_density(sequence: Sequence, settings: SplatSettings) -> tuple[int, Float[Array, "T"]]:
    """How many splats the surface of `sequence` gets, and how dense they lie on each triangle.

    As many a square metre as the frames, at the size in which steps see them whole, show pixels of
    it, few where they show none, more on face and hands; all told at least `settings.count`, at
    most `settings.most`.
    """
    camera = sequence.train.camera(0)
    scale = min(1.0, settings.whole_px / max(camera.width, camera.height))
    pixels = scale**2 * shown_density(sequence)
    density = np.maximum(pixels / settings.pixels_a_splat, settings.unseen_density)
    density *= np.where(_expressive_faces(sequence.body), settings.expressive_density, 1.0)
    areas = 0.5 * np.linalg.norm(_face_normals(sequence.body), axis=1)
    wanted = round(float((areas * density).sum()))
    return min(max(wanted, settings.count), settings.most), density


def _face_normals(body: Body) -> Float[Array, "T 3"]:
    """Outward, twice as long as each triangle is large (m^2)."""
    if body.rest_vertices is None or body.faces is None:
        raise InvalidInput("body must have a surface to be sampled; got joints only")
    corners = body.rest_vertices[body.faces]
    return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


def _expressive_faces(body: Body) -> Bool[Array, "T"]:
    """Which triangles of `body` expressions move, a hand's fingers together."""
    assert body.faces is not None
    if body.expression_directions is None:
        return np.zeros(len(body.faces), bool)
    moved = body.expression_directions
    hands = [moved[PARTS[hand]].sum(axis=0) for hand in ("left_hand", "right_hand")]
    moved = np.concatenate([moved[PARTS["face"]], hands])
    far = np.linalg.norm(moved, axis=2).max(axis=0) > _MOVED_M
    return far[body.faces].any(axis=1)


def sample_surface(
    body: Body, count: int, rng: np.random.Generator
) -> tuple[Float[Array, "N 3"], Float[Array, "N 3"], Float[Array, "N K"], float]:
    """Points spread evenly by area over the rest surface, normals, blend weights, area (m^2)."""
    return SurfacePlaces.drawn(body, count, 1.0, rng).sampled(body)


def _sample_capsules(
    sequence: Sequence, count: int, rng: np.random.Generator
) -> tuple[Float[Array, "N 3"], Float[Array, "N 3"], Float[Array, "N K"], float]:
    skeleton = sequence.body.skeleton
    points, normals, joints, area = _capsule_points(skeleton, _CANDIDATES * count, rng)
    weights = np.zeros((len(points), len(JOINT_NAMES)))
    # a point follows its bone, and shares the next one near the joint between them
    weights[np.arange(len(points)), joints] = 1.0
    votes, frames = np.zeros(len(points)), range(0, len(sequence.train), 4)
    for index in frames:
        votes += _inside_mask(sequence, index, points, joints)
    inside = np.flatnonzero(votes >= _MASK_VOTES * len(frames))
    if len(inside) < 100:
        raise InvalidInput(
            f"masks must cover the skeleton; got {len(inside)} of {len(points)} points of the "
            "limbs inside them; check the camera and the poses"
        )
    chosen = rng.choice(inside, count, replace=len(inside) < count)
    return points[chosen], normals[chosen], weights[chosen], area


def _capsule_points(
    skeleton: Skeleton, count: int, rng: np.random.Generator
) -> tuple[Float[Array, "N 3"], Float[Array, "N 3"], Array, float]:
    """Points on the capsules, normals, the joint that moves each, and the capsules' area."""
    rest, bones = skeleton.rest_joints, []
    for child, parent in enumerate(skeleton.parents):
        name = skeleton.names[child].split("_")[-1].rstrip("123")
        end = rest[child] + ([0.0, 0.14, 0.0] if name == "head" else 0.0)
        if parent >= 0:
            mover = child if name == "head" else parent
            bones.append((rest[parent], end, mover, _CAPSULE_RADIUS_M[name]))
    areas = np.array([2 * np.pi * r * (np.linalg.norm(b - a) + r) for a, b, _, r in bones])
    shares = rng.multinomial(count, areas / areas.sum())
    points, normals, joints = [], [], []
    for (start, end, mover, radius), share in zip(bones, shares, strict=True):
        turn = rotation_between(np.array([0.0, 1.0, 0.0]), end - start + 1e-9)
        angle = rng.uniform(0.0, 2.0 * np.pi, share)
        ring = radius * np.stack([np.cos(angle), np.zeros(share), np.sin(angle)], axis=1)
        along = rng.uniform(size=(share, 1))
        points.append(start + along * (end - start) + ring @ turn.T)
        normals.append(ring @ turn.T / radius)
        joints.append(np.full(share, mover))
    total = float(areas.sum())
    return np.concatenate(points), np.concatenate(normals), np.concatenate(joints), total


def _inside_mask(sequence: Sequence, index: int, points: Array, joints: Array) -> Array:
    camera, pose, mask = (
        sequence.train.camera(index),
        sequence.train.pose(index),
        sequence.train.mask(index),
    )
    moved = sequence.body.skeleton.skinning_transforms(pose.joint_angles, pose.root_translation)
    posed = np.einsum("nij,nj->ni", moved[joints][:, :3, :3], points) + moved[joints][:, :3, 3]
    pixels, _ = camera.project(posed)
    column = np.clip(pixels[:, 0].astype(int), 0, camera.width - 1)
    row = np.clip(pixels[:, 1].astype(int), 0, camera.height - 1)
    return mask[row, column] > 0.5
