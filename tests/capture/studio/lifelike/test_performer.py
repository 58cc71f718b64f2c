"""Lifelike performers: dressed, covered, see-through where hair is, and true to the pose."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from capture.errors import CaptureError
from capture.storage import open_sequence
from capture.studio import make_sequence
from capture.studio.lifelike.performer import DressedPerformer, make_lifelike_performer
from capture.studio.motions import gesture_motion, turntable_motion
from capture.studio.named_performers import LIFELIKE_PERFORMERS, NAMED_PERFORMERS
from capture.studio.sequence import frame_head
from scene import orbit_camera
from scene.camera import Camera
from tests.shared_data import shared_data

POKING_SHARE = 0.01
"""Of the pixels of a clothed person, how many may show skin that a garment's hem covers in part;
measured 0.0042 at most, beside the hems."""


@pytest.fixture(scope="module")
def assets() -> Path:
    return shared_data("human-assets")


@pytest.fixture(scope="module")
def fern(assets) -> DressedPerformer:
    return make_lifelike_performer(LIFELIKE_PERFORMERS["fern"], assets, expressive=True)


def body_camera(azimuth: float = 0.0) -> Camera:
    return orbit_camera(np.array([0.0, 0.85, 0.0]), 3.6, azimuth, 0.05, 96, 96, 0.6)


def test_names_are_of_one_performer_each():
    assert len(LIFELIKE_PERFORMERS) >= 6
    assert not set(LIFELIKE_PERFORMERS) & set(NAMED_PERFORMERS)
    rows = [*LIFELIKE_PERFORMERS.values(), *NAMED_PERFORMERS.values()]
    assert len({row.seed for row in rows}) == len(rows)


def test_garments_follow_the_body_they_are_tied_to(fern):
    """A garment vertex keeps its distance from the skin next to it, in every pose."""
    surface, skin = fern.surface.body, len(fern.body.rest_vertices)
    shirt = np.flatnonzero(fern.surface.picture == 2)
    chosen = np.unique(surface.faces[shirt])[::40]
    rest = surface.rest_vertices
    between = np.linalg.norm(rest[chosen, None] - rest[None, :skin], axis=-1)
    nearest, before = between.argmin(axis=1), between.min(axis=1)

    for frame in (0, 9, 20):
        posed = fern.posed_vertices(gesture_motion(32, 10.0).pose(frame))
        after = np.linalg.norm(posed[chosen] - posed[nearest], axis=1)
        assert np.abs(after - before).max() < 0.03


def test_skin_does_not_poke_through(fern):
    """Skin that a hem covers, marked: no more of it is seen than the hem's own edge."""
    surface = fern.surface
    shown = np.zeros(len(fern.body.rest_vertices), bool)
    skin = surface.faces[surface.picture == 0]
    drawn_back = np.linalg.norm(
        surface.body.rest_vertices[: len(shown)] - fern.body.rest_vertices, axis=1
    )
    shown[drawn_back > 1e-4] = True
    covered = (surface.picture == 0) & shown[np.minimum(surface.faces, len(shown) - 1)].any(axis=1)
    assert 0 < covered.sum() < len(skin)
    marked = replace(
        fern,
        surface=replace(
            surface,
            picture=np.where(covered, len(surface.textures.places), surface.picture),
            textures=with_mark(surface.textures),
        ),
    )

    for frame in (0, 9, 20):
        pose = gesture_motion(32, 10.0).pose(frame)
        for azimuth in (0.0, 2.0, 4.0):
            plain, alpha = fern.render(pose, body_camera(azimuth), "plain")
            mark, _ = marked.render(pose, body_camera(azimuth), "plain")
            share = (np.abs(plain - mark).max(axis=2) > 0.1).sum() / (alpha > 0.5).sum()
            assert share < POKING_SHARE


