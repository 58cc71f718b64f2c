"""The image holds everything compiled and every model: on a read-only root nothing could be added.

Nothing is measured by the clock; docs/operate.md says how long the first picture takes.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest

from capture.detection.network_files import FACE_MODEL, HAND_MODEL, POSE_MODEL
from tests.deploy.image import Image, built, stage, variables
from tests.servers import unavailable

MODELS = (POSE_MODEL, FACE_MODEL, HAND_MODEL)
_DRAW = """
import json
from numba.core import event
compiled = event.RecordingListener()
event.register("numba:compile", compiled)
from pathlib import Path
import numpy as np
from capture.fitting import warm_up as fits
from renderer.model_files import load_model
from renderer.scene_renderer import SceneRenderer, warm_up
from scene.camera import orbit_camera
from scene.environment import Environment, Performer, Scene
from scene.motion import Pose
from services.live.motion import live_motion
warm_up()
fits.warm_up()
live_motion.warm_up()
demo = load_model(Path("services/assets/demo.safetensors"))
performer = Performer("demo", demo, np.zeros(3), 0.0, Pose.rest())
camera = orbit_camera((0.0, 1.0, 0.0), 2.5, 0.5, 0.1, 256, 256)
picture = SceneRenderer().render(Scene(Environment(), (performer,)), camera)
names = [str(one.data["dispatcher"]) for _, one in compiled.buffer]
print(json.dumps({"compiled": names, "contrast": float(picture.std())}))
"""
_FIND_MODELS = """
from capture.detection.network_files import landmark_network_file
from services.settings import load_settings
settings = load_settings()
sources = (settings.pose_model_source, settings.face_model_source, settings.hand_model_source)
print(*(landmark_network_file(source()) for source in sources))
"""
_TRAIN = """
metanerf studio --out /tmp/clip --frames 8 --size 64 --test-cameras 1 --look plain >&2 &&
metanerf train /tmp/clip --out /tmp/model.safetensors --preset splats --budget 1s >&2"""


@pytest.fixture(scope="module")
def image(
    tmp_path_factory: pytest.TempPathFactory, pose_model: Path, face_model: Path, hand_model: Path
) -> Iterator[Image]:
    models = {one.name: one for one in (pose_model, face_model, hand_model)}
    try:
        with built(tmp_path_factory.mktemp("image"), models) as made:
            yield made
    except (PermissionError, FileNotFoundError) as error:
        unavailable(str(error))


def kernels(image: Image, folder: str, after: str = "true") -> dict[str, str]:
    """The hash of each file of a cache of kernels, after some commands."""
    hashes = f"cd {folder} && find . -type f -exec sha256sum {{}} +"
    found = image.run(["sh", "-c", f"{after} && {hashes}"])
    return {name: digest for digest, name in map(str.split, found.splitlines())}


def test_each_landmark_model_is_the_makers_by_its_hash_and_where_settings_look():
    steps = stage("metanerf")
    added = [step.words for step in steps if step.word == "ADD"]
    given = variables(steps)
    for model, (*options, address, place) in zip(MODELS, added, strict=True):
        assert address == model.url
        [checksum] = [one.partition("sha256:")[2] for one in options if "checksum" in one]
        assert model.known_sha256[checksum].startswith("published")
        assert given[model.setting] == f"/app/{place}{model.file_name}"


def test_no_model_is_fetched(image: Image):
    found = image.run(["python", "-c", _FIND_MODELS]).split()
    assert found == [f"/app/models/{model.file_name}" for model in MODELS]


def test_nothing_is_compiled_to_draw_or_to_move(image: Image):
    told = json.loads(image.run(["python", "-c", _DRAW]))
    assert told["contrast"] > 5.0
    assert told["compiled"] == []


def test_nothing_is_compiled_to_train(image: Image):
    assert kernels(image, "/tmp/kernels", after=_TRAIN) == kernels(image, "/app/kernels")


def test_every_module_of_ours_has_its_bytecode(image: Image):
    script = "find scene db capture renderer services benchmarks -name '*.py' -o -name '*.pyc'"
    found = [Path(one) for one in image.run(["sh", "-c", script]).split()]
    compiled = {
        (one.parent.parent, one.name.partition(".")[0]) for one in found if one.suffix == ".pyc"
    }
    assert compiled == {(one.parent, one.stem) for one in found if one.suffix == ".py"}
    # and it is taken for good: the source's time is the one that stands in it
    told = image.run(["python", "-v", "-c", "import services.settings"])
    assert "wrote" not in told


def test_its_root_and_its_kernels_are_for_reading(image: Image):
    for place in ("/app/made", "/app/kernels/made", "/made"):
        process = image.start(["touch", place])
        assert "Read-only file system" in process.communicate()[1]
    image.run(["touch", "/data/made", "/tmp/made"])
