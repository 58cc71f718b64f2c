"""The flow term: motion found between pictures of known people, and what the fit makes of it."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
import torch

from capture.body.model import load_body_model
from capture.detection.landmarks import Landmarks
from capture.fitting.fit import fit_clip
from capture.fitting.terms.flow import (
    FlowTargets,
    PersonImages,
    certainty,
    find_flow,
    flow_energy,
    flow_targets,
    strides_of,
    visible_vertices,
)
from capture.studio.performer import make_performer, render_performer
from scene.arrays import Array
from scene.motion import Motion
from scene.rotations import axis_angle_to_matrix
from tests.capture.people import JOINT, body, camera, seen_by, standing

SHIFT = np.array([6.0, -4.0], dtype=np.float32)
"""Px a frame that the patch of `moving_patch` goes."""


def moving_patch(frames: int) -> tuple[list[Array], list[Array], Array]:
    """A patch of noise that moves over a wall of other noise; its masks, and its middle [F 1 2]."""
    rng = np.random.default_rng(0)
    wall, paint = (
        cv2.GaussianBlur(rng.uniform(0, 255, (160, 200, 3)).astype(np.float32), (0, 0), 2.0)
        for _ in range(2)
    )
    wall, paint = (128.0 + 6.0 * (p - p.mean()) for p in (wall, paint))
    images, masks, middles = [], [], []
    for frame in range(frames):
        x, y = (np.array([40.0, 70.0]) + frame * SHIFT).astype(int)
        image, mask = wall.copy(), np.zeros(wall.shape[:2], np.float32)
        image[y : y + 60, x : x + 80] = paint[:60, :80]
        mask[y : y + 60, x : x + 80] = 1.0
        images.append(np.clip(image, 0, 255).astype(np.uint8))
        masks.append(mask)
        middles.append([[x + 40.0, y + 30.0]])
    return images, masks, np.array(middles, dtype=np.float32)


@pytest.mark.parametrize("begun", [True, False])
def test_what_moves_is_found_and_what_stands_still_is_unknown(begun):
    """Without a beginning a long way may stay unknown; it is never wrong."""
    images, masks, middles = moving_patch(5)
    pictures = PersonImages(images, masks)
    seen = np.full((5, 1), begun)
    flow = find_flow(pictures, np.zeros(5, int), (1, 3), middles, seen)
    for stride in (1, 3):
        here = torch.from_numpy(middles[:-stride])
        found = flow.at(stride, here).numpy()[:, 0]
        known = np.isfinite(found[:, 0])
        assert known.all() or not (begun or stride == 1)
        assert (np.abs(found[known] - stride * SHIFT) < 0.4).all()
        for outside in ([-70.0, 0.0], [1e4, -1e4]):
            assert torch.isnan(flow.at(stride, here + torch.tensor(outside))).all()


@pytest.mark.parametrize(
    ("rate", "strides"), [(8.0, (1, 3)), (15.0, (1, 3)), (30.0, (2, 6)), (60.0, (4, 12))]
)
def test_pictures_of_a_pair_are_as_far_apart_at_any_rate(rate, strides):
    assert strides_of(1.0 / rate) == strides


def test_nothing_is_known_across_a_cut_nor_of_lost_frames():
    images, masks, middles = moving_patch(4)
    takes = np.array([0, 0, 1, 1])
    flow = find_flow(PersonImages(images, masks), takes, (1,), middles, np.ones((4, 1), bool))
    found = flow.at(1, torch.from_numpy(middles[:-1]))[:, 0, 0].numpy()
    assert np.isfinite(found).tolist() == [True, False, True]
    lost = find_flow(
        PersonImages(images, [masks[0], None, masks[2], masks[3]]),
        np.zeros(4, int),
        (1,),
        middles,
        np.ones((4, 1), bool),
    )
    found = lost.at(1, torch.from_numpy(middles[:-1]))[:, 0, 0].numpy()
    assert np.isfinite(found).tolist() == [False, False, True]


def test_large_pictures_are_looked_at_smaller_and_answer_in_their_own_pixels():
    images, masks, middles = moving_patch(2)
    large = [cv2.resize(image, None, fx=8, fy=8) for image in images]
    flow = find_flow(
        PersonImages(large, [cv2.resize(mask, None, fx=8, fy=8) for mask in masks]),
        np.zeros(2, int),
        (1, 3),
        8.0 * middles,
        np.ones((2, 1), bool),
    )
    assert max(flow.displacements[1].shape[1:3]) == 448
    found = flow.at(1, torch.from_numpy(8.0 * middles[:-1])).numpy()[0, 0]
    np.testing.assert_allclose(found, 8.0 * SHIFT, atol=3.0)


def test_vertices_are_seen_that_face_the_camera_with_nothing_before_them():
    skin = torch.tensor([[[0.0, 0.0, -2.0], [0.0, 0.0, -2.0], [0.0, 0.0, -2.5], [1.0, 0.0, -2.5]]])
    pixels = 100.0 + 500.0 * skin[..., :2] / -skin[..., 2:]
    towards, away = [0.0, 0.0, 1.0], [0.0, 0.0, -1.0]
    normals = torch.tensor([[towards, away, towards, towards]])
    assert visible_vertices(skin, pixels, normals, torch.tensor([6.0])).tolist() == [
        [True, False, False, True]
    ]


def test_the_energy_pulls_towards_the_flow_and_lets_go_of_what_is_far_off():
    pixels = torch.zeros(3, 40, 2, requires_grad=True)
    displacements = torch.tensor([2.0, 0.0]).expand(2, 40, 2).clone()
    sure = torch.tensor([1.0, 0.0, 1.0]).expand(2, 40, 3)
    targets = FlowTargets({1: displacements}, {1: torch.ones(2, 40)}, {1: sure})
    flow_energy(targets, pixels, torch.ones(3)).backward()
    assert pixels.grad is not None
    assert (pixels.grad[0, :, 0] > 0.0).all()
    assert (pixels.grad[2, :, 0] < 0.0).all()
    met = torch.arange(3.0)[:, None, None] * torch.tensor([2.0, 0.0]).expand(1, 40, 2)
    assert float(flow_energy(targets, met, torch.ones(3))) == 0.0
    far = FlowTargets({1: 100.0 * displacements}, targets.valid, targets.certainty)
    loose = pixels.detach().clone().requires_grad_()
    flow_energy(far, loose, torch.ones(3)).backward()
    assert loose.grad is not None
    assert loose.grad.abs().max() < 1e-4
    unseen = FlowTargets(targets.displacements, {1: torch.zeros(2, 40)}, targets.certainty)
    assert float(flow_energy(unseen, pixels.detach(), torch.ones(3))) == 0.0


def test_gradients_of_the_energy_are_those_of_finite_differences():
    generator = torch.Generator().manual_seed(0)

    def noise(*shape: int) -> torch.Tensor:
        return torch.randn(*shape, generator=generator)

    pixels = (3.0 * noise(5, 6, 2)).double().requires_grad_()
    mixed = noise(5, 6, 2, 2)
    certain = (mixed @ mixed.mT)[..., [0, 0, 1], [0, 1, 1]]
    targets = FlowTargets({}, {}, {})
    for stride in (1, 3):
        targets.displacements[stride] = noise(5 - stride, 6, 2)
        targets.valid[stride] = (noise(5 - stride, 6) > -0.5).float()
        targets.certainty[stride] = certain[:-stride]
    assert torch.autograd.gradcheck(
        lambda pixels: flow_energy(targets, pixels, torch.linspace(1.0, 2.0, 5)), pixels
    )


def test_only_what_texture_shows_of_a_motion_counts():
    """Along an edge anything may move; in a plain place everything."""
    rng = np.random.default_rng(0)
    edge = np.zeros((60, 60), np.uint8)
    edge[:, 30:] = 80
    spots = 128.0 + 6.0 * cv2.GaussianBlur(rng.normal(0.0, 30.0, (60, 60)), (0, 0), 2.0)
    plain = 128.0 + rng.normal(0.0, 1.0, (60, 60))  # noise of the sensor
    told = {
        name: certainty(np.clip(picture, 0, 255).astype(np.uint8))[30, 30]
        for name, picture in {"edge": edge, "spots": spots, "plain": plain}.items()
    }
    np.testing.assert_allclose(told["edge"], [1.0, 0.0, 0.0], atol=0.05)
    assert min(told["spots"][[0, 2]]) > 0.8
    assert np.abs(told["plain"]).max() < 0.1
    sure = {name: torch.from_numpy(value.astype(np.float32)) for name, value in told.items()}
    displacements = {1: torch.tensor([2.0, 2.0]).expand(1, 40, 2)}
    energies = {
        name: float(
            flow_energy(
                FlowTargets(displacements, {1: torch.ones(1, 40)}, {1: value.expand(1, 40, 3)}),
                torch.zeros(2, 40, 2),
                torch.ones(2),
            )
        )
        for name, value in sure.items()
    }
    assert energies["plain"] < 0.2 * energies["edge"] < 0.2 * energies["spots"]


def test_flow_is_looked_up_where_both_frames_show_the_vertex():
    images, masks, middles = moving_patch(3)
    flow = find_flow(
        PersonImages(images, masks), np.zeros(3, int), (1, 3), middles, np.ones((3, 1), bool)
    )
    pixels = torch.from_numpy(np.repeat(middles, 2, axis=1))
    seen = torch.tensor([[True, True], [True, False], [True, True]])
    targets = flow_targets(flow, pixels, seen)
    assert list(targets.valid) == [1]
    assert targets.valid[1].tolist() == [[1.0, 0.0], [1.0, 0.0]]
    assert torch.isfinite(targets.displacements[1]).all()
    assert (targets.certainty[1][..., 0] > 0.5).tolist() == [[True, False], [True, False]]


def _filmed(motion: Motion) -> tuple[list[Array], list[Landmarks]]:
    """Pictures of a performer of the mean body, and landmarks each frame's own 5 px off."""
    rng = np.random.default_rng(1)
    performer, view = replace(make_performer(3), body=body()), camera(384)
    images, people = [], []
    for index in range(len(motion)):
        pose = motion.pose(index)
        image, alpha = render_performer(performer, pose, view, "plain", supersampling=2)
        images.append((255.0 * (image + 0.5 * (1.0 - alpha[..., None])) + 0.5).astype(np.uint8))
        person = seen_by(view, body(), pose)
        noisy = person.pixels + rng.normal(0.0, 5.0, person.pixels.shape)
        world = person.world + rng.normal(0.0, 0.03, person.world.shape)
        people.append(replace(person, pixels=noisy, world=world, mask=alpha))
    return images, people


def test_pictures_draw_a_clip_together_that_landmarks_tear_apart():
    """An upper arm that turns about itself shows in its sleeve's stripes, in no landmark."""
    frames = 12
    motion = standing(frames, turn_rad=0.6)
    angles = motion.joint_angles.copy()
    angles[:, JOINT["left_elbow"]] *= 0.2  # an arm nearly straight: no hinge shows the turn
    images, people = _filmed(replace(motion, joint_angles=angles))
    errors = []
    for shown in (None, images):
        fit = fit_clip(
            people,
            [p.mask for p in people],
            motion.times_s,
            [0] * frames,
            load_body_model(),
            focal_px=camera(384).focal_px,
            images=shown,
        )
        ours, truth = (axis_angle_to_matrix(a[:, 1:]) for a in (fit.joint_angles, angles))
        # how the pose changes from frame to frame: a turn held all along cancels out
        steps = [np.swapaxes(r[:-1], -1, -2) @ r[1:] for r in (ours, truth)]
        cosine = 0.5 * (np.einsum("fjab,fjab->fj", *steps) - 1.0)
        errors.append(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))).mean())
    assert errors[1] < 0.75 * errors[0], errors
