"""A meeting in an emulated headset: both eyes, steps, turns, the board, and out again."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from playwright.sync_api import Page, expect

from benchmarks.browser import open_page, running_demo
from tests.e2e.test_control import MINUTE, beside, come

pytestmark = pytest.mark.e2e

_IWER = Path(__file__).parents[2] / "client/node_modules/iwer/build/iwer.min.js"
_EYES_APART_M, _EYES_M = 0.063, 1.6
_PACE_MS = 1000 / 72
_PUT_ON = f"""
window.headset = new IWER.XRDevice(IWER.metaQuest3, {{stereoEnabled: true, visibilityMask: null}});
headset.installRuntime({{forceInstall: true}});
headset.ipd = {_EYES_APART_M};
headset.position.set(0, {_EYES_M}, 0);
// pictures come as fast as the test says, and what is painted is known
window.pace = {_PACE_MS}; window.clock = 0; window.pictures = 0; window.painted = [];
const {{requestAnimationFrame}} = XRSession.prototype;
XRSession.prototype.requestAnimationFrame = function (callback) {{
  return requestAnimationFrame.call(this, (_, frame) => {{
    callback(window.clock += window.pace, frame);
    window.pictures += 1;
  }});
}};
const {{fillText}} = CanvasRenderingContext2D.prototype;
CanvasRenderingContext2D.prototype.fillText = function (text, ...rest) {{
  window.painted.push(text);
  return fillText.call(this, text, ...rest);
}};
// there is no microphone on a machine without one: a tone stands in for it
navigator.mediaDevices.getUserMedia = async () => {{
  const context = new AudioContext(), tone = context.createOscillator();
  const heard = context.createMediaStreamDestination();
  tone.connect(heard);
  tone.start();
  return heard.stream;
}};
"""
_WIDTH, _HEIGHT = 512, 256
"""Of the window: each eye sees half of it, 90 degrees high."""
_FOCAL_PX = _HEIGHT / 2
_BOARD_PX = (1024, 760)
_BOARD_M = (0.62, 0.62 * 760 / 1024)
_DOCK = ("People", "Chat", "Unmute", "Raise hand", "React", "Leave")
_MOVES = ("Turn left", "Stand up", "Turn right")
_REPLIES = ("I can’t hear you", "Thank you")


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    with running_demo(tmp_path_factory.mktemp("demo")) as made:
        yield made


@pytest.fixture
def page(address: str) -> Iterator[Page]:
    """In the meeting, with the headset on and people in sight."""
    with open_page(_WIDTH, _HEIGHT) as made:
        made.add_init_script(_IWER.read_text() + _PUT_ON)
        come(made, address, "Ada")
        button = made.get_by_test_id("enter-vr")
        button.click(timeout=MINUTE)
        expect(button).to_have_attribute("aria-pressed", "true", timeout=MINUTE)
        made.wait_for_function("() => headset.activeSession !== undefined")
        until_people_are_seen(made)
        yield made


def pictures(page: Page, count: int) -> None:
    """Wait for so many more pictures, or for the headset to be taken off."""
    page.wait_for_function(
        "goal => window.pictures >= goal || headset.activeSession === undefined",
        arg=page.evaluate("() => window.pictures") + count,
        timeout=MINUTE,
    )


def eyes(page: Page) -> tuple[np.ndarray, np.ndarray]:
    """What the left and the right eye see, BGR."""
    pictures(page, 2)
    picture = cv2.imdecode(np.frombuffer(page.screenshot(), np.uint8), cv2.IMREAD_COLOR)
    assert picture is not None
    return picture[:, : _WIDTH // 2], picture[:, _WIDTH // 2 :]


def person(eye: np.ndarray) -> np.ndarray:
    """Where the performer's colourful clothes are, [H W]; the room is grey and the sky pale."""
    low, high = eye.min(axis=2).astype(int), eye.max(axis=2).astype(int)
    clothes = high - low > 60
    clothes[int(0.82 * _HEIGHT) :] = False  # the board
    return clothes


def until_people_are_seen(page: Page) -> None:
    for _ in range(60):
        if person(eyes(page)[0]).sum() > 200:
            return
    raise AssertionError("nobody was drawn within 60 looks")


def across(eye: np.ndarray) -> float:
    """Middle of the performer, px from the left."""
    return float(np.median(np.nonzero(person(eye))[1]))


def turn_towards(from_m: np.ndarray, at_m: np.ndarray) -> tuple[float, float, float, float]:
    """The quaternion xyzw that turns -z towards a place."""
    x, y, z = (at_m - from_m) / np.linalg.norm(at_m - from_m)
    yaw, tilt = math.atan2(-x, -z), math.asin(y)
    (sy, cy), (st, ct) = ((math.sin(a / 2), math.cos(a / 2)) for a in (yaw, tilt))
    return (cy * st, sy * ct, -sy * st, cy * ct)


def point(page: Page, at_m: np.ndarray) -> None:
    """Point the right controller at a place of the headset's space."""
    from_m = np.array([0.15, 1.25, -0.15])
    page.evaluate(
        "([p, q]) => { const {position, quaternion} = headset.controllers.right;"
        " position.set(...p); quaternion.set(...q); }",
        [from_m.tolist(), list(turn_towards(from_m, at_m))],
    )
    pictures(page, 2)


def press(page: Page, at_m: np.ndarray) -> None:
    """Point there, pull the trigger, let go."""
    point(page, at_m)
    for value in (1, 0):
        page.evaluate("v => headset.controllers.right.updateButtonValue('trigger', v)", value)
        pictures(page, 2)


