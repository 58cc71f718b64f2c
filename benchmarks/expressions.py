"""Gain of blend shapes of face and hands, on studio performers who talk, blink and wave.

Truth: a face is filmed as head and shoulders, hands with the whole body; splats are then judged in
poses, expressions and from cameras that training never saw, on the crop of the face or a hand. Each
expression of a face, and each hand, is also left out alone, from training and test: the difference
is its own worth. That of a lid is told of its eye's crop, since a lid is but a hundredth of a face.
What fingers are worth that bend one by one is the difference to hands of which all five bend by
their mean.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from benchmarks.reporting.figures import FigureWriter
from benchmarks.reporting.timing import milliseconds
from capture.storage import open_sequence
from capture.studio import make_sequence
from capture.studio.motions import gesture_motion
from capture.studio.performer import StudioPerformer, make_performer, render_performer
from renderer.evaluation.evaluate import evaluate
from renderer.evaluation.metrics import psnr
from renderer.presets import find_preset
from renderer.splats.model import SplatModel
from renderer.splats.rasteriser.renderer import SplatRenderer
from renderer.training import train
from scene.arrays import Array, Float
from scene.body import Body
from scene.camera import Camera, orbit_camera
from scene.expression import (
    EXPRESSION_NAMES,
    GAZE,
    PARTS,
    gaze_numbers,
    gaze_of,
    neutral,
)
from scene.motion import Pose
from scene.sequence import NOVEL_VIEW, Sequence
from scene.skeleton import JOINT_NAMES

SEEDS = (2, 6, 9)
FRAMES, ITERATIONS, TESTS = 60, 800, 16
_FACE_M = np.array([0.0, 0.01, 0.08])
"""From the head's joint to the middle of the face."""
_TIMED_PX, _TIMED = 512, 200
_ASIDE_RAD = 0.35
"""From the way that a face looks to the side that it is drawn from."""


@dataclass(frozen=True)
class Part:
    """A part of the body that is evaluated."""

    name: str
    framing: str
    size: int
    distance_m: float
    """Of the test cameras."""
    round_rad: float
    """How far round the part they stand, either way."""
    half_m: float
    """Half the side of the crop."""
    joints: tuple[str, ...]
    left_out: dict[str, tuple[str, ...]]
    """What is left out at a time, and its expressions."""

    def crop_of(self, left_out: str) -> str:
        """The crop in which the gain of what is left out is measured."""
        return left_out if left_out in LIDS else self.name


LIDS = ("blink_left", "blink_right")
_EYE_HALF_M = 0.025
_LID_M = 1e-3
"""How far a lid moves at least, where it does."""
_HANDS = ("left_hand", "right_hand")
FACE = Part(
    "face",
    "head",
    256,
    0.9,
    0.8,
    0.085,
    ("head",),
    {name: (name,) for name in EXPRESSION_NAMES[PARTS["face"]]},
)
HANDS = Part(
    "hands",
    "body",
    320,
    3.3,
    np.pi,
    0.12,
    _HANDS,
    {f"{hand}_curl": EXPRESSION_NAMES[PARTS[hand]] for hand in _HANDS},
)
TOGETHER = "fingers together"
"""The way to train in which all fingers of a hand bend by their mean."""
Change = Callable[[Float[Array, "*F E"]], Float[Array, "*F E"]]
"""Of the expressions of a clip or a pose, before they are trained on or drawn."""


@dataclass(frozen=True, eq=False)
class RenderedExpression:
    """A test picture and its evaluated crops."""

    pose: Pose
    camera: Camera
    image: Float[Array, "H W 3"]
    crops: dict[str, list[tuple[slice, slice]]]
    """Of the part, and of each eye under the name of its lid."""


def run(writer: FigureWriter, picture: Path | None) -> None:
    """Measure what was not measured yet, and report; draw the first one's face."""
    cache = writer.cache()
    about: dict[str, Any] = {
        "frames": FRAMES,
        "iterations": ITERATIONS,
        "performers": list(SEEDS),
        "tests": TESTS,
        "unit": "dB, mean over crops of unseen poses, expressions and views",
    }
    rows = [
        cache.measured(f"{part.name}-{seed}", about, lambda p=part, s=seed: _row(p, s))
        for seed in SEEDS
        for part in (FACE, HANDS)
    ]
    frame_ms = cache.measured("frame-ms", about, _frame_ms)
    figures = [row for row in rows if row is not None]
    writer.write({**about, "frame_ms": frame_ms, "worth": worth(figures), "rows": figures})
    if picture is not None:
        with _rendered_clip(FACE, SEEDS[0]) as clip:
            drawn = (faces(clip, SEEDS[0])[..., ::-1] * 255.0 + 0.5).astype(np.uint8)
        cv2.imwrite(str(picture), drawn)


