"""Who takes traces by OTLP over HTTP, as a collector does, and keeps them for a test to look at."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

from opentelemetry.proto.collector.trace.v1.trace_service_pb2 import (
    ExportTraceServiceRequest,
    ExportTraceServiceResponse,
)


@dataclass(frozen=True)
class Span:
    """One that came."""

    name: str
    trace: str
    id: str
    parent: str
    """Empty: none."""
    begin_ns: int
    end_ns: int
    failed: bool
    attributes: dict[str, str]
    """As text."""
    process: str

    def is_in(self, other: Span) -> bool:
        """Whether `other` is the span's parent."""
        return (self.trace, self.parent) == (other.trace, other.id)


@dataclass
class Collector:
    """What has come so far."""

    url: str
    spans: list[Span] = field(default_factory=list)

    def named(self, name: str) -> list[Span]:
        """The spans of that name, as they came."""
        return [one for one in self.spans if one.name == name]

    def take(self, body: bytes) -> None:
        """Keep the spans of a request."""
        for of_process in ExportTraceServiceRequest.FromString(body).resource_spans:
            about = _texts(of_process.resource.attributes)
            for scope in of_process.scope_spans:
                for one in scope.spans:
                    self.spans.append(
                        Span(
                            one.name,
                            one.trace_id.hex(),
                            one.span_id.hex(),
                            one.parent_span_id.hex(),
                            one.start_time_unix_nano,
                            one.end_time_unix_nano,
                            one.status.code == one.status.STATUS_CODE_ERROR,
                            _texts(one.attributes),
                            about["service.instance.id"],
                        )
                    )


def _texts(attributes) -> dict[str, str]:
    return {one.key: str(getattr(one.value, one.value.WhichOneof("value"))) for one in attributes}


@contextmanager
def collecting() -> Iterator[Collector]:
    """A collector on a port of its own."""
    collector = Collector("")

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            assert self.path == "/v1/traces"
            collector.take(self.rfile.read(int(self.headers["Content-Length"])))
            answer = ExportTraceServiceResponse().SerializeToString()
            self.send_response(200)
            self.send_header("Content-Type", "application/x-protobuf")
            self.send_header("Content-Length", str(len(answer)))
            self.end_headers()
            self.wfile.write(answer)

        def log_message(self, format: str, *args: object) -> None:
            """Says nothing."""

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    collector.url = f"http://127.0.0.1:{server.server_address[1]}"
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    try:
        yield collector
    finally:
        server.shutdown()
        server.server_close()
        thread.join()
