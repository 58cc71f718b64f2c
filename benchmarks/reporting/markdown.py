"""Generated parts of hand-written pages: what stands between two markers."""

from __future__ import annotations

from collections.abc import Iterable

from scene.errors import InvalidInput


def replaced(page: str, name: str, text: str) -> str:
    """`page` with `text` between `<!-- name:begin -->` and `<!-- name:end -->`.

    Raises InvalidInput where the markers are not there, each once and in order.
    """
    begin, end = f"<!-- {name}:begin -->", f"<!-- {name}:end -->"
    before, found, rest = page.partition(begin)
    _, closed, after = rest.partition(end)
    if not (found and closed):
        raise InvalidInput(
            f"a page must hold {begin} and then {end}; got neither or one of them; put both where "
            "the text is to stand"
        )
    return f"{before}{begin}\n\n{text.strip()}\n\n{end}{after}"


def markdown_table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """A table in GitHub's Markdown."""
    head = list(head)
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)
