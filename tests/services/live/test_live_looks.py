"""A sent picture colours the performer who is drawn, until it is stopped, with motion in step."""

from __future__ import annotations

from collections import deque
from concurrent.futures import Executor, Future
from dataclasses import replace

import numpy as np
import pytest

from renderer.splats.layout import COLOUR, LOG_SCALE, OPACITY, PARAMETERS, ROTATION
from renderer.splats.model import SplatModel
from renderer.splats.rasteriser.renderer import SplatRenderer
from scene.camera import Camera
from scene.motion import Motion, Pose
from services.live.keypoints_packet import KeypointsPacket
from services.live.look.picture import AlignedPose, LookPicture, PoseRequest
from services.live.look.receiver import PICTURE_PX
from services.live.motion.live_looks import PerformerLook, cropped, seen_of
from services.live.motion.live_motion import LiveMotion
from services.live.room import MeetingPerformer, Room
from tests.capture.people import body
from tests.services.live.people import seen

COLOURS = slice(COLOUR, COLOUR + 3)
WINDOW = (120, 20, 440)
RED, BLUE = (0.7, 0.2, 0.2), (0.2, 0.2, 0.7)
SIDE = PICTURE_PX


class AtOnce(Executor):
    """Does what it is given before it returns."""

    def submit(self, fn, /, *args, **kwargs):
        done: Future = Future()
        done.set_result(fn(*args, **kwargs))
        return done


def model_of(colour: tuple[float, float, float]) -> SplatModel:
    """A person all in one colour."""
    whole = body()
    assert whole.rest_vertices is not None
    assert whole.blend_weights is not None
    rest, weights = whole.rest_vertices[::4], whole.blend_weights[::4]
    parameters = np.zeros((len(rest), PARAMETERS), np.float32)
    parameters[:, :3] = rest
    parameters[:, LOG_SCALE : LOG_SCALE + 3] = np.log(0.02)
    parameters[:, ROTATION] = 1.0
    parameters[:, COLOURS] = colour
    parameters[:, OPACITY] = 3.0
    joints = np.argsort(-weights, axis=1)[:, :4]
    most = np.take_along_axis(weights, joints, axis=1).astype(np.float32)
    return SplatModel(
        parameters,
        joints.astype(np.uint8),
        most / most.sum(axis=1, keepdims=True),
        np.ones(len(rest), bool),
        whole.skeleton,
        Motion.from_poses([Pose.rest()]),
        data_hash="",
    )


class Sent:
    """Somebody in green, whose webcam sees them in red."""

    def __init__(self) -> None:
        self.now_s = 100.0
        self.model = model_of((0.2, 0.5, 0.2))
        self.motion = LiveMotion(self.model.skeleton)
        self.look = PerformerLook(self.motion, AtOnce(), lambda: self.now_s)
        self.packets = 0

    def keypoints(self, count: int = 1, lifted_rad: float = 0.0) -> KeypointsPacket:
        """The newest of so many, 30 a second, each with an arm further up."""
        for _ in range(count):
            angles = Pose.rest().joint_angles.copy()
            angles[16, 2] = -1.2 + lifted_rad * self.packets
            angles[17, 2] = 1.2
            time_s = 5.0 + self.packets / 30.0
            packet = seen(Pose(angles, np.zeros(3), time_s), self.packets)
            self.packets, self.now_s = self.packets + 1, 100.0 + self.packets / 30.0
            self.motion.update(packet, self.now_s)
        return packet

    def clapping(self, number: int, clap: int) -> KeypointsPacket:
        """The packet of that number: arms are up, and from `clap` on down, within 0.1 s."""
        angles = Pose.rest().joint_angles.copy()
        down = min(max((number - clap) / 3.0 + 0.5, 0.0), 1.0)
        angles[16, 2], angles[17, 2] = -0.8 + 1.6 * down, 0.8 - 1.6 * down
        return seen(Pose(angles, np.zeros(3), 5.0 + number / 30.0), number)

    def picture(
        self, packet: KeypointsPacket, late_s: float = 0.1, request: PoseRequest | None = None
    ) -> None:
        """What the webcam saw then, `late_s` after it was known how they moved."""
        picture = self.cut_out(packet, RED)
        self.now_s += late_s
        self.look.receive(picture, request)

    def cut_out(self, packet: KeypointsPacket, colour: tuple[float, float, float]) -> LookPicture:
        """What the webcam saw then, of somebody in that colour."""
        solved = self.motion.solved(packet.capture_time_ms)
        assert solved is not None
        empty = np.zeros((SIDE, SIDE), np.uint8)
        captured_ms = int(packet.capture_time_ms) % 65536
        sent = LookPicture(captured_ms, WINDOW, np.zeros((SIDE, SIDE, 3), np.uint8), empty)
        camera, pose = cropped(solved.camera, sent), solved.pose
        skeleton = self.model.skeleton
        transforms = skeleton.skinning_transforms(pose.joint_angles, pose.root_translation)
        drawn = SplatRenderer((model_of(colour),)).render(camera, [transforms])
        rgb, matte = ((255.0 * of + 0.5).astype(np.uint8) for of in (drawn[..., :3], drawn[..., 3]))
        return replace(sent, rgb=rgb, matte=matte)


