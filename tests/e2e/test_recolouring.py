"""Live look as a page works it out and draws it, in a real Chromium, against the server's."""

from __future__ import annotations

import base64
from dataclasses import replace
from typing import Any

import cv2
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
from scene.live_appearance import LaidPicture, LiveAppearance
from scene.motion import Pose
from scene.skeleton import CHEST
from services.api.environments import Light
from services.environments import environment, find_theme
from services.live.look.keying import lifted, lowered
from services.live.look.packets import Whose, encode_aligned_pose
from services.live.look.picture import AlignedPose
from services.live.look.receiver import PICTURE_PX
from services.live.room import Room
from tests.e2e.test_splats import asked, drawn, page, psnr, room_of
from tests.renderer.splats.viewer_file import decode, demo_model, read_levels

__all__ = ["page"]  # fixture
pytestmark = pytest.mark.e2e

NOW_S = 0.4
COLOURS = slice(COLOUR, COLOUR + 3)
SIDE = 144
FINE = PICTURE_PX
STEPS = 511
LOOK_HEAD_BYTES = 28
"""Of a picture's pose, before the packet of the pose itself."""


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
        return self._picture(pose, self.camera)

    def fine_picture(self, pose: Pose) -> WebcamPicture:
        """The same, as large as it is sent."""
        return self._picture(pose, self.camera.resized(FINE, FINE))

    def _picture(self, pose: Pose, camera: Camera) -> WebcamPicture:
        transforms = self.model.skeleton.skinning_transforms(
            pose.joint_angles, pose.root_translation
        )
        renderer = SplatRenderer((self.now,))
        seen = renderer.render(camera, [transforms], expressions=[pose.expression])
        levels = (255.0 * np.clip(seen, 0.0, 1.0) + 0.5).astype(np.uint8)
        rgb, matte = lowered(lifted(levels[..., :3], (seen[..., 3] > 0.9).astype(np.float32)))
        return WebcamPicture(rgb, matte, camera, pose)


def told(picture: WebcamPicture, pose: Pose, model: SplatModel) -> dict[str, str]:
    """What a page gets: the picture as it is sent, and the packet of the pose."""
    pelvis = model.skeleton.rest_joints[0] + pose.root_translation
    aligned = AlignedPose(pose, pelvis, picture.camera, pose.time_s)
    packet = encode_aligned_pose(Whose(0, 1, 7), 1, aligned)
    return {"picture": as_sent(picture), "packet": base64_of(packet)}


def as_sent(picture: WebcamPicture) -> str:
    rgb = lifted(picture.rgb, picture.matte.astype(np.float32) / 255.0)
    return base64_of(np.dstack([rgb, np.full(rgb.shape[:2], 255, np.uint8)]).tobytes())


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
    changed = replace(scene, performers=(first, replace(second, appearance=LiveAppearance(change))))
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


def stripes(strength: float, width_px: int = 2) -> Float[Array, "H W 3"]:
    """Factors of a picture: upright stripes, by default finer than splats."""
    dark = np.arange(FINE) // width_px % 2 == 0
    row = np.where(dark, 1.0 - strength, 1.0 + strength)
    return np.broadcast_to(row[None, :, None], (FINE, FINE, 3))


def laid_picture(
    room: Room, index: int, camera: Camera, detail: Float[Array, "H W 3"]
) -> LaidPicture:
    """`detail` as a webcam at the place of `camera` would have it laid on who stands there, all of
    whom it sees."""
    performer = room.scene_at(NOW_S).performers[index]
    model = performer.model
    assert isinstance(model, SplatModel)
    skinning = performer.placement @ model.skeleton.skinning_transforms(
        performer.pose.joint_angles, performer.pose.root_translation
    )
    blended = np.einsum("nk,nkij->nij", model.weights, skinning[model.joints])
    rest = np.c_[model.parameters[:, :3], np.ones(len(model))]
    pixels, _ = camera.project(np.einsum("nij,nj->ni", blended, rest)[:, :3])
    places = np.c_[pixels * (FINE / camera.width), np.ones(len(model))]
    places[((places < 0) | (places > FINE)).any(axis=1)] = 0.0
    chest = skinning[CHEST]
    return LaidPicture(
        detail.astype(np.float32),
        places.astype(np.float32),
        chest[:3, :3].T @ (camera.position - chest[:3, 3]),
        float(camera.intrinsics[0, 0]) * FINE / camera.width,
    )


