"""Generated parts of hand-written pages: tables between two markers."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from scene.errors import InvalidInput


def replace_between(path: Path, name: str, text: str) -> None:
    """Put `text` between `<!-- name:begin -->` and `<!-- name:end -->` in the page `path`.

    Raises InvalidInput where the markers are not there, each once and in order.
    """
    begin, end = f"<!-- {name}:begin -->", f"<!-- {name}:end -->"
    page = path.read_text() if path.exists() else ""
    before, found, rest = page.partition(begin)
    _, closed, after = rest.partition(end)
    if not (found and closed):
        raise InvalidInput(f"{path} must hold {begin} and then {end}; got neither or one of them")
    path.write_text(f"{before}{begin}\n\n{text.strip()}\n\n{end}{after}")


def markdown_table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """A table in GitHub's Markdown."""
    head = list(head)
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)
