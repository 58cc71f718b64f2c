"""Trains one field from a sequence: rays of a few frames a step, random backgrounds, Adam."""

from __future__ import annotations

import json
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch

from renderer.devices import best_device, on_device, on_host
from renderer.evaluation.lpips import Lpips
from renderer.field.field import PersonField
from renderer.field.model import FieldModel
from renderer.field.rendering.field_renderer import FieldRenderer
from renderer.field.rendering.ray_marching import (
    Samples,
    alphas,
    composite,
    compositing_weights,
    joined,
    march,
    steps_of,
)
from renderer.field.settings import FieldSettings
from renderer.field.skinning.inverse_skinning import WeightVolume, blended_inverse
from renderer.field.skinning.posed_body import LEAST_LIKELIHOOD, Support, direct_canonical
from renderer.field.skinning.posed_grid import PosedGrid
from renderer.field.training.pruning import occupied_cells, prune_grid
from renderer.field.training.views import TrainingView, read_views
from renderer.person_frames import frames_with_person
from scene.arrays import Array, Float, Int, Tensor
from scene.motion import Motion
from scene.rotations import axis_angle_to_matrix, matrix_to_axis_angle
from scene.sequence import PoseTrust, Sequence

_PREVIEW_PX = 128
_PREVIEW_BACKGROUND = 0.93
_BETAS = (0.9, 0.99)


