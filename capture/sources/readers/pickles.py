"""Pickles of data sets, read without running anything in them.

A pickle is a program, and the data sets of this field are pickles: of numpy arrays, dicts, lists,
tuples, numbers and strings. This reads those and refuses every other name. Nor does it call numpy's
own unpickling, which trusts what it is told of sizes: arrays are rebuilt here from their bytes.

    mesh_infos = load_pickle(path)             # dict of dicts
    poses = numbers(mesh_infos[...]["poses"], (72,), "poses")
"""

from __future__ import annotations

import io
import math
import pickle
import re
import tokenize
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from capture.errors import BrokenDataset
from scene.arrays import Array

MAX_BYTES = 1 << 30
"""A larger pickle is none of poses and cameras."""
_DTYPE = re.compile(r"(b1|[iu][1248]|f[248]|U\d{1,5}|S\d{1,5}|O8?)")
_UNREADABLE = (
    pickle.UnpicklingError,
    EOFError,
    OSError,
    ValueError,
    TypeError,
    AttributeError,
    KeyError,
    IndexError,
    MemoryError,
    OverflowError,
    RecursionError,
)


_NO_ARRAY = (ValueError, EOFError, OSError, MemoryError, SyntaxError, tokenize.TokenError)
"""What NumPy raises for files that are none of its own."""


def load_pickle(path: Path) -> Any:
    """What the pickle at `path` holds; arrays in it come out by `numbers` and `strings`.

    Raises BrokenDataset for a file that is no pickle or holds anything but plain data.
    """
    return _load(_bytes_of(path), path)


def load_npy(path: Path) -> Any:
    """What the .npy file at `path` holds: an array, or the one object that was saved.

    Raises BrokenDataset for a file that is no .npy or holds anything but plain data.
    """
    stream = io.BytesIO(_bytes_of(path))
    try:
        version = np.lib.format.read_magic(stream)
        read_header = (
            np.lib.format.read_array_header_1_0
            if version == (1, 0)
            else np.lib.format.read_array_header_2_0
        )
        shape, _, dtype = read_header(stream)
        if not dtype.hasobject:
            stream.seek(0)
            return np.load(stream, allow_pickle=False)
    except _NO_ARRAY as error:
        raise BrokenDataset(f"{path.name} must be a readable .npy file; got {error}") from error
    held = _load(stream.read(), path)
    objects = held.objects() if isinstance(held, _Stored) else None
    if objects is None or len(objects) != math.prod(shape):
        raise BrokenDataset(f"{path.name} must hold the objects it declares; got {held!r}")
    return objects[0] if shape == () else objects


def numbers(value: Any, shape: tuple[int | None, ...] | None, name: str) -> Array:
    """`value` (an array, or lists of numbers and arrays) as finite float64 of `shape` (None: any).

    None in `shape` is any length; sides of length one may be missing or too many, as (1, 72) for
    (72,). Raises BrokenDataset.
    """
    try:
        found = np.asarray(_plain(value), dtype=np.float64)
    except (ValueError, TypeError, RecursionError) as error:
        raise BrokenDataset(f"{name} must be numbers; got {error}") from error
    if shape is not None:
        found = _shaped(found, shape, name)
    if not np.isfinite(found).all():
        raise BrokenDataset(f"{name} must be finite; got NaN or infinity")
    return found


def _shaped(found: Array, shape: tuple[int | None, ...], name: str) -> Array:
    if None not in shape and _without_ones(found.shape) == _without_ones(shape):
        return found.reshape([side or 0 for side in shape])
    fits = found.ndim == len(shape) and all(
        want is None or want == have for want, have in zip(shape, found.shape, strict=True)
    )
    if not fits:
        wanted = " x ".join("N" if side is None else str(side) for side in shape)
        raise BrokenDataset(f"{name} must be {wanted}; got {' x '.join(map(str, found.shape))}")
    return found


def _without_ones(shape: tuple[int | None, ...]) -> tuple[int | None, ...]:
    return tuple(side for side in shape if side != 1)


def strings(value: Any, name: str) -> list[str]:
    """`value` (an array or a list) as a list of strings. Raises BrokenDataset."""
    found = _plain(value)
    found = found.tolist() if isinstance(found, np.ndarray) else found
    if not isinstance(found, list | tuple) or not all(isinstance(one, str) for one in found):
        raise BrokenDataset(f"{name} must be a list of names; got {type(value).__name__}")
    return list(found)


def table(value: Any, name: str, *keys: str) -> dict[str, Any]:
    """`value` as a dict that has `keys`. Raises BrokenDataset."""
    if not isinstance(value, dict):
        raise BrokenDataset(f"{name} must be a dict; got {type(value).__name__}")
    missing = [key for key in keys if key not in value]
    if missing:
        raise BrokenDataset(f"{name} must hold {', '.join(keys)}; {missing[0]} is missing")
    return value


def _bytes_of(path: Path) -> bytes:
    try:
        size = path.stat().st_size
        if size > MAX_BYTES:
            raise BrokenDataset(f"{path.name} must be at most {MAX_BYTES} bytes; got {size}")
        return path.read_bytes()
    except OSError as error:
        raise BrokenDataset(f"{path} must be a readable file; got {error}") from error


