"""Sides of a person are counted from how they face, in one way for REST and the command line."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from renderer.splats.model import SplatModel
from scene import Motion, Pose
from scene.camera import Camera
from scene.errors import InvalidInput
from scene.rotations import axis_angle_to_matrix
from services.api.view_shapes import NewView, Orbit, ViewCamera, ViewPose
from services.person_view import person_camera
from services.video import camera_path, over_backdrop
from services.views import render_view, view_camera
from tests.renderer.studio import make_model

MODEL = make_model(2000)


def facing(yaw_rad: float, frames: int = 3) -> Motion:
    """Standing at (1, 0, -2) m, turned by `yaw_rad` from +z."""
    angles = np.zeros((24, 3))
    angles[0, 1] = yaw_rad
    place = np.array([1.0, 0.0, -2.0])
    return Motion.from_poses([Pose(angles, place, frame / 10.0) for frame in range(frames)])


def camera(motion: Motion, azimuth_deg: float, distance_m: float | None = 3.0) -> Camera:
    return person_camera(
        MODEL.skeleton,
        motion,
        motion.pose(0),
        azimuth_deg=azimuth_deg,
        elevation_deg=0.0,
        distance_m=distance_m,
        width=64,
        height=64,
        fov_y_rad=0.6,
    )


@pytest.mark.parametrize("yaw_rad", [0.0, 0.5 * np.pi, -2.5])
@pytest.mark.parametrize(
    ("azimuth_deg", "side"), [(0, (0, 0, 1)), (90, (1, 0, 0)), (180, (0, 0, -1)), (-90, (-1, 0, 0))]
)
def test_sides_go_with_the_person(yaw_rad: float, azimuth_deg: float, side: tuple):
    motion = facing(yaw_rad)
    joints = MODEL.skeleton.joint_transforms(*_of(motion.pose(0)))[:, :3, 3]
    towards = camera(motion, azimuth_deg).position - joints.mean(axis=0)
    turned = axis_angle_to_matrix(np.array([0.0, yaw_rad, 0.0])) @ side
    np.testing.assert_allclose(towards[[0, 2]] / 3.0, turned[[0, 2]], atol=1e-9)


def test_rest_and_command_line_show_the_same_side():
    motion, asked = facing(2.0), ViewCamera(orbit=Orbit(azimuth_deg=40.0), fov_deg=np.rad2deg(0.6))
    by_rest = view_camera(MODEL.skeleton, motion, motion.pose(0), asked, 64, 64)
    picture = next(camera_path(MODEL, motion, "40,5", 64, None, 0.0, 1.0))
    shown = MODEL.render(by_rest, motion.pose(0))
    np.testing.assert_allclose(over_backdrop(shown), picture, atol=1.0)


@pytest.mark.parametrize("wrong", ["above", "40", "0,90", "0,nan", "inf,0"])
def test_a_camera_that_is_nowhere_is_refused(wrong: str):
    with pytest.raises(InvalidInput, match=f"between -90 and 90; got '{wrong}'"):
        next(camera_path(MODEL, facing(0.0), wrong, 64, None, 0.0, 1.0))


def test_azimuth_0_shows_the_front_of_whoever_moves_the_model():
    looks = [
        _rest(MODEL, motion, NewView(background=(1.0, 1.0, 1.0), width=64, height=64))
        for motion in (facing(0.0), facing(2.5))
    ]
    np.testing.assert_allclose(looks[0], looks[1], atol=12)
    pose = ViewPose(joint_angles=facing(-1.0).joint_angles[0].tolist())
    alone = NewView(background=(1.0, 1.0, 1.0), width=64, height=64, pose=pose)
    np.testing.assert_allclose(_rest(MODEL, facing(2.5), alone), looks[0], atol=12)
    # the body's back alone is blue
    assert not _is_blue(looks[0])
    back = alone.model_copy(update={"camera": ViewCamera(orbit=Orbit(azimuth_deg=180.0))})
    assert _is_blue(_rest(MODEL, facing(2.5), back))


def test_depth_and_normals_agree_with_where_the_camera_stands():
    away = NewView(width=64, height=64, camera=ViewCamera(orbit=Orbit(distance_m=2.0)))
    pose = facing(0.0).pose(0)
    camera = view_camera(MODEL.skeleton, facing(0.0), pose, away.camera, 64, 64)

    def told(shows: str) -> np.ndarray:
        asked = away.model_copy(update={"shows": shows})
        data = np.frombuffer(render_view(MODEL, facing(0.0), asked), np.uint8)
        return np.asarray(cv2.imdecode(data, cv2.IMREAD_UNCHANGED))

    depth, normal, alpha = told("depth"), told("normal"), MODEL.render(camera, pose)[..., 3]
    assert depth.dtype == np.uint16
    solid = alpha > 0.55
    assert (depth[alpha < 0.45] == 0).all()
    assert (normal[alpha < 0.45] == 0).all()
    reach = np.ptp(MODEL.parameters[:, :3], axis=0).max()
    assert np.abs(depth[solid] / 1000.0 - 2.0).max() < reach
    # what is seen faces the camera, nearly everywhere
    facing_it = 2.0 * normal[solid][:, 2::-1] / 255.0 - 1.0
    assert np.linalg.norm(facing_it, axis=1) == pytest.approx(1.0, abs=0.02)
    towards = -camera.world_to_camera[2, :3]
    assert ((facing_it @ towards) > 0.0).mean() > 0.95


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"format": "jpeg"}, "as png without a background.*got jpeg"),
        ({"background": (0.0, 0.0, 0.0)}, "as png without a background.*with a background"),
    ],
)
def test_depth_is_told_in_full_or_not_at_all(wrong: dict, words: str):
    with pytest.raises(InvalidInput, match=words):
        render_view(MODEL, facing(0.0), NewView(shows="depth", width=64, height=64, **wrong))


def _of(pose: Pose) -> tuple[np.ndarray, np.ndarray]:
    return pose.joint_angles, pose.root_translation


def _rest(model: SplatModel, motion: Motion, asked: NewView) -> np.ndarray:
    encoded = np.frombuffer(render_view(model, motion, asked), np.uint8)
    picture = cv2.imdecode(encoded, cv2.IMREAD_COLOR)
    assert picture is not None
    return picture[..., ::-1].astype(float)


def _is_blue(picture: np.ndarray) -> bool:
    middle = picture[30:34, 30:34].mean(axis=(0, 1))
    return bool(middle[2] > 120.0)
