"""The API's description for people, made of the OpenAPI document.

One document without a script: Swagger UI, which FastAPI offers, would run a foreign host's code in
the origin that keeps people's tokens.
"""

from __future__ import annotations

from collections.abc import Iterator
from html import escape
from typing import Any

from fastapi import APIRouter, Request
from fastapi.responses import HTMLResponse

from services.content_policy import CSP, document_policy

router = APIRouter(include_in_schema=False)

_STYLE = """
body { font: 1rem/1.5 system-ui; max-width: 60rem; margin: 2rem auto; padding: 0 1rem }
summary { cursor: pointer } code, pre { font-family: ui-monospace, monospace }
.said { white-space: pre-line; margin: .5rem 0 } li { margin: .1rem 0 }
"""


@router.get("/docs", response_class=HTMLResponse)
async def described(request: Request) -> HTMLResponse:
    """Every call by its subject: what it does, takes and answers."""
    document = request.app.openapi()
    return HTMLResponse("".join(_page(document)), headers={CSP: document_policy(_STYLE)})


def _page(document: dict[str, Any]) -> Iterator[str]:
    about = document["info"]
    yield '<!doctype html><html lang="en"><meta charset="utf-8">'
    yield '<meta name="viewport" content="width=device-width">'
    yield f"<title>{escape(about['title'])}: the API</title><style>{_STYLE}</style>"
    yield f"<h1>{escape(about['title'])}: the API</h1><p>{escape(about['description'])}</p>"
    yield '<p>For programs: <a href="/openapi.json">/openapi.json</a>, OpenAPI 3.1.</p>'
    for tag in document["tags"]:
        yield f"<h2>{escape(tag['name'])}</h2><p>{escape(tag['description'])}</p>"
        for path, methods in document["paths"].items():
            for method, operation in methods.items():
                if tag["name"] in operation["tags"]:
                    yield from _operation(method, path, operation)


def _operation(method: str, path: str, operation: dict[str, Any]) -> Iterator[str]:
    yield f"<details><summary><code>{escape(method.upper())} {escape(path)}</code> "
    yield f"{escape(operation['summary'])}</summary>"
    yield f'<p class="said">{escape(operation["description"])}</p><ul>'
    for one in operation.get("parameters", ()):
        said = one.get("description", "")
        yield f"<li>{escape(one['in'])} <code>{escape(one['name'])}</code> {escape(said)}</li>"
    for kind, body in operation.get("requestBody", {}).get("content", {}).items():
        yield f"<li>takes {escape(kind)} {_shape(body)}</li>"
    for status, answer in operation["responses"].items():
        shapes = {_shape(body) for body in answer.get("content", {}).values()}
        said = " ".join([escape(answer["description"]), *sorted(shapes - {""})])
        yield f"<li>{escape(status)}: {said}</li>"
    yield "</ul></details>"


def _shape(body: dict[str, Any]) -> str:
    """The name under which the document's schemas describe a body, if it has one."""
    name = body.get("schema", {}).get("$ref", "").rpartition("/")[2]
    return f"<code>{escape(name)}</code>" if name else ""
