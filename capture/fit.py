"""The clip-wide fit: one body shape, one camera and a smooth motion that explain a whole clip.

SPIN's idea (Kolotouros et al. 2019) of regression followed by optimisation: the estimator's 3D
landmarks give each frame a start in closed form, then everything is refined together. Terms: seen
landmarks (robust), 3D landmarks, pose prior and joint limits, accelerations, then the silhouette.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np
import torch

from capture.body import BodyModel
from capture.errors import CaptureStopped
from capture.fit_initial import TO_Y_UP, solve_pose, solve_translation
from capture.fit_landmarks import MIRROR, LandmarkModel, place_landmarks
from capture.fit_silhouette import Silhouettes, prepare_silhouettes, silhouette_energy
from capture.fit_terms import (
    forward,
    pose_prior,
    project,
    rigid_points,
    robust,
    rotation_matrices,
    skinned_points,
    time_steps,
    unsteadiness,
)
from capture.landmarks import LANDMARK_NAMES, Landmarks
from scene.arrays import Array, Float, Tensor
from scene.rotations import axis_angle_to_matrix, matrix_to_axis_angle, slerp
from scene.skeleton import JOINT_COUNT, JOINT_NAMES

USUAL_FOCAL = 0.87
"""Focal length of phones and webcams, in longest sides of the picture (60 degrees)."""
_FOCAL_DEVIATION = 0.12
"""Of the logarithm of the focal length."""
_SHAPE_DEVIATION = (0.07, 0.25, 0.3, 0.25, 0.25)
"""Of height (in 1.03 m), weight, gender, muscle, proportions."""
_ACCELERATION_M_S2 = 12.0
_WORLD_DEVIATION_M = 0.07
_OFFSET_DEVIATION_M = 0.02
_PIXEL_DEVIATION = 0.008
"""Of a landmark, in heights of the person."""
_VERTEX_SPACING_M = 0.05
_SHOWN_BY = {"shoulder": "elbow", "elbow": "wrist", "wrist": "index", "hip": "knee",
             "knee": "ankle", "ankle": "foot_index"}  # fmt: skip
_LANDMARK_STEPS, _SILHOUETTE_STEPS = 260, 240
_NEAREST_EVERY = 8


@dataclass(frozen=True, eq=False)
class Fit:
    """What the fit found. Frame "seen": y up, z towards the camera, origin at the camera."""

    shape: Float[Array, "B"]
    focal_px: float
    joint_angles: Float[Array, "F 24 3"]
    """rad; joint 0 turns the body in the seen frame."""
    pelvis: Float[Array, "F 3"]
    """Place of joint 0, m, seen frame."""
    landmark_error_px: Float[Array, "F 33"]
    """Distance of the projected landmark from the seen one; NaN where it was not seen."""
    weights: Float[Array, "F 33"]
    """Trust in each landmark, 0 to 1."""


class _Problem:
    """Data and unknowns of one clip, as tensors."""

    def __init__(
        self,
        people: Sequence[Landmarks],
        masks: Sequence[Float[Array, "H W"] | None],
        times_s: Float[Array, "F"],
        takes: Array,
        model: BodyModel,
        focal_px: float | None,
    ) -> None:
        self.model, self.marks = model, place_landmarks(model)
        self.silhouettes: Silhouettes = prepare_silhouettes(masks)
        self.width, self.height = self.silhouettes.width, self.silhouettes.height
        self.centre = torch.tensor([0.5 * self.width, 0.5 * self.height])
        self.focal_known = focal_px is not None
        self.focal0 = focal_px or USUAL_FOCAL * max(self.width, self.height)
        self.pixels, self.world, self.weights = landmark_arrays(people, self.width, self.height)
        self.steps = time_steps(times_s, takes)
        self.extent = person_height_px(self.pixels)
        self._tensors(self.marks)
        self._start()

    def _tensors(self, marks: LandmarkModel) -> None:
        def tensor(value: Array) -> Tensor:
            return torch.tensor(value, dtype=torch.float32)

        model = self.model
        chosen = sampled_vertices(model.rest_vertices, _VERTEX_SPACING_M)
        self.joints0, self.joints1 = tensor(model.rest_joints), tensor(model.joint_directions)
        self.marks0, self.marks1 = tensor(marks.rest), tensor(marks.directions)
        self.mark_joints = torch.tensor(marks.joints)
        self.skin0 = tensor(model.rest_vertices[chosen])
        self.skin1 = tensor(model.vertex_directions[chosen])
        self.skin_weights = tensor(model.blend_weights[chosen])
        self.seen_pixels, self.seen_weights = tensor(self.pixels), tensor(self.weights)
        self.seen_world = tensor(self.world * TO_Y_UP)
        self.mirror = torch.tensor(MIRROR)
        self.prior, self.hidden = pose_prior(), tensor(hidden_joints(self.weights))

    def _start(self) -> None:
        angles, pelvis = start_poses(self)
        self.root0 = torch.tensor(axis_angle_to_matrix(angles[:, 0]), dtype=torch.float32)
        body = torch.tensor(angles, dtype=torch.float32)
        body[:, 0] = 0.0
        self.angles = body.requires_grad_()
        self.pelvis = torch.tensor(pelvis, dtype=torch.float32).requires_grad_()
        self.shape = torch.zeros(self.model.shape_count, requires_grad=True)
        self.log_focal = torch.zeros((), requires_grad=True)
        self.log_scale = torch.zeros((), requires_grad=True)
        self.offsets = torch.zeros(len(LANDMARK_NAMES), 3, requires_grad=True)

    def rotations(self) -> Tensor:
        """Local rotations [F 24 3 3]; the root's is the start's, turned by the first angle."""
        local = rotation_matrices(self.angles)
        return torch.cat([(self.root0 @ local[:, 0])[:, None], local[:, 1:]], 1)

    def posed(self) -> tuple[Tensor, Tensor, Tensor]:
        """World rotations, joints [F 24 3] and rest joints."""
        rest = self.joints0 + self.joints1 @ self.shape
        turned, placed = forward(self.rotations(), self.pelvis, rest)
        return turned, placed, rest

    def focal(self) -> Tensor:
        return self.focal0 * torch.exp(self.log_focal)

    def landmarks(self, turned: Tensor, placed: Tensor, rest: Tensor) -> Tensor:
        """The model's landmarks [F 33 3], offsets mirrored between the sides."""
        mirrored = self.offsets[self.mirror] * torch.tensor([-1.0, 1.0, 1.0])
        points = self.marks0 + self.marks1 @ self.shape + 0.5 * (self.offsets + mirrored)
        return rigid_points(turned, placed, rest, points, self.mark_joints)

    def surface_pixels(self, turned: Tensor, placed: Tensor, rest: Tensor) -> Tensor:
        points = self.skin0 + self.skin1 @ self.shape
        skin = skinned_points(turned, placed, rest, points, self.skin_weights)
        return project(skin, self.focal(), self.centre)

    def energy(self, nearest: Tensor | None) -> Tensor:
        """Mean over frames of all terms; the silhouette joins in when `nearest` is given."""
        turned, placed, rest = self.posed()
        marks = self.landmarks(turned, placed, rest)
        off = (project(marks, self.focal(), self.centre) - self.seen_pixels) / (
            _PIXEL_DEVIATION * self.extent
        )
        seen = (robust(off.square().sum(-1)) * self.seen_weights).sum(1).mean()
        depth = self._world_energy(marks)
        steady = unsteadiness(placed, *self.steps, _ACCELERATION_M_S2).sum() / len(placed)
        total = seen + 0.5 * depth + 0.5 * self.prior.energy(self.angles, self.hidden).mean() + steady
        total = total + self._once_a_clip()
        if nearest is not None:
            edge = silhouette_energy(
                self.silhouettes,
                self.surface_pixels(turned, placed, rest),
                nearest,
                _PIXEL_DEVIATION * self.extent,
            )
            total = total + 6.0 * edge.mean()
        return total

    def _world_energy(self, marks: Tensor) -> Tensor:
        """Against the estimator's 3D landmarks, whose size is its own guess: one scale a clip."""
        weight = self.seen_weights[..., None]
        total = weight.sum(1, keepdim=True).clamp_min(1e-6)
        ours = marks - (marks * weight).sum(1, keepdim=True) / total
        theirs = self.seen_world - (self.seen_world * weight).sum(1, keepdim=True) / total
        off = (ours - theirs * torch.exp(self.log_scale)) / _WORLD_DEVIATION_M
        return (robust(off.square().sum(-1)) * self.seen_weights).sum(1).mean()

    def _once_a_clip(self) -> Tensor:
        shape = (self.shape / torch.tensor(_SHAPE_DEVIATION)).square().sum()
        offsets = (self.offsets / _OFFSET_DEVIATION_M).square().sum()
        return 0.5 * shape + 0.1 * offsets + 0.5 * (self.log_focal / _FOCAL_DEVIATION).square()

    def result(self) -> Fit:
        with torch.no_grad():
            turned, placed, rest = self.posed()
            marks = self.landmarks(turned, placed, rest)
            off = project(marks, self.focal(), self.centre) - self.seen_pixels
            error = off.norm(dim=-1).numpy().astype(np.float64)
            angles = matrix_to_axis_angle(self.rotations().numpy().astype(np.float64))
            return Fit(
                self.shape.numpy().astype(np.float64),
                float(self.focal()),
                angles,
                self.pelvis.numpy().astype(np.float64),
                np.where(self.weights > 0.0, error, np.nan),
                self.weights,
            )


