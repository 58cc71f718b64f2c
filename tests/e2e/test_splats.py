"""The page's own splat pass in a real Chromium against the server's renderer: one picture."""

from __future__ import annotations

import base64
import functools
import http.server
import subprocess
import threading
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Page

from benchmarks.browser import open_page
from renderer.scene_renderer import SceneRenderer
from renderer.splats.files.viewer_file import encode
from renderer.splats.levels.tree import level_tree
from renderer.splats.model import SplatModel
from scene import orbit_camera
from scene.camera import Camera
from scene.expression import BLEND_SHAPE_COUNT, EXPRESSION_COUNT, EXPRESSION_NAMES
from scene.rotations import matrix_to_quaternion
from services.api.environments import Light
from services.environments import environment, find_theme
from services.live.room import MeetingPerformer, Room
from services.live.streaming.pose_feed import pose_packets
from tests.renderer.splats.viewer_file import demo_model

pytestmark = pytest.mark.e2e

_ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    """The client's modules, built as its own page is."""
    out = tmp_path_factory.mktemp("page")
    build = ["npx", "vite", "build", str(Path(__file__).parent / "splat_page")]
    options = ["--outDir", str(out), "--emptyOutDir", "--logLevel", "warn"]
    subprocess.run([*build, *options], cwd=_ROOT / "client", check=True)
    handler = functools.partial(http.server.SimpleHTTPRequestHandler, directory=str(out))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        with open_page() as made:
            made.goto(f"http://127.0.0.1:{server.server_port}/")
            made.wait_for_function("() => 'picture' in window")
            yield made
        server.shutdown()


@pytest.fixture(scope="module")
def demo() -> SplatModel:
    return demo_model()


def room_of(model: SplatModel, people: int) -> Room:
    cast = (MeetingPerformer.at_place(str(i), str(i), model, i) for i in range(people))
    return Room("m", tuple(cast))


def asked(room: Room, camera: Camera, now_s: float, **more: object) -> dict[str, object]:
    """What the page is asked to draw."""
    files = {id(m.model): base64.b64encode(encode(m.model)).decode() for m in room.performers}  # type: ignore[arg-type]
    return {
        "files": [files[id(member.model)] for member in room.performers],
        "poses": [base64.b64encode(data).decode() for data in pose_packets(room, now_s, 1)],
        "position": camera.position.tolist(),
        "wxyz": matrix_to_quaternion(camera.rotation.T.copy()[None])[0].tolist(),
        "fovYRad": camera.fov_y_rad,
        "width": camera.width,
        "height": camera.height,
        "hideUnseen": False,
        "most": 60_000,
        "yawsRad": [member.yaw_rad for member in room.performers],
        **more,
    }


def drawn(page: Page, what: dict[str, object]) -> np.ndarray:
    data = base64.b64decode(page.evaluate("what => window.picture(what)", what))
    size = (int(str(what["height"])), int(str(what["width"])))
    return np.frombuffer(data, np.uint8).reshape(*size, 4)[..., :3]


def psnr(a: np.ndarray, b: np.ndarray) -> float:
    error = (a.astype(float) - b.astype(float)) / 255.0
    return float(-10.0 * np.log10((error**2).mean()))


@pytest.mark.parametrize(
    ("people", "azimuth_rad", "size", "hide_unseen"),
    [(1, 0.3, 512, False), (1, 2.5, 256, True), (3, -0.6, 384, False)],
)
def test_the_page_draws_what_the_server_draws(
    page: Page, demo: SplatModel, people: int, azimuth_rad: float, size: int, hide_unseen: bool
):
    """51, 50 and 49 dB: blending in eight bits takes 6 dB, the fewer bits of the file the rest."""
    room, now_s = room_of(demo, people), 0.4
    distance_m = 3.2 if people == 1 else 4.7
    camera = orbit_camera((0.0, 0.9, 0.0), distance_m, azimuth_rad, 0.1, size, size)
    local = drawn(page, asked(room, camera, now_s, hideUnseen=hide_unseen))
    server = SceneRenderer().render(room.scene_at(now_s, hide_unseen=hide_unseen), camera)
    assert psnr(local, server) > 46.0


