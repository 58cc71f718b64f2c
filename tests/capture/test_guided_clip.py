"""A guided enrolment's recordings: close to the camera, from head to foot, and hands held up."""

from __future__ import annotations

import zipfile
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest

from capture.pipeline import CaptureOptions, capture_clip
from capture.storage import open_sequence
from capture.studio.lifelike.performer import make_lifelike_performer
from capture.studio.named_performers import LIFELIKE_PERFORMERS
from scene.skeleton import JOINT_NAMES
from tests.e2e.guided_clip import SIZE, Moment, pictures
from tests.shared_data import shared_data

FRAMES, RATE_HZ = 8, 8
CLOSE_M, NEAR_M, FAR_M = 0.55, 1.3, Moment(1.0).distance_m
STEPS = {
    "1-face": Moment(1.0, CLOSE_M),
    "2-step_back": Moment(1.0),
    "3-hands": Moment(1.0, NEAR_M, hands_up=1.0),
}
LEGS = [
    JOINT_NAMES.index(f"{side}_{part}") for side in ("left", "right") for part in ("hip", "knee")
]


def write_recordings(out: Path, assets: Path) -> Path:
    """One video a step, in a zip, as the page sends them."""
    performer = make_lifelike_performer(LIFELIKE_PERFORMERS["jasper"], assets)
    with zipfile.ZipFile(out, "w") as archive:
        for name, moment in STEPS.items():
            path = out.with_name(f"{name}.mp4")
            with av.open(str(path), "w") as video:
                stream = video.add_stream("libx264", rate=RATE_HZ)
                (stream.width, stream.height), stream.pix_fmt = SIZE, "yuv420p"
                ((_, picture),) = pictures(performer, [moment])
                for number in range(FRAMES):
                    frame = av.VideoFrame.from_ndarray(picture, format="rgb24")
                    frame.pts, frame.time_base = number, Fraction(1, RATE_HZ)
                    video.mux(stream.encode(frame))
                video.mux(stream.encode())
            archive.write(path, path.name)
    return out


@pytest.mark.usefixtures("fewer_steps")
def test_whose_legs_are_below_the_picture_for_long_stands_as_in_the_other_recordings(
    tmp_path, pose_model, face_model, hand_model
):
    clip = write_recordings(tmp_path / "me.zip", shared_data("human-assets"))
    options = CaptureOptions(
        person="p", pose_model=pose_model, face_model=face_model, hand_model=hand_model
    )
    quality = capture_clip(clip, tmp_path / "out", options)
    assert quality.recordings == len(STEPS)
    assert quality.legs_seen
    sequence = open_sequence(tmp_path / "out")
    motion, camera = sequence.motion, sequence.train.camera(0)
    assert len(motion) == FRAMES * len(STEPS)
    bent = np.rad2deg(np.linalg.norm(motion.joint_angles[:, LEGS], axis=-1))
    assert bent.max() < 30.0
    pelvis = motion.root_translation + sequence.body.skeleton.rest_joints[0]
    _, away = camera.project(pelvis)
    close, far, near = (np.median(away[take * FRAMES :][:FRAMES]) for take in range(len(STEPS)))
    assert close / far == pytest.approx(CLOSE_M / FAR_M, rel=0.25)
    assert near / far == pytest.approx(NEAR_M / FAR_M, rel=0.25)