def fit_clip(
    people: Sequence[Landmarks | None],
    masks: Sequence[Float[Array, "H W"] | None],
    times_s: Float[Array, "F"],
    takes: Sequence[int],
    model: BodyModel,
    *,
    focal_px: float | None = None,
    on_progress: Callable[[float], None] = lambda _: None,
    should_stop: Callable[[], bool] = lambda: False,
) -> Fit:
    """Fit `model` to one person's landmarks and masks over a clip (None: lost frames, bridged).

    `focal_px` is in pixels of the masks; None estimates it about that of usual cameras. Raises
    CaptureStopped when asked to stop. The same input gives the same result.
    """
    found = [index for index, person in enumerate(people) if person is not None]
    problem = _Problem(
        [person for person in people if person is not None],
        [masks[index] for index in found],
        times_s[found],
        np.asarray(takes)[found],
        model,
        focal_px,
    )
    with _one_thread():
        _minimise(problem, on_progress, should_stop)
    return _with_lost_frames(problem.result(), np.array(found), times_s)


def _with_lost_frames(fit: Fit, found: Array, times_s: Array) -> Fit:
    """`fit` of the `found` frames, spread to all: lost ones are bridged and trusted in nothing."""
    angles, pelvis = bridged(found, fit.joint_angles, fit.pelvis, times_s)
    error = np.full((len(times_s), len(LANDMARK_NAMES)), np.nan)
    weights = np.zeros_like(error)
    error[found], weights[found] = fit.landmark_error_px, fit.weights
    return replace(
        fit, joint_angles=angles, pelvis=pelvis, landmark_error_px=error, weights=weights
    )


