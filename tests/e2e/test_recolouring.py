"""Live look as a page works it out and draws it, in a real Chromium, against the server's."""

from __future__ import annotations

import base64
from dataclasses import replace

import numpy as np
import pytest
from playwright.sync_api import Page

from renderer.live_look.live_look import LiveLook
from renderer.live_look.picture import WebcamPicture
from renderer.scene_renderer import SceneRenderer
from renderer.splats.files.viewer_file import encode
from renderer.splats.layout import COLOUR
from renderer.splats.levels.tree import level_tree
from renderer.splats.model import SplatModel
from renderer.splats.rasteriser.renderer import SplatRenderer
from scene import orbit_camera
from scene.arrays import Array, Float
from scene.camera import Camera
from scene.motion import Pose
from services.api.environments import Light
from services.environments import environment, find_theme
from services.live.look.packets import Whose, encode_aligned_pose
from services.live.look.picture import AlignedPose
from tests.e2e.test_splats import asked, drawn, page, psnr, room_of
from tests.renderer.splats.viewer_file import decode, demo_model, read_levels

__all__ = ["page"]  # fixture
pytestmark = pytest.mark.e2e

COLOURS = slice(COLOUR, COLOUR + 3)
SIDE = 144
STEPS = 511


def base64_of(data: bytes) -> str:
    return base64.b64encode(data).decode()


def packed(changes: Float[Array, "N 3"]) -> bytes:
    """Three signed numbers of ten bits each, red lowest."""
    levels = np.rint(STEPS * np.clip(changes, -1.0, 1.0)).astype(np.int64) & 1023
    return (levels[:, 0] | levels[:, 1] << 10 | levels[:, 2] << 20).astype("<u4").tobytes()


def unpacked(data: bytes) -> Float[Array, "N 3"]:
    levels = np.frombuffer(data, "<u4")[:, None] >> np.array([0, 10, 20]) & 1023
    return (levels.astype(float) - 1024 * (levels > 511)) / STEPS


class Webcam:
    """A webcam, 1.2 m before somebody's chest, whose picture is a square."""

    def __init__(self, model: SplatModel, now: SplatModel) -> None:
        self.model, self.now = model, now
        focal = 1.1 * SIDE
        k = np.array([[focal, 0.0, SIDE / 2], [0.0, focal, SIDE / 2], [0.0, 0.0, 1.0]])
        before = np.concatenate([np.diag([1.0, -1.0, -1.0]), np.zeros((3, 1))], axis=1)
        self.camera = Camera(k, before, SIDE, SIDE)

    def pose(self, number: int, turned_rad: float) -> Pose:
        """A pose of the model's own motion, before the webcam, turned to its left."""
        pose = self.model.motion.pose(number % len(self.model.motion))
        angles = pose.joint_angles.copy()
        angles[0] = 0.0, turned_rad, 0.0
        root = np.array([0.0, -0.35, -1.2]) - self.model.skeleton.rest_joints[0]
        return replace(pose, joint_angles=angles, root_translation=root, time_s=20.0 + number / 15)

    def picture(self, pose: Pose) -> WebcamPicture:
        """What it sees of the person as they look now."""
        transforms = self.model.skeleton.skinning_transforms(
            pose.joint_angles, pose.root_translation
        )
        renderer = SplatRenderer((self.now,))
        seen = renderer.render(self.camera, [transforms], expressions=[pose.expression])
        levels = (255.0 * np.clip(seen, 0.0, 1.0) + 0.5).astype(np.uint8)
        return WebcamPicture(levels[..., :3].copy(), levels[..., 3].copy(), self.camera, pose)


def told(picture: WebcamPicture, pose: Pose, model: SplatModel) -> dict[str, str]:
    """What a page gets: the picture's pixels above its matte's, and the packet of the pose."""
    rgba = np.full((2 * SIDE, SIDE, 4), 255, np.uint8)
    rgba[:SIDE, :, :3], rgba[SIDE:, :, :3] = picture.rgb, picture.matte[..., None]
    pelvis = model.skeleton.rest_joints[0] + pose.root_translation
    aligned = AlignedPose(pose, pelvis, picture.camera, pose.time_s)
    packet = encode_aligned_pose(Whose(0, 1, 7), 1, aligned)
    return {"picture": base64_of(rgba.tobytes()), "packet": base64_of(packet)}