@contextmanager
def _rendered_clip(part: Part, seed: int) -> Iterator[Sequence]:
    """One performer's `part`, as training sees it."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "sequence"
        make_sequence(
            path, seed=seed, frames=FRAMES, size=part.size, expressions=True, framing=part.framing
        )
        yield open_sequence(path)


def _row(part: Part, seed: int) -> dict[str, Any]:
    with _rendered_clip(part, seed) as clip:
        return {"seed": seed, "part": part.name, **measured(part, clip, seed)}


def _frame_ms() -> dict[str, Any]:
    with _rendered_clip(FACE, SEEDS[0]) as clip:
        return frame_times(trained(clip, SEEDS[0]))


def measured(part: Part, clip: Sequence, seed: int) -> dict[str, Any]:
    """dB of every way to train one performer's `part`."""
    shots = unseen_views(part, make_performer(seed, expressive=True), seed)
    unknown = replace(clip, body=replace(clip.body, expression_directions=None))
    nothing = hiding(())
    ways: dict[str, tuple[Sequence, float, Change]] = {
        "off": (unknown, 1.0, nothing),
        "off, denser": (clip, _density(), hiding(EXPRESSION_NAMES)),
        "even": (clip, 1.0, nothing),
        "on": (clip, _density(), nothing),
        **{f"without {n}": (clip, _density(), hiding(of)) for n, of in part.left_out.items()},
    }
    if part is HANDS:
        ways[TOGETHER] = (clip, _density(), together)
    made: dict[str, Any] = {"db": {}, "body_crop_db": {}}
    for way, (sequence, density, change) in ways.items():
        model = trained(changed(sequence, change), seed, density)
        made["db"][way] = judged(model, shots, change)
        if part is HANDS and way in ("off", "even", "on"):
            figures = evaluate(model, sequence)["psnr"][NOVEL_VIEW]["body_crop"]
            made["body_crop_db"][way] = figures
        print(seed, part.name, way, made["db"][way], flush=True)
    return made


def trained(sequence: Sequence, seed: int, density: float | None = None) -> SplatModel:
    """Splats of `sequence`, by `density` denser on face and hands (None: as the preset has it)."""
    preset = find_preset("splats")
    if density is not None:
        preset = replace(preset, settings=replace(preset.settings, expressive_density=density))
    clock = time.perf_counter
    model = train(sequence, preset=preset, iterations=ITERATIONS, seed=seed, clock=clock)
    assert model.splats is not None
    return model.splats


def changed(clip: Sequence, change: Change) -> Sequence:
    """`clip` with other expressions."""
    motion = clip.motion
    return replace(clip, motion=replace(motion, expressions=change(motion.expressions)))


def hiding(names: tuple[str, ...]) -> Change:
    """Puts the expressions `names` to rest."""
    kept = np.array([name not in names for name in EXPRESSION_NAMES])
    return lambda expressions: np.where(kept, expressions, neutral())


def together(expressions: Float[Array, "*F E"]) -> Float[Array, "*F E"]:
    """Every finger as far bent as its hand's are on average."""
    shown = expressions.copy()
    for hand in _HANDS:
        shown[..., PARTS[hand]] = expressions[..., PARTS[hand]].mean(axis=-1, keepdims=True)
    return shown


def unseen_views(part: Part, performer: StudioPerformer, seed: int) -> list[RenderedExpression]:
    """Pictures in poses, expressions and from cameras outside of the training clip."""
    rng, skeleton = np.random.default_rng(seed + 1000), performer.body.skeleton
    moves, shots, eyes = gesture_motion(TESTS, 10.0), [], _eyes(performer.known_body)
    for index in range(TESTS):
        shown = np.clip(rng.uniform(-0.4, 1.2, len(EXPRESSION_NAMES)), 0.0, 1.0)
        shown[GAZE] = gaze_numbers(gaze_of(shown))  # eyes look to one side at a time
        pose = replace(moves.pose(index), expression=shown)
        joints = skeleton.joint_transforms(pose.joint_angles, pose.root_translation)
        head = joints[JOINT_NAMES.index("head")]
        aim = head[:3, 3] if part is FACE else np.array([0.0, 0.55 * skeleton.height_m, 0.0])
        facing = np.arctan2(head[0, 2], head[2, 2])
        camera = orbit_camera(
            aim,
            part.distance_m,
            facing + rng.uniform(-part.round_rad, part.round_rad),
            rng.uniform(-0.1, 0.3),
            part.size,
            part.size,
            0.6,
        )
        image, _ = render_performer(performer, pose, camera, "plain")
        middles = [joints[JOINT_NAMES.index(name)] for name in part.joints]
        places = [j[:3, 3] + (j[:3, :3] @ _FACE_M if part is FACE else 0.0) for j in middles]
        crops = {part.name: [_crop(camera, place, part.half_m) for place in places]}
        if part is FACE:
            for lid, eye in eyes.items():
                place = head[:3, 3] + head[:3, :3] @ eye
                crops[lid] = [_crop(camera, place, _EYE_HALF_M)]
        shots.append(RenderedExpression(pose, camera, image, crops))
    return shots


