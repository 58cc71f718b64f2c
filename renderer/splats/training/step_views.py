"""What a step of a training looks at: a whole person, a part as filmed, or a person from beside.

Where poses are estimated, frames are looked at as registered to the model from half of it on.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from itertools import islice

import numpy as np

from renderer.splats.settings import SplatSettings
from renderer.splats.training.beside import PosedSurface, seen_from_beside
from renderer.splats.training.full_size import FullSizeWindows, whole_views
from renderer.splats.training.registration import flow_to_frame, registered
from renderer.splats.training.surface_kinds import HEAD_KINDS
from renderer.splats.training.trained_splats import TrainedSplats
from renderer.splats.training.views import View
from scene.arrays import Array, Bool, Float
from scene.sequence import PoseTrust, Sequence
from scene.skeleton import HEAD, JOINT_NAMES

_CHEST = JOINT_NAMES.index("spine3")
_TURNS_RAD = float(np.radians(40.0))
"""A part that turns as far tells its depth by itself, better than the surface that is guessed."""
_REGISTERED_FROM = (0.5, 0.75)
"""Shares of the training after which frames, as filmed, are registered to the model."""
_AS_FILMED = np.zeros((0, 1, 1, 2), np.float16)
_MOST = (5.0, 95.0)
"""Percentiles of a clip's frames between which a part turns."""


class StepViews:
    """The frames of one training, and how its steps see them."""

    def __init__(self, filmed: list[View], sequence: Sequence, settings: SplatSettings) -> None:
        self._filmed, self._settings = filmed, settings
        self._flows, self._registrations = _AS_FILMED, 0
        self._look_at(filmed)
        self.whole = self._whole
        """Each frame, small enough for a step to see all of the person; never registered."""
        self._uncertain = sequence.pose_trust is PoseTrust.ESTIMATED
        self._head_faces, self._trunk_faces = (
            self._uncertain and turn_rad(sequence, joint) < _TURNS_RAD for joint in (HEAD, _CHEST)
        )

    def _look_at(self, frames: list[View]) -> None:
        self._frames, self._whole = frames, whole_views(frames, self._settings.whole_px)
        larger = self._whole[0] is not frames[0]
        self._windows = FullSizeWindows(frames, self._settings) if larger else None

    def should_register(self, fraction: float) -> bool:
        """Whether frames are to be registered, `fraction` of the way through the training."""
        rounds = self._registrations
        due = rounds < len(_REGISTERED_FROM) and fraction >= _REGISTERED_FROM[rounds]
        return due and self._uncertain

    def register(
        self, pictures: Iterable[tuple[Float[Array, "H W 4"], Float[Array, "H W 4"]]]
    ) -> None:
        """Look at the frames as registered to the model from now on.

        Args:
            pictures: the model in each frame, and the frame, in the size of `whole`.
        """
        self._registrations += 1
        cores, waiting, flows = len(os.sched_getaffinity(0)), iter(pictures), list[Array]()
        with ThreadPoolExecutor(cores, "register") as pool:
            while some := list(islice(waiting, cores)):
                flows += pool.map(flow_to_frame, *zip(*some, strict=True))
        self._move(np.stack(flows))

    def _move(self, flows: Float[Array, "F G G 2"]) -> None:
        self._flows = flows
        moved = map(registered, self._filmed, flows)
        self._look_at(list(moved) if len(flows) else self._filmed)

    def state(self) -> dict[str, Array]:
        """What `restore` needs."""
        return {"flows": self._flows, "registrations": np.array(self._registrations)}

    def restore(self, state: dict[str, Array]) -> None:
        """Go back to `state`."""
        self._registrations = int(state["registrations"])
        if not np.array_equal(state["flows"], self._flows):
            self._move(state["flows"])

    def drawn(
        self,
        frame: int,
        splats: TrainedSplats,
        transforms: Float[Array, "K 4 4"],
        fraction: float,
        rng: np.random.Generator,
    ) -> View:
        """A view of `frame`, in which `transforms` pose `splats`, `fraction` of the way through
        the training."""
        settings = self._settings
        one_sided = self._head_faces or self._trunk_faces
        if one_sided and fraction > settings.beside_from and rng.random() < settings.beside_share:
            return self._from_beside(frame, splats, transforms, rng)
        if self._windows is None or rng.random() >= settings.window_share:
            return self._whole[frame]
        return self._windows.drawn(frame, splats, transforms, rng)

    def _from_beside(
        self,
        frame: int,
        splats: TrainedSplats,
        transforms: Float[Array, "K 4 4"],
        rng: np.random.Generator,
    ) -> View:
        surface = PosedSurface(
            splats.expressions.moved(splats.smooth(), frame),
            splats.first.normals,
            splats.joints,
            splats.weights,
            transforms,
        )
        angle = rng.choice([-1.0, 1.0]) * np.radians(rng.uniform(*self._settings.beside_deg))
        camera = self.whole[frame].window.carried_round(surface.middle, float(angle))
        return seen_from_beside(
            self._whole[frame],
            self._frames[frame].rgba,
            camera,
            surface,
            self._one_sided(splats),
            splats.work,
        )

    def _one_sided(self, splats: TrainedSplats) -> Bool[Array, "N"]:
        """Splats of parts that turn little in this clip; limbs count as the trunk."""
        on_head = np.isin(splats.kinds, HEAD_KINDS)
        return np.where(on_head, self._head_faces, self._trunk_faces)


def turn_rad(sequence: Sequence, joint: int) -> float:
    """How far the part that follows `joint` turns before the camera, all but a tenth of the
    frames of a clip."""
    skeleton, train, sides = sequence.body.skeleton, sequence.train, []
    for frame in range(len(train)):
        pose = sequence.motion.pose(frame)
        turns = skeleton.skinning_transforms(pose.joint_angles, pose.root_translation)[joint]
        place = turns[:3, :3] @ skeleton.rest_joints[joint] + turns[:3, 3]
        towards = turns[:3, :3].T @ (train.camera(frame).position - place)
        sides.append(np.arctan2(towards[0], towards[2]))
    low, high = np.percentile(np.unwrap(sides), _MOST)
    return float(high - low)
