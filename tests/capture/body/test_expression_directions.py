"""Where expressions move the body model, and how the studio films them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from capture.body.eyes import EYES, eyeballs, middle_of
from capture.body.model import MOUTH, load_body_model
from capture.errors import CaptureError
from capture.storage import open_sequence
from capture.studio import make_sequence
from capture.studio.expressions import with_random_expressions
from capture.studio.motions import turntable_motion
from capture.studio.performer import make_performer, render_performer
from scene import EXPRESSION_NAMES, Body, InvalidInput, Pose, orbit_camera
from scene.expression import FINGERS, GAZE, PARTS, gaze_of, neutral
from scene.sequence import NOVEL_VIEW, read_frame
from scene.skeleton import JOINT_NAMES

HEAD = JOINT_NAMES.index("head")


def showing(name: str, value: float = 1.0) -> Pose:
    """The T-pose with one expression."""
    expression = neutral()
    expression[EXPRESSION_NAMES.index(name)] = value
    return replace(Pose.rest(), expression=expression)


def offsets(name: str) -> np.ndarray:
    directions = load_body_model().expression_directions
    assert directions is not None
    return directions[EXPRESSION_NAMES.index(name)]


@pytest.mark.parametrize(
    ("name", "side", "down"),
    [
        ("jaw_open", 0, True),
        ("blink_left", 1, True),
        ("blink_right", -1, True),
        ("brows_up", 0, False),
        ("smile", 0, False),
        ("left_thumb_curl", 1, True),
        ("left_index_curl", 1, True),
        ("left_little_curl", 1, True),
        ("right_middle_curl", -1, True),
        ("right_ring_curl", -1, True),
    ],
)
def test_each_expression_moves_its_own_part_its_own_way(name, side, down):
    body, moved = load_body_model(), offsets(name)
    moving = np.linalg.norm(moved, axis=1) > 1e-3
    where = body.rest_vertices[moving]
    assert bool(moved[moving, 1].mean() < 0.0) is down
    if side:
        assert (np.sign(where[:, 0]) == side).mean() > 0.8
    else:
        assert abs(where[:, 0].mean()) < 2e-3
    joint = "left_hand" if side > 0 else "right_hand"
    bound = HEAD if "curl" not in name else JOINT_NAMES.index(joint)
    assert body.blend_weights[moving, bound].mean() > 0.7


def test_a_curled_hand_is_a_fist():
    """The fingertips come near the palm: nearer to the knuckles than half a finger's length."""
    body = load_body_model()
    knuckles = body.rest_joints[JOINT_NAMES.index("left_hand")]
    tips = np.argsort(-body.rest_vertices[:, 0])[:20]
    flat = body.rest_vertices[tips, 0] - knuckles[0]
    fist = flat + sum(offsets(f"left_{finger}_curl")[tips, 0] for finger in FINGERS)
    assert fist.max() < 0.5 * flat.min()


@pytest.mark.parametrize("side", ["left", "right"])
def test_fingers_bend_one_by_one(side: str):
    """No finger's end moves with another, and each end is as far forward as its finger is."""
    moved = {f: np.linalg.norm(offsets(f"{side}_{f}_curl"), axis=1) for f in FINGERS}
    ends = {finger: int(far.argmax()) for finger, far in moved.items()}
    assert len(set(ends.values())) == 5
    for finger, far in moved.items():
        assert far[ends[finger]] > 0.05
        assert [far[ends[other]] for other in FINGERS if other != finger] == [0.0] * 4
    vertices = load_body_model().rest_vertices
    across = [vertices[ends[finger], 2] for finger in FINGERS]
    assert across == sorted(across, reverse=True)  # palms down, thumbs forward


def test_a_body_poses_with_its_expression():
    body = load_body_model().body(np.zeros(5))
    jaw = body.posed_vertices(showing("jaw_open", 0.5)) - body.posed_vertices(Pose.rest())
    np.testing.assert_allclose(jaw, 0.5 * offsets("jaw_open"), atol=1e-9)
    joints_alone = replace(body, expression_directions=None)
    unmoved = joints_alone.posed_vertices(showing("jaw_open"))
    np.testing.assert_allclose(unmoved, body.posed_vertices(Pose.rest()), atol=1e-12)


@pytest.mark.usefixtures("unchecked_annotations")
def test_directions_are_of_this_surface():
    body = load_body_model().body(np.zeros(5))
    with pytest.raises(InvalidInput, match=r"expression_directions must be 27 x 13718 x 3; got"):
        Body(
            body.skeleton, body.rest_vertices, body.faces, body.blend_weights, np.zeros((27, 4, 3))
        )


def portrait(pose: Pose, *, expressive: bool = True) -> np.ndarray:
    performer = make_performer(2, expressive=expressive)
    centre = performer.body.skeleton.rest_joints[HEAD] + [0.0, 0.03, 0.0]
    camera = orbit_camera(centre, 0.6, 0.0, 0.0, 96, 96, 0.35)
    return render_performer(performer, pose, camera, "plain")[0]


def dark(picture: np.ndarray) -> int:
    """Pixels of the lower half as dark as the inside of a mouth."""
    low = picture[60:92, 30:66]
    return int(((low.sum(axis=2) < 0.6) & (low[..., 0] > 0.1)).sum())