def with_mark(textures):
    """`textures` with one more picture, all magenta."""
    place = np.tile([len(textures.texels), 1, 1], (1, textures.places.shape[1], 1))
    texels = np.concatenate([textures.texels, np.array([[255, 0, 255, 255]], np.uint8)])
    return replace(textures, texels=texels, places=np.concatenate([textures.places, place]))


def test_hair_is_see_through_at_its_edges(fern):
    """One sample a pixel: without a see-through texture alpha would be 0 or 1 everywhere."""
    motion = turntable_motion(2, 10.0, 360.0)
    centre, distance = frame_head(fern.body.skeleton, motion)
    camera = orbit_camera(centre, distance, 2.5, 0.05, 96, 96, 0.6)
    hair = fern.surface.picture == fern.surface.picture.max()
    bald = replace(fern, surface=without(fern.surface, hair))

    image, alpha = fern.render(motion.pose(0), camera, "plain", supersampling=1)
    _, bald_alpha = bald.render(motion.pose(0), camera, "plain", supersampling=1)

    assert alpha.min() >= 0.0
    assert alpha.max() <= 1.0 + 1e-6
    assert (image <= alpha[..., None] + 1e-3).all()
    strands = alpha[(bald_alpha == 0.0) & (alpha > 0.0)]
    assert len(strands) > 20
    assert ((strands > 0.05) & (strands < 0.95)).sum() > 5


def without(surface, gone):
    """`surface` without the triangles that are `gone`."""
    kept = ~gone
    return replace(
        surface,
        body=replace(surface.body, faces=surface.faces[kept]),
        texture=surface.texture[kept],
        picture=surface.picture[kept],
        uv_per_m=surface.uv_per_m[kept],
    )


def test_eyes_turn_about_their_centres(fern):
    rest = fern.surface.body.rest_vertices
    turned = fern.eyes.turned(rest, 0.3)

    moved = np.flatnonzero(np.linalg.norm(turned - rest, axis=1) > 1e-9)
    for vertices, centre in zip(fern.eyes.vertices, fern.eyes.centres, strict=True):
        assert np.isin(vertices, moved).mean() > 0.9
        radius = np.linalg.norm(rest[vertices] - centre, axis=1)
        np.testing.assert_allclose(np.linalg.norm(turned[vertices] - centre, axis=1), radius)
        front = vertices[rest[vertices, 2].argmax()]
        assert turned[front, 0] > rest[front, 0]  # to their left
    assert len(moved) <= sum(len(vertices) for vertices in fern.eyes.vertices)


def test_a_sequence_knows_the_naked_body(assets, tmp_path, fern):
    make_sequence(
        tmp_path / "fern",
        performer="fern",
        assets=assets,
        frames=2,
        size=32,
        test_cameras=1,
        expressions=True,
        framing="head",
        look="lit",
    )

    written = open_sequence(tmp_path / "fern")

    assert written.person == "fern"
    assert written.body.rest_vertices is not None
    assert fern.known_body.rest_vertices is not None
    assert len(written.body.rest_vertices) == len(fern.known_body.rest_vertices)
    np.testing.assert_allclose(written.body.rest_vertices, fern.known_body.rest_vertices, atol=1e-4)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"performer": "fern"}, "assets must be the folder with MakeHuman's assets .* got none"),
        ({"performer": "amber", "assets": Path()}, "assets must go with a lifelike performer"),
        ({"assets": Path()}, "assets must go with a lifelike performer"),
        ({"performer": "fern", "assets": Path(), "look": "loose"}, "look must be plain or lit"),
        ({"performer": "fern", "assets": Path("absent")}, "assets must be a folder .* got absent"),
    ],
)
def test_wrong_assets_are_refused(tmp_path, options, message):
    with pytest.raises(CaptureError, match=message):
        make_sequence(tmp_path / "out", **options)


def test_a_missing_file_is_named(tmp_path):
    (tmp_path / "base").mkdir()

    with pytest.raises(CaptureError, match=r"assets must hold female_sportsuit01\.mhclo in"):
        make_lifelike_performer(LIFELIKE_PERFORMERS["fern"], tmp_path)
