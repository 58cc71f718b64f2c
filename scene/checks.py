"""Rules of arrays that several words share."""

from __future__ import annotations

import numpy as np

from scene.arrays import Array
from scene.errors import InvalidInput


def require_shape(name: str, value: Array, shape: tuple[int | None, ...]) -> None:
    """Raise InvalidInput unless `value` has `shape` (None: any length)."""
    fits = value.ndim == len(shape) and all(
        want is None or have == want for have, want in zip(value.shape, shape, strict=True)
    )
    if not fits:
        wanted = " x ".join("N" if side is None else str(side) for side in shape)
        raise InvalidInput(f"{name} must be {wanted}; got {' x '.join(map(str, value.shape))}")


def require_finite(name: str, value: Array) -> None:
    """Raise InvalidInput naming the first NaN or infinity of `value` by its index."""
    bad = ~np.isfinite(value)
    if bad.any():
        place = [int(i) for i in np.argwhere(bad)[0]]
        found = value[tuple(place)]
        raise InvalidInput(
            f"{name} must be finite; got {found} at index {place}; remove that entry"
        )


def require_indices(name: str, value: Array, count: int) -> None:
    """Raise InvalidInput unless `value` holds whole numbers from 0 to below `count`."""
    if not np.issubdtype(value.dtype, np.integer):
        raise InvalidInput(f"{name} must be whole numbers; got {value.dtype}")
    if value.size and not 0 <= value.min() <= value.max() < count:
        raise InvalidInput(
            f"{name} must be from 0 to below {count}; got {value.min()} to {value.max()}"
        )
