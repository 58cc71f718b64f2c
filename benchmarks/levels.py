"""What fewer splats cost and save: half of them at half the size, a change of their number, a full
room on a page without a graphics card and by the server.

Small: dB to the truth on the body's crop in views never trained on, the picture as filmed and of
half its sides (truth made smaller), by the levels of `SHARES` of a model's splats; studio
performers, and a real person at a webcam. Change: how much a picture differs from the one before
when nothing but the number of splats changes, as a share of what a thirtieth of a second of motion
changes. Page and server: pictures a second, and the time of one, with all splats and with the
levels that each chooses.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numba
import numpy as np

from benchmarks.local_view import encoded_text, measuring_page
from benchmarks.real.filmed import film
from benchmarks.real.measure import Networks
from benchmarks.real.ruler import Ruler
from benchmarks.reporting.figures import FigureWriter
from benchmarks.serve import surface_model
from capture.pipeline import CaptureOptions
from capture.storage import open_sequence
from capture.studio import make_sequence
from renderer.evaluation.metrics import psnr
from renderer.model_files import load_model
from renderer.performer_model import PerformerModel
from renderer.scene_renderer import SceneRenderer
from renderer.splats.files.viewer_file import encode
from renderer.splats.levels.detail import LEAST_DENSITY, ViewDetail
from renderer.splats.levels.tree import level_tree
from renderer.splats.model import SplatModel
from renderer.training import train
from scene.arrays import Array, Float
from scene.camera import Camera
from scene.environment import Scene
from scene.motion import Pose
from scene.sequence import NOVEL_VIEW, Sequence, body_crop
from services.arrangement import view_from_the_front
from services.bootstrap import DEMO_MODEL
from services.live.rendering.drawing import FrameRenderer
from services.live.room import MeetingPerformer, Room
from services.live.streaming.encoding import Codec, PictureEncoder
from services.live.streaming.pacing import DetailGovernor
from services.live.streaming.pose_feed import pose_packets

SHARES = (1.0, 0.5, 0.25)
WEBCAM_CLIP = "grey_shirt_sorry"
PAGE_PEOPLE, PAGE_SIZES = (4, 8), (512, 256)
SERVED_PEOPLE, SERVED_PX = 8, 1024
_FRAMES, _SIZE, _TRAINING_S = 60, 256, 20.0
_VIEWS = 16
_SECONDS, _PICTURES = 6.0, 100
_BITRATE = 2_500_000
_FOV_Y_RAD = 0.6
_MANY = 40_000
_NO_LIMIT = 100.0
"""Splats a square of height with which nobody is small."""


@dataclass(frozen=True, eq=False)
class _View:
    """One picture of a person that no training saw."""

    image: Float[Array, "H W 3"]
    """Over black."""
    mask: Float[Array, "H W"]
    camera: Camera
    pose: Pose

    def smaller(self, factor: int) -> _View:
        """The same with each side divided by `factor`, what is left over cut off."""
        high, wide = (side // factor for side in self.mask.shape)
        blocks = (high, factor, wide, factor, -1)
        whole = (slice(high * factor), slice(wide * factor))
        image = self.image[whole].reshape(blocks).mean(axis=(1, 3))
        mask = self.mask[whole].reshape(blocks).mean(axis=(1, 3))[..., 0]
        cut = self.camera.cropped(0, 0, wide * factor, high * factor)
        return replace(self, image=image, mask=mask, camera=cut.resized(wide, high))


def run(writer: FigureWriter, footage: Path, networks: Networks) -> None:
    """Measure and report."""
    model = load_model(DEMO_MODEL).splats
    assert model is not None
    writer.write(
        {
            "threads": numba.get_num_threads(),
            "small": list(_small(footage, networks)),
            "change": _change(model),
            "page": list(_on_a_page(model)),
            "server": [_by_the_server(one) for one in (model, surface_model(_MANY))],
        }
    )


def _small(footage: Path, networks: Networks) -> Iterator[dict[str, Any]]:
    with tempfile.TemporaryDirectory() as folder:
        for name, uniform in (("plain", True), ("amber", False)):
            path = Path(folder) / name
            performer = None if uniform else name
            make_sequence(path, performer=performer, frames=_FRAMES, size=_SIZE, uniform=uniform)
            clip = open_sequence(path)
            source = clip.test[NOVEL_VIEW]
            chosen = range(0, len(source), max(1, len(source) // _VIEWS))
            views = [
                _View(source.image(i), source.mask(i), source.camera(i), source.pose(i))
                for i in chosen
            ]
            yield from _levels_of(name, _trained(clip), views)
        yield from _levels_of("webcam", *_webcam(footage, networks, Path(folder)))


def _webcam(footage: Path, networks: Networks, folder: Path) -> tuple[SplatModel, list[_View]]:
    """A real person, and the frames of their clip that were kept from training."""
    ruler = Ruler.read(WEBCAM_CLIP)
    options = CaptureOptions(
        person=WEBCAM_CLIP,
        pose_model=networks.pose,
        face_model=networks.face,
        hand_model=networks.hand,
    )
    filmed = film(ruler, footage, folder / WEBCAM_CLIP, options)
    model = _trained(filmed.without_ruler())
    views = []
    for index in ruler.indices:
        pose = model.motion.pose_at(float(filmed.footage.times_s[index]))
        mask = ruler.mask(index) * (1.0 - ruler.hidden(index))
        image = filmed.footage.images[index].astype(np.float32) / 255.0 * mask[..., None]
        views.append(_View(image, mask, filmed.camera, pose))
    return model, views


def _trained(clip: Sequence) -> SplatModel:
    splats = train(clip, preset="splats", budget_s=_TRAINING_S, clock=time.monotonic).splats
    assert splats is not None
    return splats


def _levels_of(name: str, model: SplatModel, views: list[_View]) -> Iterator[dict[str, Any]]:
    tree = level_tree(model)
    for factor in (1, 2):
        smaller = [view.smaller(factor) for view in views]
        row: dict[str, Any] = {"person": name, "splats": len(model), "sides": f"1/{factor}"}
        for share in SHARES:
            level = tree.level(tree.clamped(share * len(tree)))
            row[f"psnr_{share:g}"] = round(float(np.mean([_psnr(level, v) for v in smaller])), 2)
        print(row, flush=True)
        yield row


def _psnr(model: SplatModel, view: _View) -> float:
    made = model.render(view.camera, view.pose)[..., :3] * (view.mask > 0.0)[..., None]
    crop = body_crop(view.mask)
    assert crop is not None
    return psnr(made[crop], view.image[crop].astype(np.float32))


def _room(model: SplatModel, people: int) -> Room:
    cast = (MeetingPerformer.at_place(str(n), str(n), model, n) for n in range(people))
    return Room("levels", tuple(cast))


def _change(model: SplatModel) -> dict[str, Any]:
    """Of pictures in which one person's number falls by more than half."""
    level_tree(model)
    room, detail = _room(model, 1), ViewDetail()
    stage, camera = SceneRenderer(detail), room.initial_camera(512, 512)

    def picture(scene: Scene[PerformerModel]) -> Array:
        return stage.render(scene, camera).astype(np.float32).copy()

    still, moved = room.scene_at(1.0), room.scene_at(1.0 + 1.0 / 30.0)
    pictures = [picture(still)]
    for _ in range(40):
        detail.density = LEAST_DENSITY
        pictures.append(picture(still))
    motion = float(np.abs(picture(moved) - pictures[-1]).mean())
    steps = [float(np.abs(b - a).mean()) for a, b in pairwise(pictures)]
    row = {
        "from": len(model),
        "to": detail.counts[0],
        "pictures": sum(step > 0.0 for step in steps),
        "largest_step_of_a_motion_step": round(max(steps) / motion, 3),
    }
    print(row, flush=True)
    return row


