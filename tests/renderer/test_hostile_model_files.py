"""Whatever a model file holds, it is read or refused: compiled code follows its numbers unasked."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from safetensors import safe_open
from safetensors.numpy import save_file

from renderer.errors import BrokenModel
from renderer.field.model import FieldModel
from renderer.field.training.trainer import FieldTrainer
from renderer.model_files import load_model, save_model
from renderer.splats.cloth.tubes import Tubes
from renderer.splats.model import SplatModel
from tests.few_examples import FEW
from tests.renderer.field.performer import TINY, sequence
from tests.renderer.studio import make_model

Parts = tuple[dict[str, np.ndarray], dict[str, Any]]


def _skirt() -> Tubes:
    angles = np.linspace(0.0, 2.0 * np.pi, 4, endpoint=False)
    ring = np.stack([np.cos(angles), 0.0 * angles, np.sin(angles)], axis=1)
    return Tubes(
        rest=np.concatenate([ring, ring - [0.0, 0.1, 0.0]]),
        tubes=np.array([[0, 0, 2, 4]]),
        ends=np.zeros((1, 2, 3)),
        movers=np.array([[1, 4]]),
        radii=np.array([0.1]),
        owners=np.array([0]),
        constants=np.array([25.0, 9.0, 0.1]),
    )


def _parts(model: SplatModel | FieldModel, folder: Path) -> Parts:
    path = folder / "model.safetensors"
    save_model(model, path)
    with safe_open(str(path), framework="numpy") as stored:
        tensors = {name: stored.get_tensor(name) for name in stored.keys()}  # noqa: SIM118
        return tensors, json.loads(stored.metadata()["metanerf"])


@pytest.fixture(scope="module")
def splats(tmp_path_factory: pytest.TempPathFactory) -> Parts:
    tensors, about = _parts(make_model(30), tmp_path_factory.mktemp("splats"))
    tensors |= {f"cloth.{name}": array for name, array in _skirt().tensors().items()}
    quads = np.full(30, -1, np.int32)
    quads[:4] = range(4)
    return tensors | {"quads": quads}, about


@pytest.fixture(scope="module")
def field(tmp_path_factory: pytest.TempPathFactory) -> Parts:
    model = FieldTrainer(sequence(), "fast", TINY, 0).finish({})
    return _parts(model, tmp_path_factory.mktemp("field"))


def _load(parts: Parts) -> SplatModel | FieldModel:
    """What comes of a file of these parts; nothing else is left behind."""
    tensors, about = parts
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "model.safetensors"
        kept = {name: np.ascontiguousarray(array) for name, array in tensors.items()}
        save_file(kept, str(path), metadata={"metanerf": json.dumps(about)})
        try:
            found = load_model(path)
        finally:
            assert [one.name for one in Path(folder).iterdir()] == [path.name]
    assert isinstance(found, SplatModel | FieldModel)
    return found


_CHANGES: dict[str, Callable[[np.ndarray, float], np.ndarray]] = {
    "flat": lambda array, _: array.reshape(-1),
    "shorter": lambda array, _: array[:-1],
    "none": lambda array, _: array[:0],
    "deeper": lambda array, _: array[None],
    "filled": lambda array, value: np.full_like(array, np.nan_to_num(value, posinf=9e3)),
    "as floats": lambda array, value: np.full(array.shape, value, np.float32),
    "as whole numbers": lambda array, value: np.full(
        array.shape, int(np.clip(np.nan_to_num(value), -(2**31), 2**31 - 1)), np.int64
    ),
}
_NUMBERS = st.sampled_from([0.0, -1.0, 1.0, 7.0, 255.0, 1e9, -1e9, np.nan, np.inf])
_VALUES = st.one_of(
    st.none(),
    st.integers(-3, 3),
    st.sampled_from([10**9, 2**63, -(10**30), 1e308]),
    st.text(max_size=4),
    st.lists(st.integers(-2, 9), max_size=3),
    st.dictionaries(st.sampled_from(["depth", "width"]), st.integers(), max_size=2),
)


def _attack(parts: Parts, check: Callable[[Any], None]) -> None:
    tensors, about = parts
    paths = [(name,) for name in about]
    paths += [("sizes", name) for name in about.get("sizes", ())]

    @FEW
    @given(
        name=st.sampled_from(sorted(tensors)),
        change=st.sampled_from(["left out", *_CHANGES]),
        number=_NUMBERS,
    )
    @np.errstate(all="ignore")
    def tensors_changed(name: str, change: str, number: float) -> None:
        others = {one: array for one, array in tensors.items() if one != name}
        if change != "left out":
            others[name] = _CHANGES[change](tensors[name], number)
        with suppress(BrokenModel):
            check(_load((others, about)))

    @FEW
    @given(path=st.sampled_from(paths), value=_VALUES)
    def header_changed(path: tuple[str, ...], value: object) -> None:
        told = json.loads(json.dumps(about))
        within = told if len(path) == 1 else told[path[0]]
        within[path[-1]] = value
        with suppress(BrokenModel):
            check(_load((tensors, told)))

    tensors_changed()
    header_changed()


def test_splats_that_are_read_point_nowhere_outside(splats: Parts):
    def check(model: SplatModel) -> None:
        count = len(model)
        assert model.joints.shape == model.weights.shape == (count, 4)
        assert model.joints.max(initial=0) < len(model.skeleton.names)
        assert np.isfinite(model.weights).all()
        if model.cloth is not None:
            assert model.cloth.quads.max() < len(model.cloth.rest)
            assert model.quads.min(initial=-1) >= -1
            assert model.quads.max(initial=-1) < len(model.cloth.quads)

    check(_load(splats))  # type: ignore[arg-type]
    _attack(splats, check)


def test_fields_are_read_or_refused(field: Parts):
    def check(model: FieldModel) -> None:
        stored = model.tensors()
        assert {name for name in stored if name.startswith("field.")} == {
            name for name in field[0] if name.startswith("field.")
        }

    check(_load(field))  # type: ignore[arg-type]
    _attack(field, check)


@pytest.mark.parametrize(
    "sizes",
    [{"colour": {"depth": 2, "width": 40_000}}, {"latent": 256}, {"posed_grid": 4096}],
    ids=["a wide network", "a network of which nothing is there", "a fine grid"],
)
def test_sizes_that_no_tensor_has_take_no_memory(field: Parts, sizes: dict[str, Any]):
    tensors, about = field
    with pytest.raises(BrokenModel, match=r"(learnt tensors|posed_grid) must be"):
        _load((tensors, about | {"sizes": about["sizes"] | sizes}))


@pytest.mark.parametrize("header", ["[]", "3", "null", "[" * 100_000, "{"])
def test_headers_that_are_no_object_are_refused(splats: Parts, tmp_path: Path, header: str):
    path = tmp_path / "model.safetensors"
    save_file(splats[0], str(path), metadata={"metanerf": header})
    with pytest.raises(BrokenModel, match=r"model\.safetensors must"):
        load_model(path)


@given(data=st.binary(max_size=200))
@FEW
def test_bytes_of_anything_are_no_model(data: bytes):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "model.safetensors"
        path.write_bytes(data)
        with pytest.raises(BrokenModel):
            load_model(path)
