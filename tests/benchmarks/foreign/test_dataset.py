"""What the foreign test set says of itself is what our reader understands."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from benchmarks.foreign import dataset
from benchmarks.foreign.dataset import placed, ring_lens, write_dataset
from benchmarks.foreign.figure import Figure, joint_frames, make_figure, posed
from benchmarks.foreign.measure import opened, with_true_surface
from benchmarks.foreign.moves import dancing, rotation, turning
from benchmarks.foreign.picture import coded, irradiance, lens_on_ring
from scene.rotations import axis_angle_to_matrix
from scene.sequence import NOVEL_VIEW, UNSEEN_POSE, Sequence

SIZE, FRAMES = 96, 8
NOVEL, UNSEEN = 8, 4
"""Each of the ring's cameras is seen through once at least."""


@pytest.fixture(scope="module", autouse=True)
def few_views() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(dataset, "NOVEL_VIEWS", NOVEL)
        patch.setattr(dataset, "UNSEEN_POSES", UNSEEN)
        yield


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("foreign")
    write_dataset(path, SIZE, FRAMES)
    return path


@pytest.fixture(scope="module")
def clip(folder: Path) -> Sequence:
    return opened(folder)


@pytest.fixture(scope="module")
def figure() -> Figure:
    return make_figure()


def shots(split: str, clip: Sequence):
    """Each frame's source, number, move and lens."""
    if split == "train":
        front = lens_on_ring(0.0, 1.0, 3.3, SIZE)
        return [(clip.train, i, move, front) for i, move in enumerate(turning(FRAMES))]
    moves = turning(NOVEL) if split == NOVEL_VIEW else dancing(UNSEEN)
    return [(clip.test[split], i, move, ring_lens(i, SIZE)) for i, move in enumerate(moves)]


@pytest.mark.parametrize("split", ["train", NOVEL_VIEW, UNSEEN_POSE])
def test_joints_are_seen_where_the_writers_own_camera_sees_them(
    split: str, clip: Sequence, figure: Figure
):
    skeleton = clip.body.skeleton
    for source, number, move, lens in shots(split, clip):
        joints = joint_frames(figure.joints, *placed(figure, move))[1]
        pose = source.pose(number)
        ours = skeleton.joint_transforms(pose.joint_angles, pose.root_translation)[:, :3, 3]
        pixels, depth_m = source.camera(number).project(ours)
        expected, expected_m = lens.see(joints)
        assert np.abs(pixels - 0.5 - expected).max() < 1e-3
        assert np.abs(depth_m - expected_m).max() < 1e-5


def test_the_surface_is_where_the_picture_shows_it(clip: Sequence):
    """Our skinning and our camera put the true mesh onto the mask, within a pixel."""
    true = with_true_surface(clip)
    for source in (true.train, *true.test.values()):
        for number in (0, 2, 3):
            pixels, _ = source.camera(number).project(true.body.posed_vertices(source.pose(number)))
            mask = source.mask(number) > 0.0
            columns, rows = np.floor(pixels).astype(int).T
            # a rim thinner than a sample's spacing is in no mask
            beside = [mask[rows + r, columns + c] for r in (-1, 0, 1) for c in (-1, 0, 1)]
            assert np.all(np.any(beside, axis=0))
            assert mask[rows, columns].mean() > 0.98
            shown = np.zeros_like(mask)
            shown[rows, columns] = True
            assert (shown & mask).sum() > 0.9 * mask.sum()


def test_colours_are_the_persons_alone(clip: Sequence):
    """No pixel of the edge has the wall in it: premultiplied, it is as dark as the mask is thin."""
    image, mask = clip.train.image(0), clip.train.mask(0)
    assert 0.02 < (mask > 0.0).mean() < 0.3
    edge = (mask > 0.0) & (mask < 0.3)
    assert edge.sum() > 20
    assert np.all(image[edge].max(axis=1) <= mask[edge] + 1e-6)
    assert not image[mask == 0.0].any()


def test_light_stays_in_the_room_while_the_person_turns():
    """A side's colour changes with the turn, as DESIGN's test case does: by about 28 %."""
    around = np.linspace(0.0, 2.0 * np.pi, 90)
    sides = np.stack([np.cos(around), np.sin(around), np.zeros(90)], axis=1)
    seen = coded(0.5 * irradiance(sides)).astype(float)
    assert 1.0 - seen.min() / seen.max() == pytest.approx(0.28, abs=0.02)


def test_the_person_turns_once_round(clip: Sequence):
    facing = axis_angle_to_matrix(clip.motion.joint_angles[:, 0])[:, :, 2]
    azimuth = np.unwrap(np.arctan2(facing[:, 0], facing[:, 2]))
    assert abs(azimuth[-1] - azimuth[0]) == pytest.approx(
        2.0 * np.pi * (FRAMES - 1) / FRAMES, abs=1e-6
    )


def test_the_figure_is_closed_and_its_weights_sum_to_one(figure: Figure):
    assert np.allclose(figure.weights.sum(axis=1), 1.0)
    sides = np.concatenate([figure.faces[:, [i, (i + 1) % 3]] for i in range(3)])
    counts = np.unique(np.sort(sides, axis=1), axis=0, return_counts=True)[1]
    assert np.all(counts % 2 == 0)
    a, b, c = (figure.vertices[figure.faces[:, i]] for i in range(3))
    litres = 1e3 * np.einsum("ti,ti->t", np.cross(a, b), c).sum() / 6.0
    assert 55.0 < litres < 95.0


def test_rest_pose_moves_nothing(figure: Figure):
    still = np.broadcast_to(np.eye(3), (24, 3, 3))
    vertices, normals = posed(figure, still, figure.joints[0])
    assert np.allclose(vertices, figure.vertices, atol=1e-12)
    assert np.allclose(normals, figure.normals, atol=1e-12)


def test_the_set_is_the_same_every_time(folder: Path, tmp_path: Path):
    write_dataset(tmp_path, SIZE, FRAMES)
    files = sorted(path.relative_to(folder) for path in folder.rglob("*") if path.is_file())
    assert len(files) == 2 * (FRAMES + NOVEL + UNSEEN) + 9
    assert all((folder / f).read_bytes() == (tmp_path / f).read_bytes() for f in files)


def test_rotations_are_those_of_their_axis_and_angle():
    turned = rotation(np.array([0.0, 0.0, 0.5 * np.pi])) @ [1.0, 0.0, 0.0]
    assert np.allclose(turned, [0.0, 1.0, 0.0])