def _on_a_page(model: SplatModel) -> Iterator[dict[str, Any]]:
    """A full room in a browser without a graphics card, seen by a viewer who moves a little."""
    file = encoded_text(encode(model))
    with measuring_page() as page:
        for people in PAGE_PEOPLE:
            room = _room(model, people)
            moments = [
                [encoded_text(packet) for packet in pose_packets(room, moment / 30.0, moment + 1)]
                for moment in range(30)
            ]
            view = view_from_the_front([one.placed for one in room.performers])
            orbit = {
                "target": list(view.target),
                "azimuthRad": view.azimuth_rad,
                "elevationRad": view.elevation_rad,
                "distanceM": view.distance_for(1.0, _FOV_Y_RAD),
            }
            for size in PAGE_SIZES:
                asked = {"file": file, "moments": moments, "size": size, "seconds": _SECONDS}
                row: dict[str, Any] = {"people": people, "size": size}
                for name, levels in (("all", False), ("levels", True)):
                    what = {**asked, "orbit": orbit, "levels": levels}
                    found = page.evaluate("what => window.crowd(what)", what)
                    row[f"{name}_pictures_per_second"] = round(found["rate"], 1)
                    row[f"{name}_splats"] = round(sum(found["splats"]))
                print(row, flush=True)
                yield row


def _by_the_server(model: SplatModel) -> dict[str, Any]:
    """Pictures drawn and coded one after the other, of which the second half is counted."""
    row: dict[str, Any] = {"people": SERVED_PEOPLE, "splats": len(model), "size": SERVED_PX}
    level_tree(model)
    for name in ("all", "levels"):
        row |= {f"{name}_{key}": value for key, value in _served(model, name).items()}
    print(row, flush=True)
    return row


def _served(model: SplatModel, name: str) -> dict[str, Any]:
    room, canvas = _room(model, SERVED_PEOPLE), FrameRenderer()
    governor, encoder = DetailGovernor(canvas.detail), PictureEncoder(Codec.VP8)
    camera, took = room.initial_camera(SERVED_PX, SERVED_PX), list[float]()
    clock_s = 0.0
    if name == "all":
        canvas.detail.density = _NO_LIMIT
    for tick in range(_PICTURES):
        started = time.perf_counter()
        encoder.encode(canvas.render(room.scene_at(tick / 30.0), camera), tick, _BITRATE, key=False)
        took.append(time.perf_counter() - started)
        clock_s += max(took[-1], 1.0 / 30.0)
        if name == "levels":
            governor.add_picture(clock_s, sum(took), 1.0)
    median_s = float(np.median(took[_PICTURES // 2 :]))
    return {
        "ms": round(1e3 * median_s, 1),
        "pictures_per_second": round(1.0 / median_s, 1),
        "splats": sum(canvas.detail.counts),
    }