@pytest.fixture(scope="module")
def sent() -> Sent:
    return Sent()


def test_the_performer_takes_the_colours_of_the_picture(sent):
    packet = sent.keypoints(3)
    sent.picture(packet)
    assert sent.look.shown_of(sent.model) is None, "nobody had drawn them"
    sent.picture(sent.keypoints())
    shown = sent.look.shown_of(sent.model)
    assert shown is not None
    redder = shown.appearance.change[:, 0] > 0.25
    # those that face the webcam; the others take the exposure alone
    assert 0.2 < redder.mean() < 0.8
    assert shown.appearance.change[redder, 1].mean() < -0.15


def test_it_is_gone_at_once_when_stopped_and_comes_back(sent):
    sent.look.shown_of(sent.model)
    sent.picture(sent.keypoints())
    assert sent.look.shown_of(sent.model) is not None
    sent.look.stop()
    assert sent.look.shown_of(sent.model) is None
    sent.picture(sent.keypoints())
    assert sent.look.shown_of(sent.model) is not None


def test_a_better_model_takes_its_own_colours(sent):
    better = model_of((0.2, 0.5, 0.2))
    assert sent.look.shown_of(better) is None
    sent.picture(sent.keypoints())
    assert sent.look.shown_of(better) is not None
    assert sent.look.shown_of(sent.model) is None


def test_a_picture_of_no_known_moment_is_not_shown(sent):
    sent.look.stop()
    sent.look.shown_of(sent.model)
    black = np.zeros((SIDE, SIDE, 3), np.uint8)
    sent.look.receive(LookPicture(12_345, WINDOW, black, black[..., 0]))
    assert sent.look.shown_of(sent.model) is None


def test_pages_that_draw_get_the_pose_of_a_picture_and_the_server_no_colours():
    sent, got = Sent(), list[AlignedPose]()
    packet = sent.keypoints(3, lifted_rad=0.1)
    sent.picture(packet, request=PoseRequest(sent.model, got.append))
    solved = sent.motion.solved(packet.capture_time_ms)
    assert solved is not None
    (aligned,) = got
    gap = np.abs(aligned.pose.joint_angles - solved.pose.joint_angles)
    assert gap.max() < 0.1
    assert (aligned.camera.width, aligned.camera.height) == (SIDE, SIDE)
    np.testing.assert_allclose(
        aligned.pelvis, sent.model.skeleton.rest_joints[0] + aligned.pose.root_translation
    )
    # the webcam's clock began at 5 s, and ours at 100 s
    assert aligned.moment_s == pytest.approx(95.0 + solved.pose.time_s, abs=1e-6)
    assert sent.look.shown_of(sent.model) is None


