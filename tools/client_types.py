"""Writes the page's types of what travels as JSON: `python -m tools.client_types`.

The gateway's own description (OpenAPI 3.1, whose schemas are JSON Schema 2020-12) is the one
source; a test fails when `client/src/api/types.ts` differs from what it gives.
"""

from __future__ import annotations

import json
import tempfile
from pathlib import Path
from typing import Any

from scene.errors import InvalidInput
from services.app import create_app
from services.composition import build_services
from services.settings import load_settings

CLIENT_TYPES = Path(__file__).resolve().parents[1] / "client" / "src" / "api" / "types.ts"
_HEAD = """\
/**
 * What travels as JSON between server and page. Written from the server's OpenAPI document by
 * `python -m tools.client_types`; change services/api/*shapes.py or
 * services/control/messages.py and run that, never this file.
 */
"""
_PLAIN = {
    "string": "string",
    "integer": "number",
    "number": "number",
    "boolean": "boolean",
    "null": "null",
}

Schema = dict[str, Any]


def document() -> Schema:
    """The gateway's OpenAPI document."""
    with tempfile.TemporaryDirectory() as folder:
        # no page is mounted there, so that a build of the client changes nothing
        settings = load_settings(data_dir=Path(folder), client_dir=Path(folder))
        return create_app(build_services(settings)).openapi()


def typescript(openapi: Schema) -> str:
    """A TypeScript module with a type for every schema of `openapi`, by name."""
    schemas: dict[str, Schema] = openapi["components"]["schemas"]
    return "\n".join([_HEAD, *(_declaration(name, schemas[name]) for name in sorted(schemas))])


def _declaration(name: str, schema: Schema) -> str:
    words = _comment(schema, "")
    if "properties" not in schema:
        return f"{words}export type {name} = {_type(name, schema)};\n"
    required = set(schema.get("required", ()))
    fields = [
        f"{_comment(field, '  ')}  {key}{'' if key in required else '?'}: {_type(key, field)};\n"
        for key, field in schema["properties"].items()
    ]
    return f"{words}export interface {name} {{\n{''.join(fields)}}}\n"


def _comment(schema: Schema, indent: str) -> str:
    words = " ".join(schema.get("description", "").split())
    return f"{indent}/** {words} */\n" if words else ""


def _type(name: str, schema: Schema) -> str:
    """The TypeScript type of one schema. Raises InvalidInput for a kind that has none here."""
    if "$ref" in schema:
        return schema["$ref"].rpartition("/")[2]
    if "const" in schema:
        return json.dumps(schema["const"])
    if "enum" in schema:
        return " | ".join(json.dumps(value) for value in schema["enum"])
    if choices := schema.get("anyOf", schema.get("oneOf")):
        return " | ".join(_type(name, part) for part in choices)
    kind = schema.get("type")
    if kind == "array" and "prefixItems" in schema:
        return f"readonly [{', '.join(_type(name, part) for part in schema['prefixItems'])}]"
    if kind == "array":
        item = _type(name, schema["items"])
        return f"({item})[]" if " " in item else f"{item}[]"
    if kind == "object":
        values = schema.get("additionalProperties")
        return f"Record<string, {_type(name, values) if isinstance(values, dict) else 'unknown'}>"
    if kind in _PLAIN:
        return _PLAIN[kind]
    raise InvalidInput(
        f"{name} must be of a kind of JSON that TypeScript can name; got {schema}; "
        "teach tools/client_types.py that kind"
    )


if __name__ == "__main__":
    CLIENT_TYPES.write_text(typescript(document()))