def test_an_open_mouth_is_dark_inside():
    assert dark(portrait(showing("jaw_open"))) > dark(portrait(Pose.rest())) + 5


def test_lids_close_over_the_eyes():
    def whites(picture: np.ndarray) -> tuple[int, int]:
        bright = (picture.min(axis=2) > 0.85)[:60]
        return int(bright[:, :48].sum()), int(bright[:, 48:].sum())

    right, left = whites(portrait(Pose.rest()))
    assert min(right, left) > 5
    winked = whites(portrait(showing("blink_left")))  # their left is on the right of the picture
    assert winked[0] == right
    assert winked[1] == 0


def test_a_performer_at_rest_ignores_expressions():
    np.testing.assert_array_equal(
        portrait(showing("jaw_open"), expressive=False), portrait(Pose.rest(), expressive=False)
    )


def test_parts_are_where_eyes_and_mouth_are():
    body = load_body_model()
    assert body.parts is not None
    left, right = (
        body.rest_vertices[body.faces[body.parts == eye]].mean(axis=(0, 1)) for eye in EYES
    )
    np.testing.assert_allclose(left, right * [-1.0, 1.0, 1.0], atol=1e-3)
    assert left[0] > 0.02
    assert body.rest_vertices[body.faces[body.parts == MOUTH]][..., 1].mean() < left[1] - 0.03


def test_acting_is_smooth_seeded_and_goes_all_the_way():
    still = turntable_motion(200, 30.0, 0.0)
    whole = with_random_expressions(still, 7).expressions
    np.testing.assert_array_equal(whole, with_random_expressions(still, 7).expressions)
    shown = np.delete(whole, GAZE, axis=1)
    assert np.abs(whole - with_random_expressions(still, 6).expressions).max() > 0.5
    assert shown.min() >= 0.0
    assert (shown.max(axis=0) > 0.6).all()
    assert (shown.min(axis=0) < 0.2).all()
    assert np.abs(np.diff(shown, axis=0)).max() < 0.4
    alone = np.abs(shown[:, 1] - shown[:, 2])  # each eye winks by itself as well
    assert alone.max() > 0.5


def test_eyes_of_who_acts_rest_on_a_place_and_then_leap_to_another():
    still = turntable_motion(200, 30.0, 0.0)
    gaze = gaze_of(with_random_expressions(still, 7).expressions)
    leaps = np.flatnonzero(np.diff(gaze)) + 1
    assert leaps.tolist() == [21 * n for n in range(1, 10)]
    assert np.abs(gaze).max() <= 0.35
    assert np.ptp(gaze) > 0.3


@pytest.mark.parametrize(("name", "sign"), [("look_left", 1.0), ("look_right", -1.0)])
def test_eyes_turn_about_their_middles_and_nothing_else_moves(name: str, sign: float):
    model = load_body_model()
    assert model.parts is not None
    moved = offsets(name)
    balls = np.concatenate(eyeballs(model.faces, model.parts))
    assert not np.delete(moved, balls, axis=0).any()
    for ball in eyeballs(model.faces, model.parts):
        rest = model.rest_vertices[ball]
        pupil = ball[rest[:, 2].argmax()]
        assert sign * moved[pupil, 0] > 0.003
        reached = np.linalg.norm(rest + moved[ball] - middle_of(rest), axis=1)
        np.testing.assert_allclose(reached, np.linalg.norm(rest - middle_of(rest), axis=1))


@pytest.mark.parametrize("hand", ["left_hand", "right_hand"])
def test_fingers_close_together_and_apart(hand: str):
    still = turntable_motion(3000, 30.0, 0.0)
    curls = with_random_expressions(still, 7).expressions[:, PARTS[hand]]
    apart, fist, pointing = np.ptp(curls, axis=1), curls.min(axis=1), curls[:, [0, 2, 3, 4]]
    assert (apart > 0.8).mean() > 0.3
    assert (fist > 0.9).any()
    assert ((curls[:, 1] < 0.1) & (pointing.min(axis=1) > 0.9)).any()


@pytest.fixture(scope="module")
def filmed(tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("studio") / "seq"
    make_sequence(out, frames=6, size=64, test_cameras=2, seed=2, expressions=True, framing="head")
    return out


def test_a_sequence_tells_what_was_shown(filmed):
    sequence = open_sequence(filmed)
    directions = sequence.body.expression_directions
    assert directions is not None
    np.testing.assert_allclose(directions[0], offsets("jaw_open"), atol=1e-4)
    assert sequence.motion.expressions.max() > 0.3
    for frames in (sequence.train, sequence.test[NOVEL_VIEW]):
        pose = frames.pose(1)
        performer = make_performer(2, expressive=True)
        made, _ = render_performer(performer, pose, frames.camera(1), "plain")
        np.testing.assert_allclose(read_frame(frames, 1).image, made, atol=3e-3)


def test_head_and_shoulders_fill_the_picture(filmed):
    mask = open_sequence(filmed).train.mask(0)
    assert mask[-1].max() == 1.0  # cut at the chest
    assert 0.1 < np.flatnonzero(mask.any(axis=1))[0] / len(mask) < 0.3


def test_a_framing_that_is_none_is_named(tmp_path):
    with pytest.raises(CaptureError, match="framing must be one of body, head; got 'feet'"):
        make_sequence(tmp_path / "seq", framing="feet")
