"""Splats that no frame determines take their colour from the seen surface of their kind."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from renderer.splats.layout import COLOUR, PARAMETERS
from renderer.splats.settings import SplatSettings
from renderer.splats.training.evidence import Evidence
from renderer.splats.training.filling import fill_unseen, held_colours
from renderer.splats.training.surface_kinds import KINDS
from renderer.splats.training.trainer import SplatTrainer
from scene.arrays import Array, Float
from tests.renderer.studio import make_sequence

HAIR, CLOTH, ARM, FACE, HANDS, LEGS = (
    KINDS.index(kind) for kind in ("scalp", "trunk", "arms", "face", "hands", "legs")
)


def splats(*rows: tuple[float, float, float, float]) -> np.ndarray:
    """x, y, z and a shade of grey each."""
    parameters = np.zeros((len(rows), PARAMETERS), np.float32)
    for i, (x, y, z, grey) in enumerate(rows):
        parameters[i, :3], parameters[i, COLOUR : COLOUR + 3] = (x, y, z), grey
    return parameters


def line_of(*greys: float) -> np.ndarray:
    """Splats a centimetre apart, each of a shade of grey."""
    return splats(*((0.01 * i, 1.0, 0.0, grey) for i, grey in enumerate(greys)))


def filled_greys(
    trained: Float[Array, "N P"],
    evidence: Float[Array, "N"],
    facing: Float[Array, "N"] | None = None,
    kinds: Array | None = None,
) -> Float[Array, "N"]:
    """One channel of the filled colours; all of one kind, all facing the camera, if not told."""
    found = Evidence.of(evidence, evidence if facing is None else facing)
    kinds = np.full(len(trained), CLOTH) if kinds is None else kinds
    return fill_unseen(trained, found, kinds)[:, COLOUR]


def test_determined_colours_stay_and_others_lie_between_them():
    trained = line_of(0.48, *[0.9] * 30, 0.52)
    evidence = np.zeros(32)
    evidence[[0, -1]] = 10.0
    filled = filled_greys(trained, evidence)
    np.testing.assert_allclose(filled[[0, -1]], [0.48, 0.52], atol=0.001)
    assert (np.diff(filled) > -1e-6).all()
    assert np.diff(filled).max() < 0.02


def test_splats_denser_than_pixels_are_seen_as_well_as_others():
    """Of a person far away each open splat has a hundredth of a pixel, and is seen all the same."""
    trained = line_of(*[0.4] * 10, 0.9, *[0.4] * 10)
    pixels = np.append(np.full(20, 2.0), 0.004)
    assert Evidence.of(pixels, pixels).seen.tolist() == [True] * 20 + [False]
    few = 0.005 * pixels
    assert Evidence.of(few, few).seen.tolist() == [True] * 20 + [False]
    assert filled_greys(trained, few)[10] > 0.89


def test_a_colour_that_frames_hardly_determine_gives_way_to_those_around():
    trained = line_of(*[0.4] * 10, 0.9, *[0.4] * 10)
    strong, weak = np.full(21, 5.0), np.full(21, 5.0)
    weak[10] = 0.02
    assert filled_greys(trained, strong)[10] > 0.89
    assert filled_greys(trained, weak)[10] < 0.45


def head_and_trunk() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Splats on two columns, a head over a trunk, whose front alone was seen: parameters, evidence,
    kinds. Hair is dark, cloth is light with a stripe of every other splat;
    the back has no colour yet."""
    rows, kinds = [], []
    for kind, low, grey in ((HAIR, 1.5, 0.1), (CLOTH, 1.0, 0.8)):
        for i in range(400):
            height, z = low + 0.4 * (i // 20) / 20, 0.01 * (i % 20)
            stripe = 0.1 * (-1) ** i if kind == CLOTH else 0.0
            rows.append((0.0, height, z, grey + stripe if z >= 0.1 else 0.5))
            kinds.append(kind)
    parameters = splats(*rows)
    return parameters, np.where(parameters[:, 2] >= 0.1, 3.0, 0.0), np.array(kinds)


def test_a_back_takes_hair_from_hair_and_cloth_from_cloth():
    trained, evidence, kinds = head_and_trunk()
    filled = filled_greys(trained, evidence, kinds=kinds)
    back, inside = evidence == 0.0, np.abs(trained[:, 1] - 1.45) > 0.1
    assert np.abs(filled[back & inside & (kinds == HAIR)] - 0.1).max() < 0.05
    assert np.abs(filled[back & inside & (kinds == CLOTH)] - 0.8).max() < 0.1


def test_unseen_hair_is_like_neither_a_high_forehead_nor_a_lamp_on_the_crown():
    """Of a scalp whose front was seen, half is bare, and a lamp shines on a part of the rest."""
    trained, evidence, kinds = head_and_trunk()
    scalp, seen = kinds == HAIR, evidence > 0.0
    kinds[kinds == CLOTH] = FACE
    trained[scalp & (trained[:, 1] < 1.7) & seen, COLOUR : COLOUR + 3] = 0.8
    trained[scalp & (trained[:, 1] > 1.85) & seen, COLOUR : COLOUR + 3] = 0.98
    filled = filled_greys(trained, evidence, kinds=kinds)
    behind = scalp & (trained[:, 2] < 0.04) & (trained[:, 1] > 1.7)
    assert filled[behind].max() < 0.2
    np.testing.assert_allclose(filled[scalp & seen], trained[scalp & seen, COLOUR], atol=0.02)


def test_what_no_frame_shows_is_like_its_mirror_image():
    """The end of a sleeve, with grey cloth halfway between it and the other one's."""
    places = [(1.0 + 0.02 * i, 0.02 * j) for i in range(8) for j in range(8)]
    rows = [(x, y, z, grey) for x, grey in ((0.3, 0.9), (0.0, 0.2), (-0.3, 0.5)) for y, z in places]
    evidence, arms = np.repeat([5.0, 5.0, 0.0], len(places)), np.full(len(rows), ARM)
    filled = filled_greys(splats(*rows), evidence, kinds=arms)
    np.testing.assert_allclose(filled[-len(places) :], 0.9, atol=0.05)


def test_a_sleeve_that_no_frame_shows_ends_in_a_line():
    """Down a limb whose front alone was seen, dark cloth ends and light skin begins."""
    rows = [
        (0.01 * across, 1.0 - 0.01 * i, 0.0, 0.1 if i < 20 else 0.8)
        for across in range(10)
        for i in range(40)
    ]
    seen = np.repeat(np.arange(10) < 4, 40)
    trained = splats(*rows)
    trained[~seen, COLOUR : COLOUR + 3] = 0.5
    filled = filled_greys(trained, np.where(seen, 5.0, 0.0)).reshape(10, 40)
    np.testing.assert_allclose(filled[4:, :18], 0.1, atol=0.01)
    np.testing.assert_allclose(filled[4:, 22:], 0.8, atol=0.01)


def test_a_hem_goes_round_hips_that_move_with_the_legs():
    """A light band between a shirt and trousers, both dark: in front it lies on splats of the
    trunk, behind, where no frame shows it, on those of the legs."""
    rows = [
        (0.02 * x, 0.02 * y, depth, 0.9 if 20 <= y < 30 else 0.1)
        for depth in (0.0, -0.2)
        for y in range(50)
        for x in range(20)
    ]
    trained = splats(*rows)
    seen, light = trained[:, 2] == 0.0, trained[:, COLOUR] == np.float32(0.9)
    trained[~seen, COLOUR : COLOUR + 3] = 0.5
    hip = np.where(seen, 0.2, 0.8)
    kinds = np.where(trained[:, 1] < hip, LEGS, CLOTH)
    filled = filled_greys(trained, np.where(seen, 5.0, 0.0), kinds=kinds)
    assert filled[~seen & light].min() > 0.8
    assert filled[~seen & ~light].max() < 0.2


def test_where_two_garments_meet_a_guess_is_the_colour_of_one():
    """Red over blue, at the same distance from what was not seen: never the purple of neither."""
    rows = [(0.02 * (i % 5), 0.02 * (i // 5), 0.0, 0.0) for i in range(100)]
    trained = splats(*rows)
    trained[:, COLOUR : COLOUR + 3] = np.where(np.arange(100)[:, None] < 50, (0.9, 0, 0), (0, 0, 1))
    evidence = np.where(np.arange(100) % 5 < 3, 5.0, 0.0)
    found = Evidence.of(evidence, evidence)
    colours = fill_unseen(trained, found, np.full(100, CLOTH))[:, COLOUR : COLOUR + 3]
    assert (colours.min(axis=1) < 0.05).all()
    assert (colours[:, [0, 2]].max(axis=1) > 0.85).all()


def test_seen_splats_keep_their_colour():
    trained, evidence, kinds = head_and_trunk()
    filled, seen = filled_greys(trained, evidence, kinds=kinds), evidence > 0.0
    np.testing.assert_allclose(filled[seen], trained[seen, COLOUR], atol=0.01)


def test_a_back_shows_low_frequencies_alone():
    trained, evidence, kinds = head_and_trunk()
    filled = filled_greys(trained, evidence, kinds=kinds).reshape(2, 20, 20)
    stripes = np.abs(np.diff(filled[1], axis=1))
    assert stripes[:, 11:].min() > 0.15
    assert stripes[:, :6].max() < 0.02


def test_a_rim_in_the_colour_of_the_background_does_not_spread():
    trained, evidence, kinds = head_and_trunk()
    rim = np.isclose(trained[:, 2], 0.1)
    trained[rim, COLOUR : COLOUR + 3], evidence[rim] = 1.0, 0.3
    facing = np.where(rim, 0.0, evidence)
    filled = filled_greys(trained, evidence, facing, kinds)
    far = (trained[:, 2] < 0.04) & (kinds == HAIR) & (trained[:, 1] > 1.55)
    assert filled[far].max() < 0.2


def test_what_only_a_rim_shows_comes_to_the_range_of_the_surface_near_it():
    trained = line_of(*np.tile([0.3, 0.5], 40), 0.95, 0.4)
    evidence, facing = np.full(82, 5.0), np.full(82, 5.0)
    facing[-2:] = 0.0
    filled = filled_greys(trained, evidence, facing)
    assert 0.38 < filled[-2] < 0.52
    np.testing.assert_allclose(filled[-1], 0.4, atol=0.01)
    np.testing.assert_allclose(filled[:-4], trained[:-4, COLOUR], atol=0.01)


def test_a_kind_that_was_never_seen_takes_what_lies_nearest():
    near, far = line_of(*[0.2] * 12), line_of(*[0.9] * 12)
    far[:, 0] += 5.0
    evidence, kinds = np.repeat([1.0, 0.0], 12), np.repeat([CLOTH, HAIR], 12)
    filled = filled_greys(np.concatenate([near, far]), evidence, kinds=kinds)
    np.testing.assert_allclose(filled, 0.2, atol=1e-5)


def test_shape_and_opacity_stay():
    trained = np.random.default_rng(0).uniform(size=(40, PARAMETERS)).astype(np.float32)
    evidence = np.linspace(0.0, 1.0, 40)
    filled = fill_unseen(trained, Evidence.of(evidence, evidence), np.full(40, CLOTH))
    rest = np.delete(np.arange(PARAMETERS), range(COLOUR, COLOUR + 3))
    np.testing.assert_array_equal(filled[:, rest], trained[:, rest])


def test_nothing_changes_where_nothing_was_seen():
    trained, none = line_of(0.1, 0.9), np.zeros(2)
    assert fill_unseen(trained, Evidence.of(none, none), np.full(2, CLOTH)) is trained


def test_what_shines_through_from_behind_is_no_evidence():
    shown = np.full((4, 3), 2.0)
    cosines = np.tile([0.9, 0.0, -0.8], (4, 1))
    found = Evidence.of_frames(shown, cosines)
    np.testing.assert_allclose(found.facing, [2.0, 0.0, 0.0])
    assert 0.0 < found.pixels[1] < found.pixels[0]
    assert found.seen.tolist() == [True, True, False]


def test_filled_colours_hold_while_training_ends():
    trainer = SplatTrainer(make_sequence(), replace(SplatSettings(), count=400, most=400), 0)
    for _ in range(4):
        trainer.step(0.1)
    before = trainer.splats.parameters.copy()
    trainer.before_step(0.79)
    np.testing.assert_array_equal(trainer.splats.parameters, before)
    trainer.before_step(0.8)
    filled = trainer.splats.parameters.copy()
    for _ in range(4):
        trainer.step(0.9)
    changed = (trainer.splats.parameters != filled)[:, COLOUR : COLOUR + 3].any(axis=1)
    model = trainer.finish({})
    seen = model.seen
    np.testing.assert_array_equal(model.parameters, trainer.splats.parameters)
    assert 0 < seen.sum() < len(seen)
    assert not changed[~seen].any()
    assert changed[seen].mean() > 0.5


def test_what_only_a_rim_shows_keeps_what_it_was_filled_with_but_for_hands_and_the_face():
    pixels = np.array([0.0, 0.3, 0.3, 0.3, 0.3, 0.3, 0.3, 0.1, 0.1, 1.0])
    facing = np.array([0.0, 0.0, 0.3, 0.0, 0.0, 0.0, 0.0, 0.0, 0.1, 1.0])
    kinds = np.array([CLOTH, HAIR, HAIR, CLOTH, FACE, FACE, HANDS, FACE, FACE, CLOTH])
    normals = np.tile((0.0, 0.0, 1.0), (10, 1))
    normals[5] = (1.0, 0.0, 0.0)
    held = held_colours(Evidence.of(pixels, facing), kinds, normals)
    assert np.flatnonzero(held).tolist() == [0, 1, 3, 5, 7]


def test_a_training_whose_last_steps_took_all_its_time_is_filled_in_the_end():
    """As one is where a pass over all poses goes on past the end."""
    settings = replace(SplatSettings(), count=400, most=400)
    models = []
    for fractions in ((), (0.9,)):
        trainer = SplatTrainer(make_sequence(), settings, 0)
        for _ in range(4):
            trainer.step(0.1)
        for fraction in fractions:
            trainer.before_step(fraction)
        models.append(trainer.finish({}))
    late, filled = models
    np.testing.assert_array_equal(late.parameters, filled.parameters)
    np.testing.assert_array_equal(late.seen, filled.seen)
