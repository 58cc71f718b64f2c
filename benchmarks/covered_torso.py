"""The torso where hands were in front of it: as well learnt as the rest of it?

Lifelike performers film themselves from the waist up, both hands before the chest all the while, so
that no frame shows all of it; 60 frames, exact poses, or poses shaken as those of captures are.
Then they are drawn with their hands away.
Each pixel of the torso knows in how many frames of the clip a hand or forearm hid its place on the
surface. Of what hands hid in a fifth of them and more, and of what they hid in a twentieth at most,
LPIPS is that of the truth with that part alone taken from the model, over the part's share of the
picture. With shaken poses it is told, too, what leaving out splats behind hands is worth there.
"""

from __future__ import annotations

import tempfile
import time
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import torch

from benchmarks.covering_hands import RATE_HZ, hands_away, hands_before_chest
from benchmarks.reporting.figures import FigureWriter
from benchmarks.stability.poses import noisy
from capture.storage import open_sequence, write_sequence
from capture.studio.lifelike.performer import DressedPerformer, make_lifelike_performer
from capture.studio.named_performers import LIFELIKE_PERFORMERS
from renderer.evaluation.lpips import Lpips
from renderer.training import train
from scene.arrays import Array, Bool, Float, Int
from scene.camera import Camera, orbit_camera
from scene.motion import Motion, Pose
from scene.sequence import Frame, PoseTrust
from scene.skeleton import JOINT_NAMES

PERFORMERS = ("hazel", "jasper", "moss")
MUST, AIM = 0.03, 0.01
ITERATIONS = 500
SHAKEN_DEG = 3.0
"""About each axis of each joint, lasting: off in the picture by what captures are off."""
EXACT, SHAKEN, LEARNT_THROUGH = "exact", "shaken", "shaken, learnt through hands"
"""Poses; the last with splats behind hands taught by the pixels of these hands."""
FRAMES, TEST_FRAMES, SIZE_PX = 60, 8, 384
COVERED_SHARE, REST_SHARE = 0.2, 0.05
"""Of the frames: what hands hid oftener counts as covered, what they hid less as the rest."""
_TARGET, _DISTANCE_M, _FIELD_OF_VIEW_RAD = (0.0, 1.25, 0.0), 1.6, 0.6
_TORSO = ("pelvis", "spine1", "spine2", "spine3", "left_collar", "right_collar")
_COVERING = tuple(
    f"{side}_{part}" for side in ("left", "right") for part in ("elbow", "wrist", "hand")
)
_TORSO_JOINTS, _COVERING_JOINTS = (
    [JOINT_NAMES.index(name) for name in names] for names in (_TORSO, _COVERING)
)


@dataclass(frozen=True, eq=False)
class Covered:
    """A performer before the camera, and which of their triangles are seen."""

    performer: DressedPerformer
    camera: Camera

    def triangles(self, pose: Pose) -> Int[Array, "H W"]:
        """The nearest triangle of each pixel; -1 where nobody is."""
        from capture.studio.mesh_kernels import rasterise

        size = (self.camera.height, self.camera.width)
        triangle = np.empty(size, np.int32)
        barycentric, nearest = np.empty((*size, 3), np.float32), np.empty(size, np.float32)
        pixels, depth = self.camera.project(self.performer.posed_vertices(pose))
        everything = np.full(size, np.inf, np.float32)
        faces = self.performer.surface.faces
        rasterise(pixels, depth, faces, triangle, barycentric, nearest, everything)
        return triangle

    def hidden_shares(self, motion: Motion) -> Float[Array, "T"]:
        """In how many of the motion's poses, as a share of them, hands or forearms are in front of
        each triangle."""
        faces, joints = self.performer.surface.faces, self.joints
        hidden = np.zeros(len(faces))
        for number in range(len(motion)):
            pose = motion.pose(number)
            seen = self.triangles(pose)
            centres = self.performer.posed_vertices(pose)[faces].mean(axis=1)
            at = np.floor(self.camera.project(centres)[0]).astype(int)
            inside = ((at >= 0) & (at < seen.shape[::-1])).all(axis=1)
            x, y = np.clip(at, 0, np.array(seen.shape[::-1]) - 1).T
            front = seen[y, x]
            hidden += inside & (front >= 0) & np.isin(joints[front], _COVERING_JOINTS)
        return hidden / len(motion)

    @property
    def joints(self) -> Int[Array, "T"]:
        """Of each triangle: the joint that moves it most."""
        weights = self.performer.surface.body.blend_weights
        assert weights is not None
        return weights[self.performer.surface.faces].sum(axis=1).argmax(axis=1)


