"""Pictures for live look as a sequence, from which a model goes on to learn beside its clip."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from renderer.live_look.frame_keeper import KeptFrame
from renderer.performer_model import PerformerModel
from scene.sequence import Frame, Sequence


def training_frames(kept: Iterable[KeptFrame]) -> list[Frame]:
    """What was kept, as frames of a sequence."""
    frames = []
    for picture in (one.picture for one in kept):
        mask = picture.matte.astype(np.float32) / np.float32(255.0)
        rgb = picture.rgb.astype(np.float32) / np.float32(255.0)
        frames.append(Frame(rgb * mask[..., None], mask, picture.camera, picture.pose))
    return frames


def with_kept(clip: Sequence, kept: Iterable[Sequence], start: PerformerModel) -> Sequence:
    """`clip` and behind it what was `kept` later, of the same person in the same clothes.

    Frames that `start` was trained on stand in the poses that its training left.
    """
    whole = _as_left_by(start, clip)
    for one in kept:
        whole = _as_left_by(start, whole.followed_by(one))
    return whole


def _as_left_by(model: PerformerModel, sequence: Sequence) -> Sequence:
    trained = model.data_hash == sequence.data_hash and len(model.motion) == len(sequence.motion)
    if not trained:
        return sequence
    return replace(sequence, motion=model.motion, body=sequence.body.on(model.skeleton))
