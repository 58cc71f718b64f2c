"""How generated examples are tried where each of them takes long, and files that were changed."""

from __future__ import annotations

from hypothesis import HealthCheck, Phase, settings
from hypothesis import strategies as st

FEW = settings(
    max_examples=150,
    derandomize=True,
    database=None,
    phases=[Phase.explicit, Phase.generate],
    suppress_health_check=[HealthCheck.too_slow],
)
"""The same in each run, and not made smaller where one fails."""


def damaged(whole: bytes) -> st.SearchStrategy[bytes]:
    """`whole` cut off, with bytes changed, or with other bytes put in."""

    def damage(cut: int, changes: list[tuple[int, int]], at: int, put_in: bytes) -> bytes:
        data = bytearray(whole[: cut or len(whole)])
        for where, value in changes:
            if data:
                data[where % len(data)] = value
        at %= len(data) + 1
        return bytes(data[:at] + put_in + data[at:])

    return st.builds(
        damage,
        st.one_of(st.just(0), st.integers(0, len(whole))),
        st.lists(st.tuples(st.integers(0, 1 << 20), st.integers(0, 255)), max_size=6),
        st.integers(0, 1 << 20),
        st.binary(max_size=8),
    )