@contextmanager
def _one_thread() -> Iterator[None]:
    """The tensors are small: threads only wait for each other, seventeen times as long if busy.

    Subnormal numbers, which fading gradients become, would be as slow again.
    """
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    torch.set_flush_denormal(True)
    try:
        yield
    finally:
        torch.set_num_threads(before)
        torch.set_flush_denormal(False)


def _minimise(
    problem: _Problem, on_progress: Callable[[float], None], should_stop: Callable[[], bool]
) -> None:
    """First landmarks alone, then the silhouette too, each with a falling rate."""
    total = _LANDMARK_STEPS + _SILHOUETTE_STEPS
    done = 0
    for steps, rate, edge in ((_LANDMARK_STEPS, 0.03, False), (_SILHOUETTE_STEPS, 0.012, True)):
        optimiser = _optimiser(problem, rate)
        nearest = None
        for step in range(steps):
            if should_stop():
                raise CaptureStopped("capture was stopped while fitting the body")
            if edge and step % _NEAREST_EVERY == 0:
                with torch.no_grad():
                    nearest = problem.silhouettes.nearest(problem.surface_pixels(*problem.posed()))
            for group in optimiser.param_groups:
                group["lr"] = group["initial"] * (1.0 - 0.95 * step / steps)
            optimiser.zero_grad()
            problem.energy(nearest).backward()
            optimiser.step()
            done += 1
            on_progress(done / total)


def _optimiser(problem: _Problem, rate: float) -> torch.optim.Adam:
    groups = [(problem.angles, rate), (problem.pelvis, rate), (problem.shape, 0.4 * rate),
              (problem.offsets, 0.1 * rate), (problem.log_scale, 0.3 * rate)]  # fmt: skip
    if not problem.focal_known:
        groups.append((problem.log_focal, 0.2 * rate))
    return torch.optim.Adam(
        [{"params": [value], "lr": lr, "initial": lr} for value, lr in groups], betas=(0.9, 0.99), eps=1e-5
    )


