"""Trains one field from a sequence: rays of a few frames a step, random backgrounds, Adam."""

from __future__ import annotations

import json
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

from renderer.field.drawing import FieldRenderer
from renderer.field.field import PersonField
from renderer.field.marching import (
    Samples,
    alphas,
    blending_weights,
    composite,
    joined,
    march,
    march_all,
)
from renderer.field.model import FieldModel
from renderer.field.posed import LEAST_LIKELIHOOD, Support, direct_canonical
from renderer.field.settings import FieldSettings
from renderer.field.skinning import WeightVolume, blended_inverse
from renderer.field.views import TrainingView, read_views
from renderer.lpips import Lpips
from scene.arrays import Array, Float, Int, Tensor
from scene.motion import Motion
from scene.rotations import axis_angle_to_matrix, matrix_to_axis_angle
from scene.sequence import Sequence

_PREVIEW_PX = 128
_PREVIEW_BACKGROUND = 0.93
_BETAS = (0.9, 0.99)


_PARTS = 2
"""Parts of a step that run side by side, each on one thread. On shared cores this beats threads
inside each operation many times over: those wait for each other at thousands of small operations.
Always two, so that one seed gives one result whatever the machine."""
_BEHIND_M = 0.03
"""How far behind the last visible sample a ray goes on."""
_HIDDEN = 0.01
"""Transmittance below which a training sample is left out: its gradient would be as small."""


@dataclass(frozen=True, eq=False)
class _Bundle:
    """Rays of one frame."""

    samples: Samples
    canonical: Float[Tensor, "N 3"]
    likelihood: Float[Tensor, "N"]
    view: TrainingView
    pixels: Int[Tensor, "R"]