def test_the_page_draws_everybody_in_the_light_of_their_own_clip(page: Page, demo: SplatModel):
    """As the server does, turned with them; who has none stands beside in their mean colours."""
    rng, dull = np.random.default_rng(7), replace(demo, light=None)
    lights = [np.concatenate([[[2.6] * 3], rng.normal(0.0, 0.5, (8, 3))]) for _ in range(2)]
    bright = [replace(demo, light=light.astype(np.float32)) for light in lights]
    models = (bright[0], dull, bright[1])
    places, now_s = room_of(demo, 3).performers, 0.4
    cast = [replace(member, model=model) for member, model in zip(places, models, strict=True)]
    room = Room("m", tuple(cast))
    camera = orbit_camera((0.0, 0.9, 0.0), 4.7, 0.4, 0.1, 384, 384)
    local = drawn(page, asked(room, camera, now_s))
    assert psnr(local, SceneRenderer().render(room.scene_at(now_s), camera)) > 44.0
    straight = drawn(page, asked(room, camera, now_s, yawsRad=[0.0, 0.0, 0.0]))
    assert psnr(straight, local) < 40.0
    flat = Room("m", tuple(replace(member, model=dull) for member in places))
    assert psnr(local, SceneRenderer().render(flat.scene_at(now_s), camera)) < 35.0


def test_the_page_moves_faces_and_hands_as_the_server_does(page: Page, demo: SplatModel):
    """Of two who stand there the first opens their mouth; so it does with half of the splats."""
    rng, head = np.random.default_rng(3), demo.skeleton.rest_joints[15]
    near = np.linalg.norm(demo.parameters[:, :3] - head, axis=1) < 0.25
    moving = np.flatnonzero(near)
    offsets = np.zeros((len(moving), BLEND_SHAPE_COUNT, 3), np.float32)
    offsets[:, 0] = [0.0, -0.03, 0.02]
    offsets[:, 4] = rng.normal(0.0, 0.004, (len(moving), 3))
    offsets[:, EXPRESSION_COUNT] = [0.02, 0.0, 0.0]  # as the left thumb curls, and half-way most
    face = replace(demo, expression_splats=moving, expression_offsets=offsets)
    still = room_of(face, 2)
    shown = np.zeros((len(demo.motion), EXPRESSION_COUNT))
    shown[:, [0, 4, EXPRESSION_NAMES.index("left_thumb_curl")]] = 0.8, 0.5, 0.4
    talking = replace(still.performers[0], motion=replace(demo.motion, expressions=shown))
    room, now_s = Room("m", (talking, still.performers[1])), 0.4
    x, _, z = talking.position
    camera = orbit_camera((x, 1.4, z), 1.6, 0.9, 0.0, 384, 384)  # past the other's shoulder
    local, resting = (drawn(page, asked(one, camera, now_s)) for one in (room, still))
    assert psnr(local, SceneRenderer().render(room.scene_at(now_s), camera)) > 44.0
    assert psnr(resting, SceneRenderer().render(still.scene_at(now_s), camera)) > 44.0
    assert psnr(local, resting) < 35.0
    few = {"most": len(demo)}
    assert psnr(drawn(page, asked(room, camera, now_s, **few)), local) > psnr(local, resting)


@pytest.mark.parametrize(
    ("theme", "azimuth_rad", "elevation_rad"),
    [("apartment", 0.3, 0.1), ("lobby", 2.5, 0.5), ("park", -1.6, -0.1)],
)
def test_the_page_draws_a_place_and_its_light_as_the_server_does(
    page: Page, demo: SplatModel, theme: str, azimuth_rad: float, elevation_rad: float
):
    """51, 49 and 50 dB: the panorama as a browser reads its JPEG, what it lights, the shadows."""
    room, now_s = room_of(demo, 2), 0.4
    room.environment = environment(theme)
    camera = orbit_camera((0.0, 0.9, 0.0), 4.0, azimuth_rad, elevation_rad, 384, 384)
    about = find_theme(theme)
    assert about.picture is not None
    assert about.lighting is not None
    place = {
        "picture": base64.b64encode(about.picture.read_bytes()).decode(),
        "light": Light.of(about.lighting).model_dump(mode="json"),
    }
    local = drawn(page, asked(room, camera, now_s, place=place))
    server = SceneRenderer().render(room.scene_at(now_s), camera)
    assert psnr(local, server) > 40.0
    people = SceneRenderer().render(Room("m", room.performers).scene_at(now_s), camera)
    assert psnr(local, people) < 25.0