def run(writer: FigureWriter, assets: Path, backbone: Path, only: str = "") -> None:
    """Measure who was not measured yet, and report."""
    cache = writer.cache(only)
    conditions = {
        "frames": FRAMES,
        "size": SIZE_PX,
        "iterations": ITERATIONS,
        "shaken_deg": SHAKEN_DEG,
        "covered_share": COVERED_SHARE,
        "rest_share": REST_SHARE,
        "lpips": backbone.name,
    }
    rows = []
    for name in PERFORMERS:
        for poses in (EXACT, SHAKEN, LEARNT_THROUGH):
            row = cache.measured(
                f"{name}, {poses}",
                conditions,
                lambda name=name, poses=poses: measure(name, poses, assets, backbone),
            )
            if row is not None:
                rows.append({"performer": name, "poses": poses, **row})
    writer.write({**conditions, "must": MUST, "aim": AIM, "rows": rows})


def measure(
    name: str, poses: str, assets: Path, backbone: Path, iterations: int = ITERATIONS
) -> dict[str, Any]:
    """LPIPS of the torso that hands covered, and of the rest of it, hands away."""
    performer = make_lifelike_performer(LIFELIKE_PERFORMERS[name], assets)
    camera = orbit_camera(_TARGET, _DISTANCE_M, 0.0, 0.0, SIZE_PX, SIZE_PX, _FIELD_OF_VIEW_RAD)
    scene, lpips = Covered(performer, camera), Lpips(backbone)
    skeleton = performer.body.skeleton
    clip, away = hands_before_chest(skeleton, FRAMES), hands_away(TEST_FRAMES)
    told = clip
    if poses != EXACT:
        told = noisy(clip, SHAKEN_DEG, np.random.default_rng(0), lasting=True)
    with tempfile.TemporaryDirectory() as folder, _through_hands(poses == LEARNT_THROUGH):
        path = Path(folder) / "clip"
        write_sequence(
            path,
            person=name,
            frames_per_second=RATE_HZ,
            body=performer.known_body,
            train=(
                replace(_frame(scene, clip.pose(number)), pose=told.pose(number))
                for number in range(FRAMES)
            ),
            source="hands before the chest",
            pose_trust=PoseTrust.EXACT if poses == EXACT else PoseTrust.ESTIMATED,
        )
        model = train(
            open_sequence(path),
            preset="splats",
            iterations=iterations,
            find_light=True,
            clock=time.perf_counter,
        )
    hidden, joints = scene.hidden_shares(clip), scene.joints
    found: dict[str, list[float]] = {"covered": [], "rest": []}
    shares: dict[str, list[float]] = {"covered": [], "rest": []}
    for number in range(TEST_FRAMES):
        truth = _frame(scene, away.pose(number))
        made = np.clip(model.render(camera, truth.pose)[..., :3], 0.0, 1.0)
        triangle = scene.triangles(truth.pose)
        torso = (triangle >= 0) & np.isin(joints[triangle], _TORSO_JOINTS)
        parts = {
            "covered": torso & (hidden[triangle] >= COVERED_SHARE),
            "rest": torso & (hidden[triangle] <= REST_SHARE),
        }
        for part, where in parts.items():
            found[part].append(part_lpips(lpips, made, truth.image, where))
            shares[part].append(float(where.sum() / max(torso.sum(), 1)))
    covered, rest = (float(np.mean(found[part])) for part in ("covered", "rest"))
    row = {
        "lpips_covered": round(covered, 4),
        "lpips_rest": round(rest, 4),
        "lpips_more": round(covered - rest, 4),
        **{f"{part}_of_torso": round(float(np.mean(shares[part])), 3) for part in shares},
    }
    print(name, poses, row, flush=True)
    return row


def _through_hands(learns: bool) -> AbstractContextManager[object]:
    """With what a hand hides learning from the hand's pixels, where `learns`."""
    if not learns:
        return nullcontext()
    hides = "renderer.splats.training.trainer.hidden_by_limbs"
    return mock.patch(hides, return_value=np.zeros(0, np.int64))


@torch.no_grad()
def part_lpips(
    lpips: Lpips,
    made: Float[Array, "H W 3"],
    truth: Float[Array, "H W 3"],
    where: Bool[Array, "H W"],
) -> float:
    """LPIPS of the truth in which `where` alone is the model's, over that part's share of it."""
    mixed = np.where(where[..., None], made, truth)
    pair = [
        torch.from_numpy(np.ascontiguousarray(one, np.float32)).movedim(-1, 0)[None]
        for one in (mixed, truth)
    ]
    return float(lpips(*pair)[0]) / max(float(where.mean()), 1e-6)


def _frame(scene: Covered, pose: Pose) -> Frame:
    image, mask = scene.performer.render(pose, scene.camera, "plain")
    return Frame(image, mask, scene.camera, pose)
