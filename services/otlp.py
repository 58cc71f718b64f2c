"""Traces by OpenTelemetry, sent by OTLP over HTTP; nothing else imports that library.

Spans wait in a bounded queue and a thread sends them, so that a collector that is away costs
traces and nothing else.
"""

from __future__ import annotations

import logging
import os
import socket
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager

from opentelemetry import trace
from opentelemetry.context import Context
from opentelemetry.exporter.otlp.proto.http.trace_exporter import OTLPSpanExporter
from opentelemetry.sdk.resources import Resource
from opentelemetry.sdk.trace import TracerProvider
from opentelemetry.sdk.trace.export import BatchSpanProcessor
from opentelemetry.trace import SpanKind, Status, StatusCode
from opentelemetry.trace.propagation.tracecontext import TraceContextTextMapPropagator

from services.tracing import PastSpan, Tell, Tracing, Value

_PATH = "/v1/traces"
_TIMEOUT_S = 2.0
_TRACEPARENT = "traceparent"
_W3C = TraceContextTextMapPropagator()


class OtlpTracing(Tracing):
    """Sends traces to one collector."""

    on = True

    def __init__(self, endpoint: str) -> None:
        where = {
            "service.name": "metanerf",
            "service.instance.id": f"{socket.gethostname()}:{os.getpid()}",
        }
        exporter = OTLPSpanExporter(endpoint=endpoint + _PATH, timeout=_TIMEOUT_S)
        self._provider = TracerProvider(resource=Resource.create(where), shutdown_on_exit=False)
        self._provider.add_span_processor(BatchSpanProcessor(exporter))
        self._tracer = self._provider.get_tracer("metanerf")
        # it tells each attempt to reach a collector that is away
        logging.getLogger("opentelemetry").setLevel(logging.CRITICAL)

    def span(
        self,
        name: str,
        *,
        parent: str | None = None,
        serves: bool = False,
        attributes: Mapping[str, Value] | None = None,
    ) -> AbstractContextManager[Tell]:
        """See `Tracing.span`."""
        return self._span(name, _context(parent), serves, attributes)

    @contextmanager
    def _span(
        self,
        name: str,
        context: Context | None,
        serves: bool,
        attributes: Mapping[str, Value] | None,
    ) -> Iterator[Tell]:
        kind = SpanKind.SERVER if serves else SpanKind.INTERNAL
        with self._tracer.start_as_current_span(
            name,
            context,
            kind,
            attributes,
            record_exception=False,  # its words may name people
            set_status_on_exception=False,
        ) as span:

            def tell(key: str, value: Value) -> None:
                if key == "name":
                    span.update_name(str(value))
                else:
                    span.set_attribute(key, value)

            try:
                yield tell
            except BaseException as error:
                span.set_attribute("error.type", type(error).__name__)
                span.set_status(Status(StatusCode.ERROR))
                raise

    def record(
        self,
        whole: PastSpan,
        parts: Sequence[PastSpan] = (),
        *,
        parent: str | None = None,
        attributes: Mapping[str, Value] | None = None,
    ) -> None:
        """See `Tracing.record`."""
        span = self._tracer.start_span(
            whole.name,
            _context(parent) or Context(),
            attributes=attributes,
            start_time=_ns(whole.begin_s),
        )
        within = trace.set_span_in_context(span)
        for part in parts:
            self._tracer.start_span(part.name, within, start_time=_ns(part.begin_s)).end(
                _ns(part.end_s)
            )
        span.end(_ns(whole.end_s))

    def here(self) -> str | None:
        """See `Tracing.here`."""
        carrier: dict[str, str] = {}
        _W3C.inject(carrier)
        return carrier.get(_TRACEPARENT)

    def close(self) -> None:
        """See `Tracing.close`."""
        self._provider.shutdown()


def _context(parent: str | None) -> Context | None:
    """What a `traceparent` says; one that is malformed says nothing."""
    return None if parent is None else _W3C.extract({_TRACEPARENT: parent}, Context())


def _ns(time_s: float) -> int:
    return round(1e9 * time_s)
