"""As few splats as a clip shows a need for."""

from __future__ import annotations

import json
from itertools import count

import numpy as np
import pytest

from renderer.errors import TrainingStopped
from renderer.model_files import load_model, save_model
from renderer.splats.model import SplatModel
from renderer.splats.settings import Size, SplatSettings
from renderer.splats.training.sized_trainer import SizedTrainer
from renderer.splats.training.trainer import SplatTrainer
from renderer.training import train
from tests.renderer.clocks import ticking
from tests.renderer.studio import make_sequence

FRAMES = 24
SETTINGS = SplatSettings(count=6000, most=6000)


def sized(size: Size = "auto") -> SizedTrainer:
    return SizedTrainer(SplatTrainer(make_sequence(frames=FRAMES), SETTINGS, 0), size)


def trained_for(trainer: SizedTrainer, steps: int, total: int, begun: int = 0) -> None:
    for step in range(begun, steps):
        trainer.before_step(step / total)
        trainer.step(step / total)


def finished(trainer: SizedTrainer, begun: int = 0) -> SplatModel:
    trained_for(trainer, 100, 100, begun)
    return trainer.finish({})


def test_a_box_in_three_colours_needs_few_splats_and_says_so():
    model = finished(sized())
    report = model.metrics["size"]
    assert report["of"] == 6000
    assert report["kept"] < 4500
    assert report["kept"] <= len(model) < 6000
    assert report["frames"] == 16
    assert report["steps"] == 50 * (len(report["tried"]) + 1)
    kept = [one for one in report["tried"] if one["good"]]
    assert kept[-1]["splats"] == report["kept"]
    assert kept[-1]["lost_db"]["body"] <= 0.5
    json.dumps(report)


def test_a_training_tells_of_each_number_that_it_tries():
    told = []
    model = train(
        make_sequence(frames=FRAMES),
        iterations=100,
        size="auto",
        on_progress=told.append,
        clock=ticking(),
    )
    assert isinstance(model, SplatModel)
    report = model.metrics["size"]
    tried = [report["of"], *(one["splats"] for one in report["tried"])]
    choosing = [one for one in told if one.choosing]
    assert [one.message for one in choosing] == [
        f"finding how few splats do ({number:,} of {report['of']:,} tried)" for number in tried
    ]
    assert all(0.69 < one.fraction < 0.75 and one.preview is not None for one in choosing)


def test_a_number_is_not_exceeded_and_nothing_is_tried():
    model = finished(sized(3000))
    assert len(model) == 3000
    assert model.metrics["size"] == {"asked": 3000, "of": 6000, "kept": 3000}


def test_a_number_larger_than_the_clip_shows_keeps_all():
    assert len(finished(sized(9000))) == 6000


def test_sides_that_no_frame_shows_get_theirs_after_the_choice():
    one_sided = make_sequence(frames=FRAMES).part([0, 1, 23])
    trainer = SizedTrainer(SplatTrainer(one_sided, SETTINGS, 0), "auto")
    # so few steps that all comes at once
    trained_for(trainer, 5, 5)
    state = trainer.state()
    model = trainer.finish({})
    assert len(model) > model.metrics["size"]["kept"]
    another = SizedTrainer(SplatTrainer(one_sided, SETTINGS, 0), "auto")
    another.restore(state)
    np.testing.assert_array_equal(another.state()["parameters"], state["parameters"])


def test_who_is_to_stop_leaves_off_looking_and_looks_anew_later():
    asked, stopped_at = count(), [2]
    trainer = SizedTrainer(
        SplatTrainer(make_sequence(frames=FRAMES), SETTINGS, 0),
        "auto",
        lambda: next(asked) >= stopped_at[0],
    )
    trained_for(trainer, 70, 100)
    before = trainer.state()
    trainer.before_step(0.7)
    assert next(asked) == 3, "asked before it looked, after one number, and then no more"
    after = trainer.state()
    assert before.keys() == after.keys()
    for name, value in before.items():
        np.testing.assert_array_equal(after[name], value)
    stopped_at[0] = 10**9
    assert finished(trainer, begun=70).metrics["size"]["kept"] < 4500


def test_a_training_goes_on_with_merged_splats():
    trainer, another = sized(), sized()
    trained_for(trainer, 75, 100)
    another.restore(trainer.state())
    for one in (trainer, another):
        trained_for(one, 100, 100, begun=75)
    first, second = trainer.finish({}), another.finish({})
    np.testing.assert_array_equal(first.parameters, second.parameters)
    assert first.metrics["size"] == second.metrics["size"]


def test_a_stopped_training_chooses_the_same(tmp_path):
    path, reports = tmp_path / "run.checkpoint", []

    def fit(**options) -> SplatModel:
        model = train(
            make_sequence(frames=FRAMES),
            iterations=60,
            size="auto",
            checkpoint=path,
            clock=ticking(),
            on_progress=reports.append,
            **options,
        )
        assert isinstance(model, SplatModel)
        return model

    with pytest.raises(TrainingStopped):
        fit(should_stop=lambda: bool(reports))
    resumed = fit()
    assert not path.with_suffix(".part").exists()
    path.unlink()
    straight = fit()
    assert len(resumed) == len(straight)
    np.testing.assert_array_equal(resumed.parameters, straight.parameters)


def test_full_keeps_all_and_tells_nothing():
    model = train(make_sequence(), iterations=20, clock=ticking())
    assert isinstance(model, SplatModel)
    assert "size" not in model.metrics
    assert len(model) > 0.9 * SplatSettings().count


def test_a_model_file_tells_what_was_tried(tmp_path):
    model = finished(sized())
    save_model(model, tmp_path / "few.safetensors")
    assert load_model(tmp_path / "few.safetensors").metrics["size"] == model.metrics["size"]
