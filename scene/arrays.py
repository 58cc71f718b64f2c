"""Array annotations used all over the house: `Float[Array, "N 3"]`.

jaxtyping gives them their meaning while testing (shapes and dtypes are checked). On a machine that
has only numpy and torch they fall back to plain names, so that `scene` and `renderer` import there.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from jaxtyping import Bool, Float, Int, UInt8
    from torch import Tensor
else:
    try:
        from jaxtyping import Bool, Float, Int, UInt8
    except ImportError:

        class _Unchecked:
            """Stands in for a jaxtyping dtype: `Float[Array, "N 3"]` is then just `Array`."""

            def __class_getitem__(cls, item):
                return item[0]

        Bool = Float = Int = UInt8 = _Unchecked

Array = np.ndarray


def __getattr__(name: str) -> Any:
    # torch takes seconds to import: only a module that asks for `Tensor` pays
    if name == "Tensor":
        from torch import Tensor

        return Tensor
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


__all__ = ["Array", "Bool", "Float", "Int", "Tensor", "UInt8"]
