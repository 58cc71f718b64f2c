"""Serves the built page at `/`, or says how to build it."""

from __future__ import annotations

from collections.abc import Callable, Collection
from pathlib import Path

from starlette.datastructures import MutableHeaders
from starlette.requests import Request
from starlette.responses import HTMLResponse
from starlette.routing import BaseRoute, Mount, Route
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from services.content_policy import CSP, SCRIPT_POLICY, document_policy, page_policy

_STYLE = "body { font-family: system-ui; max-width: 40rem; margin: 15vh auto; line-height: 1.6 }"
_NOT_BUILT = f"""<!doctype html><html lang="en"><meta charset="utf-8"><title>MetaNeRF</title>
<style>{_STYLE}</style>
<h1>The page is not built yet</h1>
<p>The server is up; its API is described at <a href="/docs">/docs</a>. To build the page, run
<code>npm ci &amp;&amp; npm run build</code> in <code>client/</code>, or start with
<code>make demo</code>, which does it for you.</p></html>"""


def page_route(client_dir: Path, gateways: Callable[[], Collection[str]]) -> BaseRoute:
    """Where the page is served; it comes last, since it takes every path that is left.

    `gateways`: the origins beside its own that meetings may live at now.
    """
    if (client_dir / "index.html").is_file():
        files = StaticFiles(directory=client_dir, html=True)
        return Mount("/", _PageFiles(files, gateways), name="page")
    return Route("/", _not_built)


class _PageFiles:
    """The page's files with their policies, which go by the path: an answer 304 has them as well,
    since browsers keep its headers in the place of those they had, and names no type."""

    def __init__(self, files: ASGIApp, gateways: Callable[[], Collection[str]]) -> None:
        self._files, self._gateways = files, gateways

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        is_script = scope["path"].endswith(".js")
        is_asset = "." in scope["path"].rpartition("/")[2]

        async def send_with_policy(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                headers[CSP] = SCRIPT_POLICY if is_script else page_policy(self._gateways())
                if not is_asset:
                    # its policy is of this moment
                    headers["Cache-Control"] = "no-cache"
            await send(message)

        await self._files(scope, receive, send_with_policy)


async def _not_built(request: Request) -> HTMLResponse:
    return HTMLResponse(_NOT_BUILT, headers={CSP: document_policy(_STYLE)})
