"""A field's ladder: what its rungs change, that each can be trained, and what it tells."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.parsimony import costs
from benchmarks.parsimony.fields import (
    FIELD_AS_IT_IS,
    FIELD_LADDER,
    NOISE_DEG,
    measured_field,
)
from benchmarks.parsimony.subjects import Filmed
from benchmarks.reporting.timing import clock_named
from benchmarks.stability.pose_errors import geodesic_deg
from renderer.field.settings import FAST
from renderer.field.sizes import FieldSizes
from renderer.presets import find_preset
from renderer.training import train
from scene.rotations import axis_angle_to_matrix
from scene.sequence import PoseTrust
from tests.renderer.studio import make_sequence

RUNGS = {rung.name: rung for rung in FIELD_LADDER}


def test_every_rung_changes_one_thing_and_has_a_name_of_its_own():
    assert len(RUNGS) == len(FIELD_LADDER)
    for rung in FIELD_LADDER[1:]:
        changed = rung.settings(FAST) != FAST
        assert changed or rung.poses_off or rung.backbone is not None, rung.name
        sizes = rung.settings(FAST).sizes
        assert FieldSizes.from_json(sizes.to_json()) == sizes, "a model file can hold it"


def test_a_real_clip_has_its_poses_and_a_studio_one_has_none_to_refine():
    real, studio = (
        [rung.name for rung in FIELD_LADDER if rung.fits(real=real)] for real in (True, False)
    )
    assert set(studio) - set(real) == {name for name, rung in RUNGS.items() if rung.poses_off}
    assert set(real) - set(studio) == {"refiner on"}


def test_poses_are_off_by_as_much_as_said_and_pictures_stay():
    clip = make_sequence()
    off = RUNGS["poses off"].clip(clip)
    assert off.pose_trust is PoseTrust.ESTIMATED
    true, given = (
        axis_angle_to_matrix(
            np.stack([one.train.pose(i).joint_angles for i in range(len(one.train))])
        )
        for one in (clip, off)
    )
    # the length of three normal errors
    expected = NOISE_DEG * np.sqrt(8.0 / np.pi)
    assert geodesic_deg(true, given).mean() == pytest.approx(expected, rel=0.1)
    assert (off.train.image(0) == clip.train.image(0)).all()
    assert RUNGS["as it is"].clip(clip) is clip


@pytest.mark.parametrize(
    "name",
    ["no MLP, colour from the grid", "patches of 20 px, LPIPS", "poses off, refiner on"],
)
def test_a_rung_that_takes_another_way_through_training_can_be_trained(name: str):
    preset, rung = find_preset("fast"), RUNGS[name]
    model = train(
        rung.clip(make_sequence()),
        preset=replace(preset, settings=rung.settings(preset.field_settings)),
        iterations=1,
        lpips_backbone=rung.backbone,
        clock=clock_named("processor").now,
    )
    assert np.isfinite(model.metrics["loss"])


def test_a_coarser_grid_is_smaller(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(costs, "VIEW_PX", 64)
    filmed = Filmed(make_sequence(), lambda model: {"body_psnr": float(len(model.motion))})
    fine, coarse = (
        measured_field(rung, 0, 2, filmed, clock_named("processor"))
        for rung in (FIELD_AS_IT_IS, RUNGS["voxels of 32 mm"])
    )
    assert coarse["parameters"] < 0.2 * fine["parameters"]
    assert coarse["megabytes"] < fine["megabytes"]
    assert fine["training_s"] > 0.0
    assert fine["body_psnr"] == len(filmed.clip.motion)