def laid(
    room: Room, index: int, camera: Camera, detail: Float[Array, "H W 3"]
) -> dict[str, object]:
    """The same, as a page takes it."""
    picture = laid_picture(room, index, camera, detail)
    model = room.scene_at(NOW_S).performers[index].model
    assert isinstance(model, SplatModel)
    all_levels = level_tree(model).spread(picture.places)
    all_levels[:, :2] /= np.maximum(all_levels[:, 2:], 1e-6)
    return {
        "index": index,
        "places": base64_of(all_levels.astype("<f4").tobytes()),
        "detail": base64_of(picture.detail.astype("<f4").tobytes()),
        "webcam": picture.webcam.tolist(),
        "focalPx": picture.focal_px,
    }


def covered(room: Room, index: int, camera: Camera) -> Array:
    """Where the person is and nothing shines through."""
    performer = room.scene_at(NOW_S).performers[index]
    model = performer.model
    assert isinstance(model, SplatModel)
    pose = performer.pose
    skinning = performer.placement @ model.skeleton.skinning_transforms(
        pose.joint_angles, pose.root_translation
    )
    seen = SplatRenderer((model,)).render(camera, [skinning], expressions=[pose.expression])
    return np.asarray(seen[..., 3] > 0.98)


def test_a_picture_that_is_laid_on_shows_what_splats_are_too_coarse_for(page: Page):
    """At the webcam's own place, on all levels; nothing 40 degrees beside it, and after its end."""
    room = room_of(demo_model(), 1)
    webcam, beside = (
        orbit_camera((0.0, 1.2, 0.0), 1.6, azimuth_rad, 0.0, FINE, FINE)
        for azimuth_rad in (0.0, np.radians(40.0))
    )
    detail = stripes(0.3)
    on = {"laid": [laid(room, 0, webcam, detail)]}
    for kept in ({}, {"kept": [len(demo_model()) // 2]}):
        what = asked(room, webcam, NOW_S, **kept)
        plain, striped = drawn(page, what), drawn(page, what | on)
        inside = covered(room, 0, webcam)
        truth = np.minimum(plain * detail, 255.0)[inside]
        assert psnr(plain[inside], truth) < 20.0
        assert psnr(striped[inside], truth) > 30.0  # measured: 35
        np.testing.assert_array_equal(drawn(page, what), plain)
    away = asked(room, beside, NOW_S)
    np.testing.assert_array_equal(drawn(page, away | on), drawn(page, away))


@pytest.mark.parametrize(("beside_deg", "width_px"), [(0.0, 2), (12.0, 8)])
def test_the_page_lays_a_picture_on_as_the_server_does(
    page: Page, beside_deg: float, width_px: int
):
    """At the webcam's place; and where half of it is gone, and splats that shine through lie beside
    where those before them do."""
    model = demo_model()
    room, detail = room_of(model, 1), stripes(0.3, width_px)
    webcam, view = (
        orbit_camera((0.0, 1.2, 0.0), 1.6, np.radians(degrees), 0.0, FINE, FINE)
        for degrees in (0.0, beside_deg)
    )
    scene = room.scene_at(NOW_S)
    (performer,) = scene.performers
    nothing = np.zeros((len(model), 3), np.float32)
    appearance = LiveAppearance(nothing, laid_picture(room, 0, webcam, detail))
    striped = replace(scene, performers=(replace(performer, appearance=appearance),))
    server = SceneRenderer().render(striped, view)
    inside = covered(room, 0, view)
    what = asked(room, view, NOW_S)
    plain, local = drawn(page, what), drawn(page, what | {"laid": [laid(room, 0, webcam, detail)]})
    assert psnr(plain[inside], server[inside]) < 25.0
    # measured: 35 and 33; 17 and 23 without
    assert psnr(local[inside], server[inside]) > 31.0


def test_a_laid_picture_is_in_the_scale_of_the_view(page: Page):
    """In a view that is twice as fine, the picture's pixels are twice as wide."""
    room = room_of(demo_model(), 1)
    webcam, view = (
        orbit_camera((0.0, 1.2, 0.0), 1.6, 0.0, 0.0, side, side) for side in (FINE, 2 * FINE)
    )
    detail = stripes(0.3)
    plain, striped = (
        drawn(page, asked(room, view, NOW_S, laid=on))
        for on in ([], [laid(room, 0, webcam, detail)])
    )
    inside = covered(room, 0, view)
    # between pixels the picture is smooth
    wide = cv2.resize(np.ascontiguousarray(detail), (2 * FINE, 2 * FINE))
    truth = np.minimum(plain * wide, 255.0)[inside]
    assert psnr(plain[inside], truth) < 20.0
    assert psnr(striped[inside], truth) > 30.0


def test_a_picture_is_laid_on_its_own_person(page: Page):
    room = room_of(demo_model(), 2)
    x, _, z = room.performers[1].position
    webcam = orbit_camera((x, 1.2, z), 2.4, 0.0, 0.0, FINE, FINE)
    what = asked(room, webcam, NOW_S)
    plain = drawn(page, what)
    striped = drawn(page, what | {"laid": [laid(room, 1, webcam, stripes(0.3))]})
    change = np.abs(striped.astype(int) - plain).max(axis=-1)
    first, second = (covered(room, index, webcam) for index in (0, 1))
    assert (change[second] > 20).mean() > 0.5
    others = first & ~second
    assert others.sum() > 500
    assert np.quantile(change[others], 0.98) <= 3


@pytest.mark.parametrize(("strength", "gained_db"), [(0.3, 6.0), (0.1, 6.0), (0.0, 3.0)])
def test_the_page_lays_on_what_a_webcam_sees(page: Page, strength: float, gained_db: float):
    """Of a person in striped light, for which live colours are too coarse and pictures are not; one
    who looks as they were filmed looks no worse: measured are 17, 26 and 41 dB, and 26, 35 and 47.
    """
    model = demo_model()
    data = encode(model)
    webcam = Webcam(decode(data, model), model)
    seen, pose = [], webcam.pose(0, 0.0)
    for number in range(4):
        pose = webcam.pose(number, 0.0)
        fine = webcam.fine_picture(pose)
        striped = np.minimum(fine.rgb * stripes(strength), 255.0).astype(np.uint8)
        fine = replace(fine, rgb=striped)
        seen.append(told(fine.resized(SIDE / FINE), pose, model) | {"fine": as_sent(fine)})
    found = page.evaluate(
        "what => window.laidOf(what)", {"file": base64_of(data), "side": SIDE, "seen": seen}
    )
    last, picture = found[-1], fine
    packet = base64.b64decode(seen[-1]["packet"])[LOOK_HEAD_BYTES:]
    what = asked(room_of(model, 1), picture.camera, NOW_S) | {"poses": [base64_of(packet)]}
    on = {"laid": [{"index": 0, **unpacked_picture(last)}]}
    inside = picture.known() > 0.0
    coloured = what | {"changes": last["changes"]}
    without, whole = (
        psnr(drawn(page, shown)[inside], picture.rgb[inside]) for shown in (coloured, coloured | on)
    )
    assert whole > without + gained_db


def unpacked_picture(told: dict[str, Any]) -> dict[str, object]:
    """What the page packed for the card, as it takes it from a test."""
    detail, places = (
        np.frombuffer(base64.b64decode(told[key]), "<u4") for key in ("detail", "places")
    )
    factors = (detail[:, None] >> np.array([0, 10, 20]) & 1023) / 255.0
    x, y = ((places >> shift & 4095) / 4095.0 * FINE for shift in (0, 12))
    rows = np.stack([x, y, (places >> 24) / 255.0], axis=1)
    return {
        "detail": base64_of(factors.astype("<f4").tobytes()),
        "places": base64_of(rows.astype("<f4").tobytes()),
        "webcam": told["webcam"],
        "focalPx": told["focalPx"],
    }
