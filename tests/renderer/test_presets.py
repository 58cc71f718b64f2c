"""Presets by name, what they weigh, and what they switch on."""

from __future__ import annotations

import pytest

from renderer.catalogue import describe_preset, field_parameters
from renderer.errors import UnknownPreset
from renderer.field.settings import FieldSettings
from renderer.presets import EXACT, PRESETS, find_preset


def _sizes(name: str):
    settings = find_preset(name).settings
    assert isinstance(settings, FieldSettings)
    return settings.sizes


def test_every_listed_preset_is_found_by_its_name():
    for name, preset in PRESETS.items():
        assert find_preset(name) == preset


def test_speed_ups_add_up_in_any_order():
    sizes = _sizes("paper+early-stop+cull")
    assert sizes.early_stop
    assert sizes.cull
    assert not sizes.occupancy
    assert find_preset("paper+early-stop+cull").name == "paper+cull+early-stop"


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("paper+magic", r"speed-ups must be among cull, .*; got 'paper\+magic'"),
        ("fast+cull", r"must follow one of humannerf, paper; got 'fast\+cull'; use 'fast'"),
        ("fog+cull", r"preset must be one of splats, .*; got 'fog\+cull'"),
    ],
)
def test_names_that_mean_nothing_are_refused(name, words):
    with pytest.raises(UnknownPreset, match=words):
        find_preset(name)


def test_the_baseline_counts_and_weighs_as_published():
    about = describe_preset(find_preset("humannerf"))
    counts = about["parameters"]
    assert [counts[k] for k in ("canonical", "residual", "refiner")] == [494_084, 101_123, 233_029]
    assert about["megabytes"] == pytest.approx(258, abs=1.0)
    assert "cull" not in about["switches_on"]
    assert "weight-volume CNN" in about["switches_on"]


def test_baking_takes_the_cnn_out_of_the_file():
    assert describe_preset(find_preset("humannerf+baked"))["megabytes"] == pytest.approx(
        6.6, abs=0.1
    )


def test_exact_speed_ups_leave_all_networks_as_they_are():
    together = "+".join(["paper", *EXACT])
    assert field_parameters(_sizes(together)) == field_parameters(_sizes("paper"))
    assert set(EXACT) <= set(describe_preset(find_preset(together))["switches_on"])


def test_a_grid_takes_the_place_of_the_deep_mlp():
    counts = describe_preset(find_preset("paper+grid"))["parameters"]
    assert counts["canonical"] == 4 * 64 + 64 * 64 + 64 * 3
    assert counts["canonical_grid"] > 1_000_000


def test_schedules_are_the_published_ones():
    for name in ("humannerf", "paper"):
        settings = find_preset(name).settings
        assert isinstance(settings, FieldSettings)
        assert settings.iterations == 150_000
        assert settings.residual_from * 150_000 == pytest.approx(10_000)
        assert settings.residual_until * 150_000 == pytest.approx(50_000)
        assert settings.last_rate_share == pytest.approx(0.1**0.3)  # 0.1 over 500K
        assert settings.on_body_share == 0.8
        assert (settings.patch_px, settings.rays_a_frame) == (20, 2400)