@pytest.mark.parametrize("lit", [False, True], ids=["mean-colours", "light-of-the-clip"])
def test_the_page_finds_the_changes_that_the_server_finds(page: Page, lit: bool):
    """Of 10,000 splats, over eight pictures in which the person moves and turns to the side."""
    demo = demo_model()
    light = np.zeros((9, 3), np.float32)
    light[0], light[2] = 2.2, [0.9, 0.7, 0.5]
    data = encode(replace(demo, light=light if lit else None))
    model = decode(data, demo)
    repainted = model.parameters.copy()
    repainted[:, COLOURS] += 0.5 * (np.array([0.15, 0.25, 0.8]) - repainted[:, COLOURS])
    webcam = Webcam(model, replace(model, parameters=repainted, light=None))
    look, seen, wanted = LiveLook(model), [], []
    for number in range(8):
        picture = webcam.picture(webcam.pose(number, 0.1 * number))
        aligned = look.align(picture)
        look.take_colours(picture, aligned)
        wanted.append(look.change_at(picture.pose.time_s))
        seen.append(told(picture, aligned.pose, model))
    told_page = {"file": base64_of(data), "side": SIDE, "seen": seen}
    found = page.evaluate("what => window.recoloured(what)", told_page)
    _, until = read_levels(data)
    finest = until > len(model)
    for number, (got, truth) in enumerate(zip(found, wanted, strict=True)):
        gap = np.abs(unpacked(base64.b64decode(got))[finest] - truth)
        # measured: 0.001, 0.02 and 0.07; a step of what is packed is 0.002
        assert gap.mean() < 0.002, number
        assert np.quantile(gap, 0.999) < 0.04, number
        assert gap.max() < 0.15, number
    blue = wanted[-1][:, 2]
    assert (blue > 0.15).mean() > 0.1, "much of the person is seen to be bluer"
    assert (np.abs(blue) < 0.1).mean() > 0.1, "and much is not seen"


@pytest.mark.parametrize("theme", [None, "apartment"])
def test_the_page_adds_live_changes_as_the_server_does(page: Page, theme: str | None):
    """In the light of their clip, where a change is as large as it is, and in a room's."""
    demo = demo_model()
    light = np.zeros((9, 3), np.float32)
    light[0], light[2] = 2.2, [0.9, 0.7, 0.5]
    demo = replace(demo, light=light)
    room, now_s = room_of(demo, 2), 0.4
    place = None
    if theme is not None:
        about = find_theme(theme)
        assert about.picture is not None
        assert about.lighting is not None
        room.environment = environment(theme)
        place = {
            "picture": base64_of(about.picture.read_bytes()),
            "light": Light.of(about.lighting).model_dump(mode="json"),
        }
    change = np.random.default_rng(5).normal(0.0, 0.15, (len(demo), 3)).astype(np.float32)
    change += [0.3, -0.2, 0.1]
    scene = room.scene_at(now_s)
    first, second = scene.performers
    changed = replace(scene, performers=(first, replace(second, colour_change=change)))
    camera = orbit_camera((-0.6, 0.9, 1.0), 4.7, 1.0, 0.1, 384, 384)  # both are in view
    in_order = level_tree(demo).spread(change)
    changes = packed(np.concatenate([np.zeros_like(in_order), in_order]))
    what = asked(room, camera, now_s, place=place)
    local, without = (
        drawn(page, what | {"changes": base64_of(data)}) for data in (changes, bytes(len(changes)))
    )
    server = SceneRenderer().render(changed, camera)
    plain = SceneRenderer().render(scene, camera)
    assert psnr(server, plain) < 32.0, "the comparison can fail"
    assert psnr(without, plain) > 40.0
    assert psnr(local, server) > psnr(without, plain) - 1.5
