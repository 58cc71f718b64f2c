"""Serves the built page at `/`, or says how to build it."""

from __future__ import annotations

from pathlib import Path

from starlette.requests import Request
from starlette.responses import HTMLResponse
from starlette.routing import BaseRoute, Mount, Route
from starlette.staticfiles import StaticFiles

_NOT_BUILT = """<!doctype html><html lang="en"><meta charset="utf-8"><title>MetaNeRF</title>
<body style="font-family:system-ui;max-width:40rem;margin:15vh auto;line-height:1.6">
<h1>The page is not built yet</h1>
<p>The server is up; its API is described at <a href="/docs">/docs</a>. To build the page, run
<code>npm ci &amp;&amp; npm run build</code> in <code>client/</code>, or start with
<code>make demo</code>, which does it for you.</p></body></html>"""


def page_route(client_dir: Path) -> BaseRoute:
    """Where the page is served; it comes last, since it takes every path that is left."""
    if (client_dir / "index.html").is_file():
        return Mount("/", StaticFiles(directory=client_dir, html=True), name="page")
    return Route("/", _not_built)


async def _not_built(request: Request) -> HTMLResponse:
    return HTMLResponse(_NOT_BUILT)
