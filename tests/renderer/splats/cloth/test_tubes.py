"""Cloth as cut on a body: outside it, on its limbs, in few numbers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from capture.studio.performer import make_performer
from renderer.splats.cloth.tubes import SKIRT, SLEEVES, Cut, cut_tubes, limb_radius
from scene.skeleton import JOINT_NAMES

BODY = make_performer(1).body


@pytest.mark.parametrize("garments", [(SKIRT,), (SLEEVES,), (SKIRT, SLEEVES)])
def test_only_what_is_worn_is_cut(garments):
    tubes = cut_tubes(BODY, Cut(), garments)
    carriers = {JOINT_NAMES[joint] for joint in tubes.tubes[:, 0]}
    assert ("pelvis" in carriers) == (SKIRT in garments)
    assert ({"left_elbow", "right_elbow"} <= carriers) == (SLEEVES in garments)
    assert len(tubes.rest) == (tubes.tubes[:, 2] * tubes.tubes[:, 3]).sum() == len(tubes.carriers)
    assert tubes.quads.max() == len(tubes.rest) - 1
    assert set(tubes.owners) == set(range(len(tubes.tubes)))


def test_a_skirt_lies_outside_the_hips_and_widens_by_its_flare():
    cut = Cut()
    narrow, wide = (
        cut_tubes(BODY, replace(cut, skirt_flare=flare), (SKIRT,)).rest.reshape(12, 32, 3)
        for flare in (0.1, 0.3)
    )
    assert BODY.rest_vertices is not None
    for ring in narrow:
        near = np.abs(BODY.rest_vertices[:, 1] - ring[0, 1]) < 0.02
        reach = np.hypot(ring[:, 0], ring[:, 2])
        outward = ring[:, [0, 2]] / reach[:, None]
        assert (reach > (BODY.rest_vertices[near][:, [0, 2]] @ outward.T).max(axis=0)).all()
    radii = [np.hypot(rings[-1, :, 0], rings[-1, :, 2]) for rings in (narrow, wide)]
    np.testing.assert_allclose(radii[1] - radii[0], 0.2 * cut.skirt_length_m, atol=1e-9)


def test_lengths_are_those_of_links_to_the_ring_above():
    tubes = cut_tubes(BODY, Cut(), (SLEEVES,))
    _, first, rings, sides = tubes.tubes[1]
    vertex = first + 3 * sides + 5
    link = tubes.rest[vertex] - tubes.rest[vertex - sides]
    assert tubes.lengths[vertex] == pytest.approx(float(np.linalg.norm(link)))
    np.testing.assert_array_equal(tubes.lengths[first : first + sides], 0.0)
    assert rings * sides == len(tubes.rest) // 2


def test_a_limb_is_as_wide_as_its_skin():
    elbow, wrist = JOINT_NAMES.index("left_elbow"), JOINT_NAMES.index("left_wrist")
    assert 0.03 < limb_radius(BODY, elbow, wrist) < 0.09


def test_numbers_of_a_cut_come_back():
    cut = Cut(skirt_length_m=0.61, smoothing=0.2)
    assert Cut.of(cut.array()) == cut