_PARTS = 2
"""Parts of a step that run side by side on a CPU, each on one thread. On shared cores this beats
threads inside each operation many times over: those wait for each other at thousands of small
operations. Always two, so that one seed gives one result whatever the number of cores."""
_BEHIND_M = 0.03
"""How far behind the last visible sample a ray goes on."""
_VANISHED = 1e-3
"""Share of the mask's alpha below which the person has vanished."""
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
        self._generator = torch.Generator().manual_seed(seed)
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)  # layers draw their first weights from the global generator
            field = PersonField.for_body(settings.sizes, sequence.body)
        self.device = best_device()
        self.field = field.to(self.device)
        self._refines = (
            self.field.refiner is not None and sequence.pose_trust is not PoseTrust.EXACT
        )
        self._volume = self.field.weight_volume()
        with torch.no_grad():
            self._support = Support.of(self._volume)
        views = read_views(
            sequence.train, self.device, least_px=settings.patch_px, most_px=settings.most_px
        )
        shown = frames_with_person(view.shows_person for view in views)
        self._views = [views[frame] for frame in shown]
        self._adam = torch.optim.Adam(self._groups(), betas=_BETAS, fused=True)
        self._base_rates = [float(group["lr"]) for group in self._adam.param_groups]
        self._lpips = None
        if settings.lpips_backbone is not None:
            self._lpips = Lpips(settings.lpips_backbone).to(self.device)
        self._parameters = [p for group in self._adam.param_groups for p in group["params"]]
        self._pool = ThreadPoolExecutor(torch.get_num_threads(), initializer=_one_thread)
        self._rate_factor = 1.0
        self._queue: list[int] = []
        self._rendered_frames: set[int] = set()
        """Frames in which the person has been rendered."""

    def warm_up(self) -> None:
        """Nothing is compiled."""

    def before_step(self, fraction: float) -> None:
        """Nothing: a field keeps the captured colours."""

    def step(self, fraction: float) -> float:
        """One step at `fraction` of the schedule; returns the loss: NaN where its gradients are not
        finite (nothing is then learnt), infinite where the person has vanished from the picture."""
        self._schedule(fraction)
        frames = self._next_frames()
        # a GPU is bound by launches, which parts would double
        shares = _PARTS if self.device.type == "cpu" else 1
        seeds = torch.randint(2**62, (shares,), generator=self._generator).tolist()
        parts = [part for part in (frames[first::shares] for first in range(shares)) if part]
        done = self._pool.map(
            lambda part, seed: self._gradients(part, seed, fraction), parts, seeds[: len(parts)]
        )
        loss, rendered_alpha, mask_alpha = 0.0, 0.0, 0.0
        self._adam.zero_grad(set_to_none=True)
        for part_loss, (part_rendered_alpha, part_mask_alpha), gradients in done:
            loss, rendered_alpha, mask_alpha = (
                loss + part_loss,
                rendered_alpha + part_rendered_alpha,
                mask_alpha + part_mask_alpha,
            )
            for parameter, gradient in zip(self._parameters, gradients, strict=True):
                if gradient is not None:
                    total = gradient if parameter.grad is None else parameter.grad + gradient
                    parameter.grad = total.contiguous()  # as CUDA's fused Adam wants it
        if self._has_vanished(frames, rendered_alpha, mask_alpha):
            return float("inf")
        # a sum is finite where its terms are, and is had in one pass over 64 M of them
        sums = [p.grad.sum() for p in self._parameters if p.grad is not None]
        if sums and not bool(torch.stack(sums).sum().isfinite()):
            return float("nan")
        self._adam.step()
        return loss

    def _has_vanished(self, frames: list[int], rendered_alpha: float, mask_alpha: float) -> bool:
        """Whether frames that once rendered the person render nothing any more. (A frame with a
        wrong pose may never render anything, and must not stop the others.)"""
        if rendered_alpha > _VANISHED * mask_alpha:
            self._rendered_frames.update(frames)
            return False
        return mask_alpha > 0.0 and self._rendered_frames.issuperset(frames)

    def _gradients(
        self, frames: list[int], seed: int, fraction: float
    ) -> tuple[float, tuple[float, float], tuple[Tensor | None, ...]]:
        """Share of the step's loss that some of its frames make, the alpha that was rendered and
        the mask's in the same pixels (sums), and the gradients."""
        generator = torch.Generator().manual_seed(seed)
        learnt = self.field.motion.latent is not None
        volume = self.field.weight_volume() if learnt else self._volume
        bundles = [self._sample_rays(self._views[f], volume, fraction, generator) for f in frames]
        truth = torch.cat([bundle.view.truth(bundle.pixels) for bundle in bundles])
        if len(truth) == 0:  # no person in these frames
            return 0.0, (0.0, 0.0), (None,) * len(self._parameters)
        share = len(frames) / min(self._settings.frames_a_step, len(self._views))
        rendered = self._render(bundles)
        on_body = truth[:, 3] > 0.5
        alpha = float(rendered[on_body, 3].detach().sum()), float(on_body.sum())
        loss = share * self._loss(rendered, truth, generator)
        gradients: tuple[Tensor | None, ...] = (None,) * len(self._parameters)
        if loss.requires_grad:
            gradients = torch.autograd.grad(loss, self._parameters, allow_unused=True)
        return float(loss.detach()), alpha, gradients

    def _loss(
        self,
        rendered: Float[Tensor, "R 4"],
        truth: Float[Tensor, "R 4"],
        generator: torch.Generator,
    ) -> Tensor:
        """Difference over random backgrounds, which constrains alpha too."""
        settings = self._settings
        patch = settings.patch_px**2 or 1
        colours = torch.rand(len(rendered) // patch, 3, generator=generator).to(self.device)
        background = colours.repeat_interleave(patch, dim=0)
        one, other = (rgba[:, :3] + (1.0 - rgba[:, 3:]) * background for rgba in (rendered, truth))
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

    def _sample_pixels(self, view: TrainingView, generator: torch.Generator) -> Int[Tensor, "R"]:
        settings = self._settings
        if settings.patch_px == 0:
            return view.pick(settings.rays_a_frame, settings.beside_share, generator)
        count = max(1, settings.rays_a_frame // settings.patch_px**2)
        return view.pick_patches(count, settings.patch_px, settings.on_body_share, generator)

    def _sample_rays(
        self, view: TrainingView, volume: WeightVolume, fraction: float, generator: torch.Generator
    ) -> _Bundle:
        """Some rays of one frame, with the canonical point and likelihood of their samples."""
        field, settings = self.field, self._settings
        refine = self._refines and fraction >= settings.refine_from
        transforms = field.transforms(view.joint_angles, view.root_translation, refine=refine)
        view.prepare(field, volume, self._support, transforms.detach())
        pixels = self._sample_pixels(view, generator)
        jitter = torch.rand(len(pixels), generator=generator).to(self.device)
        sizes, cells = settings.sizes, view.cells
        *rays, span = view.rays(pixels)
        steps = steps_of(span, sizes.step_m, sizes.samples_a_ray)
        samples = march(cells, rays[0], rays[1], span, steps, jitter)
        if isinstance(cells, PosedGrid):
            found, likelihood = cells.canonical(samples.points)
            if refine:
                found = blended_inverse(samples.points, transforms, volume.at(found))
        else:
            support = None if cells is None else self._support
            found, likelihood = direct_canonical(
                samples.points, transforms, volume, sizes.inverse_rounds, support
            )
        if cells is not None:
            keep = likelihood.detach() > LEAST_LIKELIHOOD
            samples, found, likelihood = samples.kept(keep), found[keep], likelihood[keep]
        found = field.moved(found, view.joint_angles)
        return _Bundle(samples, found, likelihood, view, pixels)

    def _render(self, bundles: list[_Bundle]) -> Float[Tensor, "R 4"]:
        """Premultiplied RGBA of all rays; samples behind opaque ones are not evaluated."""
        canonical = self.field.canonical
        samples = joined([bundle.samples for bundle in bundles])
        likelihood = torch.cat([bundle.likelihood for bundle in bundles])
        place = canonical.located(torch.cat([bundle.canonical for bundle in bundles]))
        if canonical.has_grid:
            with torch.no_grad():
                alpha = alphas(canonical.density_at(place), likelihood, samples.step)
                visible = compositing_weights(alpha, samples)[1] > _HIDDEN
                self._end_rays(bundles, samples, visible)
            samples, place, likelihood = (
                samples.kept(visible),
                place.kept(visible),
                likelihood[visible],
            )
        colours, density = canonical.at(place)
        weights, _ = compositing_weights(alphas(density, likelihood, samples.step), samples)
        return composite(weights, colours, samples)

    def _end_rays(self, bundles: list[_Bundle], samples: Samples, visible: Tensor) -> None:
        """Note where each opaque ray's last visible sample lies: the next visit ends soon after.

        Should that skin be carved away, the ray sees further and so ends further.
        """
        last = torch.full((samples.rays,), -1.0, device=self.device)
        ray, distance = samples.ray[visible], samples.t[visible]
        last = last.scatter_reduce(0, ray, distance, "amax")
        hidden = torch.zeros(samples.rays, dtype=torch.bool, device=self.device)
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
        """Weights, Adam's moments and the random state."""
        state = {f"field.{name}": _copied(p) for name, p in self.field.named_parameters()}
        for place, parameter in enumerate(self.field.parameters()):
            for name, value in self._adam.state.get(parameter, {}).items():
                state[f"adam.{place}.{name}"] = _copied(value)
        state["chance"] = _copied(self._generator.get_state())
        state["about"] = np.array(json.dumps({"queue": self._queue, "slower": self._rate_factor}))
        return state

    def restore(self, state: dict[str, Array]) -> None:
        """Go back to `state`."""
        with torch.no_grad():
            for name, parameter in self.field.named_parameters():
                parameter.copy_(on_device(state[f"field.{name}"], self.device))
        self._adam.state.clear()
        for place, parameter in enumerate(self.field.parameters()):
            prefix = f"adam.{place}."
            stored = {k[len(prefix) :]: v for k, v in state.items() if k.startswith(prefix)}
            if stored:
                self._adam.state[parameter] = {
                    name: on_device(value, self.device) for name, value in stored.items()
                }
        self._generator.set_state(on_device(state["chance"], self._generator.device))
        about = json.loads(str(state["about"]))
        self._queue, self._rate_factor = list(about["queue"]), float(about["slower"])

    def halve_learning_rate(self) -> None:
        """Halve all rates."""
        self._rate_factor *= 0.5

    def finish(self, metrics: dict[str, Any]) -> FieldModel:
        """The model as trained: floaters pruned, baked where its preset says so, and its table
        rounded as model files keep it."""
        field = self.field
        field.requires_grad_(False)
        if field.canonical.table is None:
            field.occupied = occupied_cells(field.canonical, field.weight_volume())
        elif field.shell is not None:
            prune_grid(field.canonical, on_device(field.shell.deep, self.device))
            field.canonical.table.copy_(field.canonical.table.half().float())
        if field.sizes.baked:
            field.bake()
        published = self._settings.iterations
        if published is not None:
            scale = metrics["steps"] / published
            metrics = {
                **metrics,
                "published_iterations": published,
                "schedule_scale": scale,
                "rays_a_step": self._settings.rays_a_frame * self._settings.frames_a_step,
                "samples_a_ray": self._settings.sizes.samples_a_ray,
                "perceptual_loss": None if self._lpips is None else self._lpips.backbone,
            }
        return FieldModel(
            field,
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
        share = self._rate_factor * settings.last_rate_share**fraction
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
            self._queue = torch.randperm(len(self._views), generator=self._generator).tolist()
        frames, self._queue = self._queue[:count], self._queue[count:]
        return frames

    @torch.no_grad()
    def _motion(self) -> Motion:
        """The clip's motion as the refiner left it."""
        motion = self._sequence.motion
        if not self._refines or self.field.refiner is None:
            return motion
        given = on_device(motion.joint_angles, self.device, torch.float32)
        change = axis_angle_to_matrix(on_host(self.field.refiner(given).double()))
        angles = matrix_to_axis_angle(axis_angle_to_matrix(motion.joint_angles) @ change)
        angles[:, 0] = motion.joint_angles[:, 0]
        return replace(motion, joint_angles=angles)


def _one_thread() -> None:
    torch.set_num_threads(1)


def _copied(value: Tensor) -> Array:
    return on_host(value).copy()