def on_board(x_px: float, y_px: float) -> np.ndarray:
    """A place of the board of buttons in the headset's space, m."""
    ahead_m, below_m = 0.75, 0.42
    towards = np.array([0, -below_m, -ahead_m]) / math.hypot(below_m, ahead_m)
    up = np.array([0, 1, 0]) - towards * towards[1]
    up /= np.linalg.norm(up)
    right = np.array([1.0, 0, 0])
    across_m = (x_px / _BOARD_PX[0] - 0.5) * _BOARD_M[0]
    up_m = (0.5 - y_px / _BOARD_PX[1]) * _BOARD_M[1]
    return np.array([0, _EYES_M - below_m, -ahead_m]) + across_m * right + up_m * up


def press_button(page: Page, label: str) -> None:
    rows = {_DOCK: (598, 0, 1024), _MOVES: (702, 0, 1024), _REPLIES: (490, 24, 1000)}
    row, (y, left, right) = next((r, where) for r, where in rows.items() if label in r)
    part = (right - left) / len(row)
    press(page, on_board(left + part * (row.index(label) + 0.5), y))


def painted(page: Page, text: str) -> None:
    """Wait until the text has been painted on a board."""
    page.wait_for_function("text => painted.includes(text)", arg=text, timeout=MINUTE)


def test_both_eyes_see_the_performer_from_a_little_apart(page: Page):
    left, right = eyes(page)
    for eye in (left, right):
        assert 0.002 < person(eye).mean() < 0.2
        assert eye[:20].std() > 1.0  # a sky, and no blank
    distance_m = 2.19
    apart = across(left) - across(right)
    assert apart == pytest.approx(_FOCAL_PX * _EYES_APART_M / distance_m, abs=2.0)
    page.evaluate("() => { headset.ipd = 0.3; }")
    apart = across(eyes(page)[0]) - across(eyes(page)[1])
    assert apart == pytest.approx(_FOCAL_PX * 0.3 / distance_m, abs=6.0)


def test_steps_turns_and_stands_up(page: Page):
    before = eyes(page)[0]
    press(page, np.array([0.0, 0.0, -0.8]))
    nearer = eyes(page)[0]
    assert person(nearer).sum() > 1.5 * person(before).sum()

    page.evaluate("() => headset.controllers.right.updateAxes('thumbstick', 1, 0)")
    pictures(page, 3)
    page.evaluate("() => headset.controllers.right.updateAxes('thumbstick', 0, 0)")
    turned = eyes(page)[0]
    assert across(turned) < across(nearer) - 0.7 * _FOCAL_PX * math.tan(math.pi / 6)
    press_button(page, "Turn left")
    # who stands there moves meanwhile
    assert across(eyes(page)[0]) == pytest.approx(across(nearer), abs=25.0)

    page.evaluate("() => headset.position.set(0, 1.0, 0)")
    low = np.median(np.nonzero(person(eyes(page)[0]))[0])
    page.evaluate("() => headset.position.set(0, 1.6, 0)")
    press_button(page, "Stand up")
    page.evaluate("() => headset.position.set(0, 1.0, 0)")
    raised = np.median(np.nonzero(person(eyes(page)[0]))[0])
    assert raised == pytest.approx(low, abs=40.0)  # lifted by 0.6 m it would be lower by 70 px


def test_the_board_mutes_chats_and_leaves(page: Page):
    assert page.get_by_test_id("microphone").get_attribute("aria-pressed") != "true"
    press_button(page, "Unmute")
    expect(page.get_by_test_id("microphone")).to_have_attribute("aria-pressed", "true")
    painted(page, "Mute")
    press_button(page, "Unmute")
    expect(page.get_by_test_id("microphone")).to_have_attribute("aria-pressed", "false")

    with beside(page) as bo:
        come(bo, page.url.split("?")[0], "Bo")
        bo.get_by_test_id("open-chat").click(timeout=MINUTE)
        press_button(page, "Chat")
        painted(page, "Nobody has written yet.")
        bo.get_by_test_id("chat-text").fill("Hello in there")
        bo.get_by_test_id("chat-send").click()
        painted(page, "Hello in there")
        painted(page, "Bo: Hello in there")
        press_button(page, "Thank you")
        expect(bo.get_by_test_id("messages")).to_contain_text("Thank you")

    press_button(page, "Leave")
    expect(page.get_by_test_id("start-join")).to_be_visible(timeout=MINUTE)
    assert page.evaluate("() => headset.activeSession === undefined")


def test_fewer_splats_where_pictures_come_late(page: Page):
    button = page.get_by_test_id("enter-vr")
    page.evaluate("() => { window.clock += 1000; }")  # a second has passed: numbers are told
    # of 10,000, so many as show where somebody is 94 px high, and all a step before them
    expect(button).to_have_attribute("data-splats", re.compile(r"2[0-4]\d\d"), timeout=MINUTE)
    page.evaluate(f"() => headset.position.set(0, {_EYES_M}, -1.6)")
    expect(button).to_have_attribute("data-splats", "10000", timeout=MINUTE)
    page.evaluate(f"() => {{ window.pace = {3 * _PACE_MS}; }}")
    expect(button).to_have_attribute("data-splats", "5000", timeout=2 * MINUTE)
    assert person(eyes(page)[0]).mean() > 0.002
    page.evaluate("() => headset.activeSession.end()")
    expect(button).to_have_attribute("aria-pressed", "false")
    expect(page.get_by_test_id("live-video")).to_be_visible()