def _eyes(body: Body) -> dict[str, Float[Array, "3"]]:
    """From the head's joint to the middle of what each lid moves, m."""
    assert body.rest_vertices is not None
    assert body.expression_directions is not None
    head = body.skeleton.rest_joints[JOINT_NAMES.index("head")]
    moved = np.linalg.norm(body.expression_directions, axis=2) > _LID_M
    return {
        lid: body.rest_vertices[moved[EXPRESSION_NAMES.index(lid)]].mean(axis=0) - head
        for lid in LIDS
    }


def faces(clip: Sequence, seed: int) -> Float[Array, "H W 3"]:
    """Above the truth, below the model, from one side: at rest, then one expression after another,
    both lids together."""
    performer, model = make_performer(seed, expressive=True), trained(clip, seed)
    pose, skeleton = clip.test[NOVEL_VIEW].pose(0), performer.body.skeleton
    head = skeleton.joint_transforms(pose.joint_angles, pose.root_translation)[
        JOINT_NAMES.index("head")
    ]
    facing, side = float(np.arctan2(head[0, 2], head[2, 2])), FACE.size
    camera = orbit_camera(head[:3, 3], FACE.distance_m, facing + _ASIDE_RAD, 0.05, side, side, 0.6)
    crop = _crop(camera, head[:3, 3] + head[:3, :3] @ _FACE_M, 1.3 * FACE.half_m)
    columns = []
    for shown in ((), ("jaw_open",), LIDS, ("brows_up",), ("smile",)):
        values = np.array([float(name in shown) for name in EXPRESSION_NAMES])
        posed = replace(pose, expression=values)
        truth, _ = render_performer(performer, posed, camera, "plain")
        rendered = np.clip(model.render(camera, posed)[..., :3], 0.0, 1.0)
        columns.append(np.vstack([truth[crop], rendered[crop]]))
    return np.hstack(columns)


def judged(model: SplatModel, shots: list[RenderedExpression], change: Change) -> dict[str, float]:
    """Mean PSNR, dB, over each kind of crop of `shots`, drawn with expressions under `change`."""
    found: dict[str, list[float]] = {name: [] for name in shots[0].crops}
    for shot in shots:
        pose = replace(shot.pose, expression=change(shot.pose.expression))
        rendered = np.clip(model.render(shot.camera, pose)[..., :3], 0.0, 1.0)
        for name, crops in shot.crops.items():
            found[name] += [psnr(rendered[crop], shot.image[crop]) for crop in crops]
    return {name: round(float(np.mean(each)), 3) for name, each in found.items()}


def worth(rows: list[dict[str, Any]]) -> dict[str, dict[str, float]]:
    """Of every step and expression the gain, dB: mean over performers, and its spread."""
    steps = {
        "expressions at even density": ("even", "off"),
        "density alone": ("off, denser", "off"),
        "both": ("on", "off"),
    }
    gains = {}
    for part in (FACE, HANDS):
        mine = [row["db"] for row in rows if row["part"] == part.name]
        compared = {f"{part.name}: {step}": (*ways, part.name) for step, ways in steps.items()}
        compared |= {n: ("on", f"without {n}", part.crop_of(n)) for n in part.left_out}
        if part is HANDS:
            compared["fingers apart"] = ("on", TOGETHER, part.name)
        for name, (way, other, crop) in compared.items():
            gain = [db[way][crop] - db[other][crop] for db in mine]
            spread = round(float(np.std(gain)), 3)
            gains[name] = {"gain_db": round(float(np.mean(gain)), 3), "spread_db": spread}
    return gains


def frame_times(model: SplatModel) -> dict[str, Any]:
    """Pose to picture with everything shown, and by a model that knows no expressions."""
    plain = replace(
        model,
        expression_splats=model.expression_splats[:0],
        expression_offsets=model.expression_offsets[:0],
    )
    camera = orbit_camera((0.0, 0.9, 0.0), 3.0, 0.3, 0.1, _TIMED_PX, _TIMED_PX)
    pose = model.motion.pose(0)
    moved = [model.skeleton.skinning_transforms(pose.joint_angles, pose.root_translation)]
    ways = {"without": SplatRenderer([plain]), "with": SplatRenderer([model])}
    seconds: dict[str, list[float]] = {way: [] for way in ways}
    shown = [np.full(len(EXPRESSION_NAMES), 0.5)]
    for _ in range(_TIMED):  # in turns, as the host is others' too
        for way, renderer in ways.items():
            begun = time.perf_counter()
            renderer.render(camera, moved, expressions=shown)
            seconds[way].append(time.perf_counter() - begun)
    times = {way: milliseconds(taken[10:]) for way, taken in seconds.items()}
    return {"size": _TIMED_PX, "moved_splats": len(model.expression_splats), **times}


def _density() -> float:
    settings = find_preset("splats").settings
    return settings.expressive_density  # pyright: ignore[reportAttributeAccessIssue]


def _crop(camera: Camera, place: Float[Array, "3"], half_m: float) -> tuple[slice, slice]:
    pixels, depth = camera.project(place[None])
    half = half_m * camera.intrinsics[0, 0] / depth[0]
    spans = [
        slice(max(0, round(at - half)), min(side, round(at + half)))
        for at, side in zip(pixels[0], (camera.width, camera.height), strict=True)
    ]
    return spans[1], spans[0]
