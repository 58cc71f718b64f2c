"""Traces: what one request or one movement passes through, and for how long, in all processes.

Off unless METANERF_OTLP_ENDPOINT is set: else nothing here imports OpenTelemetry, no request
passes by anything of this, and a job's row names no trace. Spans name kinds, never people, meetings
or tokens: a meeting's id is its invitation.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from typing import NamedTuple

Value = str | int | float
Tell = Callable[[str, Value], None]
"""Adds to a span, by key and value."""


class PastSpan(NamedTuple):
    """A span that has been: its name, and from when to when, s since 1970."""

    name: str
    begin_s: float
    end_s: float


class Tracing:
    """The traces of a process; as it stands, none."""

    on = False

    def span(
        self,
        name: str,
        *,
        parent: str | None = None,
        serves: bool = False,
        attributes: Mapping[str, Value] | None = None,
    ) -> AbstractContextManager[Tell]:
        """A span as long as the context, which an exception marks as failed; what is within it on
        the same thread or task is its child.

        `parent` is a `traceparent` (W3C Trace Context); None: the span that this is within, if any.
        `serves`: it is the answer to somebody else's request.
        """
        return _untraced()

    def record(
        self,
        whole: PastSpan,
        parts: Sequence[PastSpan] = (),
        *,
        parent: str | None = None,
        attributes: Mapping[str, Value] | None = None,
    ) -> None:
        """Note a span that is over, with its children."""

    def here(self) -> str | None:
        """The `traceparent` of the span that this is within; None outside of any."""
        return None

    def close(self) -> None:
        """Send what is left; returns after seconds at most, whoever is away."""


@contextmanager
def _untraced() -> Iterator[Tell]:
    yield lambda _key, _value: None
