"""What a GPU brings: splats by our kernels and by gsplat, the paper's field, how fast it learns.

Pose to picture, batch 1, transforms and cameras made anew each frame, synchronised: on the device,
and as far as the host's memory, where a room is put behind. Both rasterisers take turns, frame by
frame; gsplat is asked where it can be imported, its splats skinned by torch on the device.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import torch

from benchmarks.field_speed import fitted, with_speed_ups
from benchmarks.frontier.training import figures_of
from benchmarks.inputs import require_cuda
from benchmarks.reporting.figures import FigureWriter
from benchmarks.reporting.timing import milliseconds
from benchmarks.serve import SIZES, StudioPerformers
from capture.body.model import load_body_model
from capture.storage import open_sequence
from capture.studio import make_sequence
from renderer.devices import best_device
from renderer.evaluation.evaluate import evaluate
from renderer.evaluation.metrics import psnr
from renderer.field.rendering.field_renderer import FieldRenderer
from renderer.presets import EXACT, find_preset
from renderer.reference.splats import quaternion_matrix
from renderer.splats.layout import BOX_FILTER_PX2, COLOUR, LOG_SCALE, OPACITY, POSITION, ROTATION
from renderer.splats.rasteriser.gpu import GpuSplatRenderer
from renderer.training import train
from scene.arrays import Array, Tensor
from scene.camera import Camera, orbit_camera
from scene.motion import Pose
from scene.skeleton import JOINT_NAMES

CROWDS = ((10_000, 1), (10_000, 4), (50_000, 1), (50_000, 8))
FIELD_SIZES = (256, 512, 1024)
PRESET = "+".join(["paper", *EXACT])
_VIEWS, _WARM_UPS, _FIELD_VIEWS = 100, 10, 20
_FIT_STEPS = 400
_FRAMES, _SIDE = 60, 256


def run(writer: FigureWriter, seconds: list[float]) -> None:
    """Measure and report, training for each of `seconds`.

    Raises InvalidInput where there is no CUDA device.
    """
    require_cuda()
    device = best_device()
    figures: dict[str, Any] = {"device": torch.cuda.get_device_name(device), "batch": 1}
    figures["gsplat"] = find_spec("gsplat") is not None
    figures["splats"] = [
        _splats(count, people, size, device) for count, people in CROWDS for size in SIZES
    ]
    figures["fields"] = _fields("paper", device)
    figures |= {"frames": _FRAMES, "training_px": _SIDE}
    figures["training"] = [_trained(budget_s) for budget_s in seconds]
    writer.write(figures)


def _splats(count: int, people: int, size: int, device: torch.device) -> dict[str, Any]:
    """Milliseconds of some performers at one size, by all who can draw it."""
    performers = StudioPerformers(count, people)
    renderer = GpuSplatRenderer(performers.models, device)
    rasterisers: dict[str, Callable[[Array, Camera], Any]] = {"device": renderer.draw}
    if find_spec("gsplat") is not None:
        rasterisers["gsplat"] = _Gsplat(performers, device)
    rasterisers["host"] = lambda moved, camera: renderer.render(camera, [moved])
    taken: dict[str, list[float]] = {name: [] for name in rasterisers}
    for view in range(-_WARM_UPS, _VIEWS):
        camera, transforms = performers.camera(view, size), performers.transforms(view)
        moved = np.concatenate(transforms).astype(np.float32)
        for name, draw in rasterisers.items():
            spent_s = _seconds(lambda d=draw, m=moved, c=camera: d(m, c))
            if view >= 0:
                taken[name].append(spent_s)
    row: dict[str, Any] = {"splats": count, "performers": people, "size": size}
    for name, spent in taken.items():
        row |= {f"{name}_{key}": value for key, value in milliseconds(spent).items()}
    if "gsplat" in taken:
        row["times_faster"] = round(row["gsplat_p50_ms"] / row["device_p50_ms"], 2)
    print(row, flush=True)
    return row


def _seconds(draw: Callable[[], Any]) -> float:
    torch.cuda.synchronize()
    started = time.perf_counter()
    draw()
    torch.cuda.synchronize()
    return time.perf_counter() - started


class _Gsplat:
    """gsplat (Ye et al. 2025) of skinned splats: torch skins, gsplat projects, sorts and blends."""

    def __init__(self, performers: StudioPerformers, device: torch.device) -> None:
        def joined(parts: list[Array]) -> Tensor:
            return torch.from_numpy(np.concatenate(parts)).to(device)

        self._device, joints = device, len(JOINT_NAMES)
        parameters = joined([model.parameters for model in performers.models])
        self._weights = joined([model.weights for model in performers.models])
        self._joints = joined(
            [
                model.joints.astype(np.int64) + joints * n
                for n, model in enumerate(performers.models)
            ]
        )
        self._rest = parameters[:, POSITION : POSITION + 3]
        lengths = parameters[:, LOG_SCALE : LOG_SCALE + 3].exp()
        turned = quaternion_matrix(parameters[:, ROTATION : ROTATION + 4])
        self._axes = turned * lengths[:, None]
        self._opacity = parameters[:, OPACITY].sigmoid()
        self._colour = parameters[:, COLOUR : COLOUR + 3].contiguous()

    def __call__(self, moved: Array, camera: Camera) -> Tensor:
        from gsplat import rasterization  # pyright: ignore[reportMissingImports]

        transforms = torch.from_numpy(moved).to(self._device)
        blended = torch.einsum("nk,nkij->nij", self._weights, transforms[self._joints][:, :, :3])
        means = torch.einsum("nij,nj->ni", blended[:, :, :3], self._rest) + blended[:, :, 3]
        axes = blended[:, :, :3] @ self._axes
        view = np.vstack([camera.world_to_camera, [0.0, 0.0, 0.0, 1.0]]).astype(np.float32)
        lens = camera.intrinsics.astype(np.float32)
        picture, _, _ = rasterization(
            means,
            None,
            None,
            self._opacity,
            self._colour,
            torch.from_numpy(view)[None].to(self._device),
            torch.from_numpy(lens)[None].to(self._device),
            camera.width,
            camera.height,
            eps2d=BOX_FILTER_PX2,
            covars=axes @ axes.mT,
            packed=False,
        )
        return picture


def _fields(name: str, device: torch.device) -> list[dict[str, Any]]:
    """Milliseconds of a field with all exact speed-ups, and how far its picture is from the slow
    path's, which is timed too at the smallest size."""
    settings = find_preset(name).field_settings
    model = load_body_model()
    field = fitted(settings, model.body(np.zeros(model.shape_count)), _FIT_STEPS).to(device)
    cells = field.occupied
    assert cells is not None
    field.occupied = replace(
        cells, low=cells.low.to(device), high=cells.high.to(device), live=cells.live.to(device)
    )
    slow = FieldRenderer(with_speed_ups(field, settings.sizes, ()))
    quick = FieldRenderer(with_speed_ups(field, settings.sizes, EXACT))
    rows = []
    for size in FIELD_SIZES:
        taken = [_seconds(lambda v=v, s=size: _drawn(quick, v, s)) for v in range(_FIELD_VIEWS)]
        row = {"preset": name, "size": size, **milliseconds(taken[2:])}
        row["frames_a_second"] = round(1e3 / row["p50_ms"], 1)
        if size == FIELD_SIZES[0]:
            plain = _drawn(slow, 0, size)
            row["slow_ms"] = round(1e3 * _seconds(lambda s=size: _drawn(slow, 0, s)), 1)
            apart = psnr(_drawn(quick, 0, size)[..., :3], plain[..., :3])
            row["db_to_slow"] = round(min(apart, 150.0), 1)
        print(row, flush=True)
        rows.append(row)
    return rows


def _drawn(renderer: FieldRenderer, view: int, size: int) -> Array:
    """A view of the number `view`, its pose a little other than the last one's."""
    camera = orbit_camera((0.0, 0.9, 0.0), 3.2, 0.3 + 0.1 * view, 0.05, size, size)
    angles = np.zeros((len(JOINT_NAMES), 3))
    angles[JOINT_NAMES.index("left_shoulder"), 2] = -1.0 + 0.02 * view
    angles[JOINT_NAMES.index("right_shoulder"), 2] = 1.0
    return renderer.render(camera, Pose(angles, np.zeros(3)))


def _trained(budget_s: float) -> dict[str, Any]:
    """The paper's field after so many seconds of its whole schedule, which shrinks to fit."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "clip"
        make_sequence(path, frames=_FRAMES, size=_SIDE)
        clip = open_sequence(path)
        model = train(clip, preset=PRESET, budget_s=budget_s, clock=time.perf_counter)
        row = {"budget_s": budget_s, **figures_of(model, evaluate(model, clip))}
    print({key: value for key, value in row.items() if key != "conditions"}, flush=True)
    return row