def room_of(sent: Sent) -> Room:
    """They alone."""
    performer = MeetingPerformer("a", "Ada", sent.model, sent.model.motion, (0.0, 0.0, 0.0), 0.0)
    return Room("m", (performer,), live_motions={"a": sent.motion}, looks={"a": sent.look})


def test_motion_waits_for_the_picture():
    sent = Sent()
    room = room_of(sent)
    sent.look.shown_of(sent.model)
    packet = sent.keypoints(20, lifted_rad=0.03)
    then = sent.motion.pose_at(sent.now_s)
    assert then is not None
    sent.keypoints(4, lifted_rad=0.03)
    sent.picture(packet, late_s=0.0)
    shown, ahead = (
        room.scene_at(sent.now_s, live_look=on).performers[0].pose.joint_angles[16]
        for on in (True, False)
    )
    np.testing.assert_allclose(shown, then.joint_angles[16], atol=0.02)
    assert np.abs(ahead - then.joint_angles[16]).max() > 0.08


@pytest.mark.parametrize("late_s", [0.05, 0.25])
def test_a_clap_is_seen_in_motion_and_colour_at_once(late_s: float):
    """Both arms fall within a tenth of a second, and at that very frame red turns to blue."""
    sent = Sent()
    room, clap = room_of(sent), 60
    coming: deque[tuple[float, LookPicture]] = deque()
    seen_s = {"motion": np.inf, "without live look": np.inf, "colour": np.inf}
    for tick in range(3 * 90):
        now_s = sent.now_s = 100.0 + tick / 90.0
        if tick % 3 == 0:  # 30 packets a second, and 10 pictures, which are later
            number = tick // 3
            packet = sent.clapping(number, clap)
            sent.motion.update(packet, now_s)
            if number % 3 == 0:
                colour = RED if number < clap else BLUE
                coming.append((now_s + late_s, sent.cut_out(packet, colour)))
        while coming and coming[0][0] <= now_s:
            sent.look.receive(coming.popleft()[1])
        shown, ahead = (room.scene_at(now_s, live_look=on).performers[0] for on in (True, False))
        appearance = shown.appearance
        signs = {
            "motion": shown.pose.joint_angles[16, 2] > 0.0,
            "without live look": ahead.pose.joint_angles[16, 2] > 0.0,
            "colour": appearance is not None and appearance.change[:, 2].max() > 0.2,
        }
        for name, is_seen in signs.items():
            if is_seen:
                seen_s[name] = min(seen_s[name], now_s)
    # from one picture to the next motion goes on
    assert abs(seen_s["motion"] - seen_s["colour"]) < 1.2 / 10.0
    # what is solved is smoothed, by some 0.03 s
    assert seen_s["colour"] - seen_s["without live look"] > late_s - 0.04


@pytest.mark.parametrize(
    ("window", "rows", "columns"),
    [
        ((0, 0, 480), (0, 384), (0, 384)),
        ((-48, -128, 736), (67, 317), (26, 358)),
        ((300, -96, 576), (64, 384), (0, 226)),
        ((2000, 2000, 100), (0, 1), (0, 1)),
    ],
)
def test_beyond_the_webcams_picture_nothing_is_known(window, rows, columns):
    rng = np.random.default_rng(5)
    rgb = rng.integers(0, 255, (SIDE, SIDE, 3), np.uint8)
    whole = Camera(np.array([[557.0, 0, 320], [0, 557, 240], [0, 0, 1]]), np.eye(3, 4), 640, 480)
    sent = LookPicture(0, window, rgb, rgb[..., 0])
    seen = seen_of(sent, whole, Pose.rest())
    inside = slice(*rows), slice(*columns)
    assert (seen.rgb == rgb[inside]).all()
    assert (seen.matte == rgb[..., 0][inside]).all()
    # what is kept is seen where it was
    point = np.array([[0.03, -0.02, 1.0]])
    moved = cropped(whole, sent).project(point)[0] - seen.camera.project(point)[0]
    assert moved[0] == pytest.approx([columns[0], rows[0]], abs=1e-3)