class FieldTrainer:
    """Trains one `FieldModel` (a `Trainer`)."""

    def __init__(self, sequence: Sequence, preset: str, settings: FieldSettings, seed: int) -> None:
        self._sequence, self._preset, self._settings = sequence, preset, settings
        self._chance = torch.Generator().manual_seed(seed)
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)  # layers draw their first weights from the global generator
            self.field = PersonField.for_body(settings.sizes, sequence.body)
        self._refines = self.field.refiner is not None and not sequence.exact_poses
        self._volume = self.field.weight_volume()
        with torch.no_grad():
            self._support = Support.of(self._volume)
        self._views = read_views(sequence.train, settings.patch_px)
        self._adam = torch.optim.Adam(self._groups(), betas=_BETAS, fused=True)
        self._base_rates = [float(group["lr"]) for group in self._adam.param_groups]
        self._lpips = None if settings.lpips_backbone is None else Lpips(settings.lpips_backbone)
        self._parameters = [p for group in self._adam.param_groups for p in group["params"]]
        self._pool = ThreadPoolExecutor(torch.get_num_threads(), initializer=_one_thread)
        self._slower = 1.0
        self._queue: list[int] = []

    def warm_up(self) -> None:
        """Nothing is compiled."""

    def step(self, fraction: float) -> float:
        """One step at `fraction` of the schedule; returns the loss."""
        self._schedule(fraction)
        frames = self._next_frames()
        seeds = torch.randint(2**62, (_PARTS,), generator=self._chance).tolist()
        parts = [part for part in (frames[first::_PARTS] for first in range(_PARTS)) if part]
        done = self._pool.map(
            lambda part, seed: self._gradients(part, seed, fraction), parts, seeds[: len(parts)]
        )
        loss = 0.0
        self._adam.zero_grad(set_to_none=True)
        for part_loss, gradients in done:
            loss += part_loss
            for parameter, gradient in zip(self._parameters, gradients, strict=True):
                if gradient is not None:
                    total = gradient if parameter.grad is None else parameter.grad + gradient
                    parameter.grad = total
        self._adam.step()
        return loss

    def _gradients(
        self, frames: list[int], seed: int, fraction: float
    ) -> tuple[float, tuple[Tensor | None, ...]]:
        """Share of the step's loss that some of its frames make, and its gradients."""
        chance = torch.Generator().manual_seed(seed)
        learnt = self.field.motion.latent is not None
        volume = self.field.weight_volume() if learnt else self._volume
        bundles = [self._rays_of(self._views[f], volume, fraction, chance) for f in frames]
        truth = torch.cat([bundle.view.truth(bundle.pixels) for bundle in bundles])
        if len(truth) == 0:  # nobody in sight
            return 0.0, (None,) * len(self._parameters)
        share = len(frames) / min(self._settings.frames_a_step, len(self._views))
        loss = share * self._loss(self._rendered(bundles), truth, chance)
        if not loss.requires_grad:
            return float(loss), (None,) * len(self._parameters)
        return float(loss.detach()), torch.autograd.grad(loss, self._parameters, allow_unused=True)

    def _loss(
        self, made: Float[Tensor, "R 4"], truth: Float[Tensor, "R 4"], chance: torch.Generator
    ) -> Tensor:
        """Difference over random backgrounds: what the field leaves open must let any through."""
        settings = self._settings
        patch = settings.patch_px**2 or 1
        colours = torch.rand(len(made) // patch, 3, generator=chance)
        background = colours.repeat_interleave(patch, dim=0)
        one, other = (rgba[:, :3] + (1.0 - rgba[:, 3:]) * background for rgba in (made, truth))
        difference = one - other
        if settings.pixel_loss == "l1":
            return difference.abs().mean()
        squared = (difference * difference).mean()
        if self._lpips is None:
            return squared
        side = settings.patch_px
        pair = (rgb.view(-1, side, side, 3).permute(0, 3, 1, 2) for rgb in (one, other))
        perceived = self._lpips(*pair).mean()
        return settings.patch_mse_weight * squared + settings.lpips_weight * perceived

    def _picked(self, view: TrainingView, chance: torch.Generator) -> Int[Tensor, "R"]:
        settings = self._settings
        if settings.patch_px == 0:
            return view.pick(settings.rays_a_frame, settings.beside_share, chance)
        count = max(1, settings.rays_a_frame // settings.patch_px**2)
        return view.pick_patches(count, settings.patch_px, settings.on_body_share, chance)

    def _rays_of(
        self, view: TrainingView, volume: WeightVolume, fraction: float, chance: torch.Generator
    ) -> _Bundle:
        """Some rays of one frame, with the canonical point and likelihood of their samples."""
        field, settings = self.field, self._settings
        refine = self._refines and fraction >= settings.refine_from
        transforms = field.transforms(view.joint_angles, view.root_translation, refine=refine)
        view.prepare(field, volume, self._support, transforms.detach())
        picked = self._picked(view, chance)
        jitter = torch.rand(len(picked), generator=chance)
        rays = (*view.rays(picked), settings.sizes.step_m, jitter)
        if view.grid is None:
            samples = march_all(*rays)
            found, likelihood = direct_canonical(
                samples.points, transforms, volume, settings.sizes.inverse_rounds
            )
        else:
            samples = march(view.grid, *rays)
            found, likelihood = view.grid.canonical(samples.points)
            if refine:
                found = blended_inverse(samples.points, transforms, volume.at(found))
        keep = likelihood.detach() > LEAST_LIKELIHOOD
        found = field.moved(found[keep], view.joint_angles)
        return _Bundle(samples.kept(keep), found, likelihood[keep], view, picked)

    def _rendered(self, bundles: list[_Bundle]) -> Float[Tensor, "R 4"]:
        """Premultiplied RGBA of all rays; samples behind what is opaque already are not asked."""
        canonical, step = self.field.canonical, self._settings.sizes.step_m
        samples = joined([bundle.samples for bundle in bundles])
        likelihood = torch.cat([bundle.likelihood for bundle in bundles])
        place = canonical.located(torch.cat([bundle.canonical for bundle in bundles]))
        if canonical.has_grid:
            with torch.no_grad():
                alpha = alphas(canonical.density_at(place), likelihood, step)
                visible = blending_weights(alpha, samples)[1] > _HIDDEN
                self._end_rays(bundles, samples, visible)
            samples, place, likelihood = (
                samples.kept(visible), place.kept(visible), likelihood[visible]
            )  # fmt: skip
        colours, density = canonical.at(place)
        weights, _ = blending_weights(alphas(density, likelihood, step), samples)
        return composite(weights, colours, samples)

    def _end_rays(self, bundles: list[_Bundle], samples: Samples, visible: Tensor) -> None:
        """Note where each opaque ray's last visible sample lies: the next visit ends soon after.

        Should that skin be carved away, the ray sees further and so ends further.
        """
        last = torch.full((samples.rays,), -1.0)
        ray, distance = samples.ray[visible], samples.t[visible]
        last = last.scatter_reduce(0, ray, distance, "amax")
        hidden = torch.zeros(samples.rays, dtype=torch.bool)
        hidden[samples.ray[~visible]] = True
        start = 0
        for bundle in bundles:
            mine = slice(start, start + bundle.samples.rays)
            start = mine.stop
            ends = hidden[mine]
            bundle.view.shorten(bundle.pixels[ends], last[mine][ends] + _BEHIND_M)

    def preview(self) -> Float[Array, "H W 3"]:
        """The first training view, small, over light grey."""
        camera = self._sequence.train.camera(0)
        scale = _PREVIEW_PX / max(camera.width, camera.height)
        small = camera.resized(round(camera.width * scale), round(camera.height * scale))
        pose = self._sequence.motion.pose(0)
        learnt = self.field.motion.latent is not None
        prepared = None if learnt else (self._volume, self._support)
        draw = self._pool.submit(lambda: FieldRenderer(self.field, prepared).render(small, pose))
        picture = draw.result()
        return picture[..., :3] + (1.0 - picture[..., 3:]) * np.float32(_PREVIEW_BACKGROUND)

    def state(self) -> dict[str, Array]:
        """Weights, Adam's moments, and where chance stands."""
        state = {f"field.{name}": _copied(p) for name, p in self.field.named_parameters()}
        for place, parameter in enumerate(self.field.parameters()):
            for name, value in self._adam.state.get(parameter, {}).items():
                state[f"adam.{place}.{name}"] = _copied(value)
        state["chance"] = _copied(self._chance.get_state())
        state["about"] = np.array(json.dumps({"queue": self._queue, "slower": self._slower}))
        return state

    def restore(self, state: dict[str, Array]) -> None:
        """Go back to `state`."""
        with torch.no_grad():
            for name, parameter in self.field.named_parameters():
                parameter.copy_(torch.from_numpy(state[f"field.{name}"]))
        self._adam.state.clear()
        for place, parameter in enumerate(self.field.parameters()):
            prefix = f"adam.{place}."
            stored = {k[len(prefix) :]: v for k, v in state.items() if k.startswith(prefix)}
            if stored:
                self._adam.state[parameter] = {
                    name: torch.from_numpy(value.copy()) for name, value in stored.items()
                }
        self._chance.set_state(torch.from_numpy(state["chance"].copy()))
        about = json.loads(str(state["about"]))
        self._queue, self._slower = list(about["queue"]), float(about["slower"])

    def slow_down(self) -> None:
        """Halve all rates."""
        self._slower *= 0.5

    def finish(self, metrics: dict[str, Any]) -> FieldModel:
        """The model as trained, its table rounded as model files keep it."""
        table = self.field.canonical.table
        if table is not None:
            with torch.no_grad():
                table.copy_(table.half().float())
        return FieldModel(
            self.field,
            preset=self._preset,
            motion=self._motion(),
            data_hash=self._sequence.data_hash,
            metrics=metrics,
        )

    def _groups(self) -> list[dict[str, Any]]:
        field, settings = self.field, self._settings
        groups = []
        if field.canonical.table is not None:
            groups.append({"params": [field.canonical.table], "lr": settings.table_rate})
        if field.canonical.mlp is not None:
            groups.append({"params": field.canonical.mlp.parameters(), "lr": settings.field_rate})
        for network in (field.refiner, field.motion, field.residual):
            learnt = [] if network is None else list(network.parameters())
            if learnt:
                groups.append({"params": learnt, "lr": settings.motion_rate})
        return groups

    def _schedule(self, fraction: float) -> None:
        settings = self._settings
        share = self._slower * settings.last_rate_share**fraction
        for group, rate in zip(self._adam.param_groups, self._base_rates, strict=True):
            group["lr"] = rate * share
        opened = (fraction - settings.residual_from) / (
            settings.residual_until - settings.residual_from
        )
        self.field.residual_opened = min(opened, 1.0) if opened >= 0.0 else None

    def _next_frames(self) -> list[int]:
        """Different frames; a frame belongs to one part of a step alone."""
        count = min(self._settings.frames_a_step, len(self._views))
        if len(self._queue) < count:
            self._queue = torch.randperm(len(self._views), generator=self._chance).tolist()
        frames, self._queue = self._queue[:count], self._queue[count:]
        return frames

    @torch.no_grad()
    def _motion(self) -> Motion:
        """The clip's motion as the refiner left it."""
        motion = self._sequence.motion
        if not self._refines or self.field.refiner is None:
            return motion
        given = torch.from_numpy(motion.joint_angles).float()
        change = axis_angle_to_matrix(self.field.refiner(given).double().numpy())
        angles = matrix_to_axis_angle(axis_angle_to_matrix(motion.joint_angles) @ change)
        angles[:, 0] = motion.joint_angles[:, 0]
        return Motion(motion.times_s, angles, motion.root_translation, motion.confidence)


def _one_thread() -> None:
    torch.set_num_threads(1)


def _copied(value: Tensor) -> Array:
    return value.detach().numpy().copy()