def start_poses(problem: _Problem) -> tuple[Array, Array]:
    """Closed-form poses [F 24 3] and pelvis places [F 3], m."""
    angles = solve_pose(problem.world, problem.weights)
    with torch.no_grad():
        rotations = torch.tensor(axis_angle_to_matrix(angles), dtype=torch.float32)
        turned, placed = forward(rotations, torch.zeros(len(angles), 3), problem.joints0)
        marks = rigid_points(turned, placed, problem.joints0, problem.marks0, problem.mark_joints)
    focal, centre = problem.focal0, problem.centre.numpy()
    intrinsics = np.array([[focal, 0.0, centre[0]], [0.0, focal, centre[1]], [0.0, 0.0, 1.0]])
    points = marks.numpy().astype(np.float64) * TO_Y_UP
    shift = solve_translation(points, problem.pixels, problem.weights, intrinsics)
    return angles, shift * TO_Y_UP


def bridged(found: Array, angles: Array, pelvis: Array, times_s: Array) -> tuple[Array, Array]:
    """Poses of `found` frames spread to all frames: slerp between, the nearest outside."""
    rotations = axis_angle_to_matrix(angles)
    out_angles = np.zeros((len(times_s), *angles.shape[1:]))
    out_pelvis = np.stack(
        [np.interp(times_s, times_s[found], pelvis[:, axis]) for axis in range(3)], 1
    )
    for frame, time_s in enumerate(times_s):
        after = int(np.clip(np.searchsorted(found, frame), 0, len(found) - 1))
        before = max(after - 1, 0) if found[after] > frame else after
        span = times_s[found[after]] - times_s[found[before]]
        share = (time_s - times_s[found[before]]) / span if span > 0.0 else 0.0
        blend = slerp(rotations[before], rotations[after], float(np.clip(share, 0.0, 1.0)))
        out_angles[frame] = matrix_to_axis_angle(blend)
    return out_angles, out_pelvis


def landmark_arrays(
    people: Sequence[Landmarks], width: int, height: int
) -> tuple[Array, Array, Array]:
    """Pixels [F 33 2], world [F 33 3] and trust [F 33] of all frames; no trust outside."""
    pixels = np.zeros((len(people), len(LANDMARK_NAMES), 2))
    world = np.zeros((len(people), len(LANDMARK_NAMES), 3))
    trust = np.zeros((len(people), len(LANDMARK_NAMES)))
    for frame, person in enumerate(people):
        pixels[frame], world[frame] = person.pixels, person.world
        inside = (person.pixels >= 0).all(1) & (person.pixels <= [width, height]).all(1)
        trust[frame] = np.where(inside, person.visibility, 0.0) ** 2
    trust[trust < 0.1] = 0.0
    trust[:, 1:11] *= 0.35  # ten points of one rigid face must not outvote the limbs
    return pixels, world, trust


def hidden_joints(trust: Float[Array, "F 33"]) -> Float[Array, "F 24"]:
    """1 for each limb joint whose motion nothing shows, since the landmark beyond it is not seen."""
    hidden = np.zeros((len(trust), JOINT_COUNT))
    for joint, landmark in _SHOWN_BY.items():
        for side in ("left", "right"):
            unseen = trust[:, LANDMARK_NAMES.index(f"{side}_{landmark}")] <= 0.0
            hidden[:, JOINT_NAMES.index(f"{side}_{joint}")] = unseen
    return hidden


def person_height_px(pixels: Float[Array, "F 33 2"]) -> float:
    """About the standing person's height in px, from the trunk's length (robust over the clip)."""
    left, right = LANDMARK_NAMES.index("left_shoulder"), LANDMARK_NAMES.index("right_shoulder")
    hips = [LANDMARK_NAMES.index(n) for n in ("left_hip", "right_hip")]
    shoulders = 0.5 * (pixels[:, left] + pixels[:, right])
    trunk = np.linalg.norm(shoulders - pixels[:, hips].mean(1), axis=1)
    return float(max(3.4 * np.percentile(trunk, 75), 20.0))


def sampled_vertices(vertices: Float[Array, "V 3"], spacing_m: float) -> Array:
    """Indices of one vertex for each occupied cell of a grid."""
    cells = np.floor(vertices / spacing_m).astype(np.int64)
    return np.sort(np.unique(cells, axis=0, return_index=True)[1])
