"""The page's types are what the gateway describes; a change that forgets them fails."""

from __future__ import annotations

import pytest

from scene.errors import InvalidInput
from tools.client_types import CLIENT_TYPES, document, typescript


def _module(**properties: dict) -> str:
    schema = {"type": "object", "properties": properties, "required": ["needed"]}
    return typescript({"components": {"schemas": {"Thing": schema}}})


def test_the_page_has_the_types_of_this_gateway():
    assert CLIENT_TYPES.read_text() == typescript(document()), "run `python -m tools.client_types`"


def test_schemas_become_types():
    lists = {"type": "array", "items": {"anyOf": [{"type": "string"}, {"type": "null"}]}}
    text = _module(
        needed={"$ref": "#/components/schemas/Other", "description": "Whose  it is."},
        left_out={"type": "integer"},
        lists=lists,
        place={"type": "array", "prefixItems": [{"type": "number"}] * 2},
        word={"enum": ["a", "b"]},
        table={"type": "object", "additionalProperties": {"type": "boolean"}},
    )
    for line in (
        "  /** Whose it is. */\n  needed: Other;",
        "left_out?: number;",
        "lists?: (string | null)[];",
        "place?: readonly [number, number];",
        'word?: "a" | "b";',
        "table?: Record<string, boolean>;",
    ):
        assert line in text


def test_a_kind_without_a_type_is_told():
    with pytest.raises(InvalidInput, match="needed must be of a kind of JSON"):
        _module(needed={"type": "tensor"})