def _load(data: bytes, path: Path) -> Any:
    try:
        # latin1: what Python 2 wrote as bytes comes out as strings
        return _PlainUnpickler(io.BytesIO(data), encoding="latin1").load()
    except BrokenDataset as error:
        raise BrokenDataset(f"{path.name} {error}") from error
    except _UNREADABLE as error:
        raise BrokenDataset(f"{path.name} must be a whole pickle; got {error!r}") from error


def _plain(value: Any, depth: int = 0) -> Any:
    """Stored arrays in `value` made real, in lists of lists too."""
    if isinstance(value, _Stored):
        return value.array()
    if isinstance(value, list | tuple) and depth < 4:
        return [_plain(one, depth + 1) for one in value]
    return value


class _AllowedGlobal:
    """What an allowed name stands for: may be called, and can't be tampered with."""

    __slots__ = ("_make",)

    def __init__(self, make: Callable[..., Any]) -> None:
        self._make = make

    def __call__(self, *given: Any) -> Any:
        return self._make(*given)

    def __setstate__(self, state: Any) -> None:
        raise pickle.UnpicklingError(f"a function can't be changed; got {state!r}")


class _Kind:
    """A dtype: `f4`, `U12`, `O8`, ... and its byte order."""

    __slots__ = ("order", "spec")

    def __init__(self, spec: Any, *_: Any) -> None:
        if not isinstance(spec, str) or not _DTYPE.fullmatch(spec):
            raise pickle.UnpicklingError(f"arrays must be of numbers or strings; got {spec!r}")
        self.spec, self.order = spec, "="

    def __setstate__(self, state: Any) -> None:
        _, order, subarray, names, fields = state[:5]
        if order not in ("<", ">", "=", "|") or (subarray, names, fields) != (None, None, None):
            raise pickle.UnpicklingError(f"arrays must be of plain numbers; got {state!r}")
        self.order = order

    def numpy(self) -> np.dtype:
        return np.dtype(self.order + self.spec)


class _Stored:
    """An array as its pickle holds it: shape, kind, bytes (or, of objects, a list)."""

    __slots__ = ("_fortran", "_kind", "_raw", "_shape")

    def __init__(self) -> None:
        self._kind, self._shape, self._fortran, self._raw = _Kind("f8"), (0,), False, b""

    def __setstate__(self, state: Any) -> None:
        _, shape, kind, fortran, raw = state
        raw = raw.encode("latin1") if isinstance(raw, str) else raw
        sides = isinstance(shape, tuple) and all(type(n) is int and n >= 0 for n in shape)
        if (
            not sides
            or not isinstance(kind, _Kind)
            or not isinstance(raw, bytes | bytearray | list)
        ):
            raise pickle.UnpicklingError(
                f"an array must have a shape, a kind and data; got {shape!r}"
            )
        one = 1 if isinstance(raw, list) else kind.numpy().itemsize
        if kind.spec.startswith("O") is not isinstance(raw, list) or (
            len(raw) != math.prod(shape) * one
        ):
            raise pickle.UnpicklingError(f"an array of {shape} must fill it; got {len(raw)} bytes")
        self._kind, self._shape, self._fortran, self._raw = kind, shape, bool(fortran), raw

    def objects(self) -> list[Any] | None:
        return self._raw if isinstance(self._raw, list) else None

    def array(self) -> Any:
        """A fresh array; of objects, a list."""
        if isinstance(self._raw, list):
            return [_plain(one, 1) for one in self._raw]
        flat = np.frombuffer(self._raw, self._kind.numpy())
        return flat.reshape(self._shape, order="F" if self._fortran else "C").copy()


def _from_buffer(raw: Any, kind: Any, shape: Any, order: Any) -> _Stored:
    stored = _Stored()
    stored.__setstate__((1, shape, kind, order == "F", bytes(raw)))
    return stored


def _scalar(kind: Any, raw: Any) -> Any:
    stored = _Stored()
    stored.__setstate__((1, (), kind, False, raw))
    return stored.array().item()


def _encode(text: Any, encoding: Any) -> bytes:
    if not isinstance(text, str) or encoding != "latin1":
        raise pickle.UnpicklingError(f"bytes must be written as latin1; got {encoding!r}")
    return text.encode("latin1")


_ALLOWED: Mapping[tuple[str, str], Callable[..., Any]] = {
    ("numpy._core.multiarray", "_reconstruct"): lambda *_: _Stored(),
    ("numpy._core.multiarray", "scalar"): _scalar,
    ("numpy._core.numeric", "_frombuffer"): _from_buffer,
    ("numpy", "dtype"): _Kind,
    ("numpy", "ndarray"): lambda *_: _Stored(),
    ("_codecs", "encode"): _encode,
}
"""The names that pickles of arrays have, and what we do instead."""


class _PlainUnpickler(pickle.Unpickler):
    def find_class(self, module: str, name: str) -> Any:
        """The stand-in of an allowed name. Raises BrokenDataset for any other: it may be code."""
        make = _ALLOWED.get((module.replace("numpy.core", "numpy._core"), name))
        if make is None:
            raise BrokenDataset(
                "must hold only arrays, dicts, lists, tuples, numbers and strings; got a call of "
                f"{module}.{name}, which could run anything: do not open this file elsewhere"
            )
        return _AllowedGlobal(make)