def test_a_shared_screen_hangs_behind_everybody(page: Page, demo: SplatModel):
    room = room_of(demo, 1)
    camera = orbit_camera((0.0, 1.2, 0.0), 4.0, 0.25, 0.05, 384, 384)
    without, shared = (
        drawn(page, asked(room, camera, 0.4, screen=screen)) for screen in (False, True)
    )

    def seen(x: float, y: float, z: float = -1.9) -> list[int]:
        pixels, _ = camera.project(np.array([[x, y, z]]))
        column, row = np.floor(pixels[0]).astype(int)
        return shared[row, column].tolist()

    assert seen(-1.2, 1.2) == [255, 0, 0]
    assert seen(1.1, 1.6) == [0, 0, 255]
    assert seen(-1.1, 2.38) == [255, 255, 255]
    # whoever stands before it hides it; all round it nothing changes
    body = SceneRenderer().render(room.scene_at(0.4), camera)
    pixels, _ = camera.project(np.array([[0.0, 1.1, 0.0]]))
    column, row = np.floor(pixels[0]).astype(int)
    assert np.abs(shared[row, column].astype(int) - body[row, column]).max() < 12
    np.testing.assert_array_equal(shared[-60:], without[-60:])


def test_where_splats_are_many_everybody_is_drawn_coarser(page: Page, demo: SplatModel):
    room = room_of(demo, 3)
    camera = orbit_camera((0.0, 0.9, 0.0), 4.7, 0.2, 0.1, 256, 256)
    server = SceneRenderer().render(room.scene_at(0.0), camera)
    whole, half = (drawn(page, asked(room, camera, 0.0, most=most)) for most in (60_000, 15_000))
    assert psnr(whole, server) > psnr(half, server) + 10.0
    assert psnr(half, server) > 27.0


def test_a_motion_turns_up_in_the_picture(page: Page, demo: SplatModel):
    """The comparison can fail: another moment, or the back, is another picture."""
    room = room_of(demo, 1)
    camera = orbit_camera((0.0, 0.9, 0.0), 3.2, 0.3, 0.1, 256, 256)
    now, later = (drawn(page, asked(room, camera, at_s)) for at_s in (0.4, 1.2))
    assert psnr(now, later) < 35.0


def test_a_level_of_each_person_is_drawn_as_a_file_cut_there(page: Page, demo: SplatModel):
    """Fewer splats at the next picture, without a new file or a new table."""
    room = room_of(demo, 2)
    camera = orbit_camera((-0.6, 0.9, 1.0), 4.7, 1.0, 0.1, 256, 256)
    half = len(demo) // 2
    kept, cut = (
        drawn(page, asked(room, camera, 0.0, **how))
        for how in ({"kept": [half, half]}, {"most": 2 * half})
    )
    assert np.abs(kept.astype(int) - cut).max() <= 2
    one = drawn(page, asked(room, camera, 0.0, kept=[2 * half, 100]))
    assert psnr(one, kept) < 40.0


def test_a_level_is_drawn_as_the_server_draws_it(page: Page, demo: SplatModel):
    camera = orbit_camera((0.0, 0.9, 0.0), 5.0, 0.3, 0.1, 256, 256)
    tree, room = level_tree(demo), room_of(demo, 1)
    for count in (tree.fewest, 4000):
        coarse = Room("m", (replace(room.performers[0], model=tree.level(count)),))
        server = SceneRenderer().render(coarse.scene_at(0.4), camera)
        assert psnr(drawn(page, asked(room, camera, 0.4, kept=[count])), server) > 46.0
    whole = drawn(page, asked(room, camera, 0.4))
    assert psnr(whole, server) < 42.0
