"""What the pages name must exist: files, modules, tests and the targets of links."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
CURRENT = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted(ROOT.glob("docs/*.md"))]
"""Pages about the code as it is."""
RECORDS = sorted(ROOT.glob("docs/experiments/*.md"))
"""Dated pages, which keep the names of their day; only their links must hold."""

_PACKAGES = "scene|capture|db|renderer|services|benchmarks|tools"
_FILE = re.compile(
    rf"(?<![\w/.-])((?:{_PACKAGES}|tests|client/src|docs)/[\w./-]*[\w/])(?:::(\w+))?"
)
_DOTTED = re.compile(rf"(?<![\w/.-])((?:{_PACKAGES})(?:\.[A-Za-z_]\w*)+)")
_CODE = re.compile(r"^```(?:.|\n)*?^```|`[^`\n]+`|^    .*$", re.MULTILINE)
_LINK = re.compile(r"\]\((?!https?:)([^)#\s]*)(?:#([^)\s]*))?\)")


def _named(pages: list[Path]) -> list[str]:
    return [str(page.relative_to(ROOT)) for page in pages]


def _missing(dotted: str) -> bool:
    """Whether a dotted name is neither a module nor something that its module defines."""
    parts = dotted.split(".")
    for count in range(len(parts), 0, -1):
        base = ROOT.joinpath(*parts[:count])
        file = base.with_suffix(".py") if base.with_suffix(".py").exists() else base / "__init__.py"
        if file.exists():
            rest = parts[count:]
            return bool(rest) and rest[0] not in _defined(file)
    return True


def _defined(file: Path) -> set[str]:
    """Names at the top of a module: functions, classes, assignments and imports, those for type
    checkers too."""
    names = set[str]()
    nodes = list(ast.parse(file.read_text()).body)
    while nodes:
        node = nodes.pop()
        match node:
            case ast.If(test=ast.Name(id="TYPE_CHECKING"), body=body):
                nodes += body
            case (
                ast.FunctionDef(name=name)
                | ast.AsyncFunctionDef(name=name)
                | ast.ClassDef(name=name)
            ):
                names.add(name)
            case ast.Assign(targets=targets):
                names |= {target.id for target in targets if isinstance(target, ast.Name)}
            case ast.AnnAssign(target=ast.Name(id=name)):
                names.add(name)
            case ast.Import(names=aliases) | ast.ImportFrom(names=aliases):
                names |= {alias.asname or alias.name for alias in aliases}
            case _:
                pass
    return names


def _anchors(page: Path) -> set[str]:
    """Anchors of the headings, as GitHub makes them."""
    heads = re.findall(r"^#+ (.+)$", page.read_text(), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", head.lower()).strip().replace(" ", "-") for head in heads}


@pytest.mark.parametrize("page", _named(CURRENT))
def test_files_and_tests_that_a_page_names_exist(page: str):
    wrong = []
    for path, test in _FILE.findall((ROOT / page).read_text()):
        file = ROOT / path
        if not file.exists():
            wrong.append(path)
        elif test and f"def {test}(" not in file.read_text():
            wrong.append(f"{path}::{test}")
    assert not wrong


@pytest.mark.parametrize("page", _named(CURRENT))
def test_modules_that_a_page_names_exist(page: str):
    code = "\n".join(_CODE.findall((ROOT / page).read_text()))
    assert not [name for name in _DOTTED.findall(code) if _missing(name)]


@pytest.mark.parametrize("page", _named([*CURRENT, *RECORDS, ROOT / "docs/figures/README.md"]))
def test_links_lead_somewhere(page: str):
    here, wrong = ROOT / page, []
    for path, anchor in _LINK.findall(here.read_text()):
        target = (here.parent / path).resolve() if path else here
        if not target.exists():
            wrong.append(path)
        elif anchor and target.suffix == ".md" and anchor not in _anchors(target):
            wrong.append(f"{path}#{anchor}")
    assert not wrong


def test_every_experiment_is_in_the_index():
    index = ROOT / "docs/experiments/README.md"
    listed = set(re.findall(r"\]\(([\w-]+\.md)\)", index.read_text()))
    assert listed == {page.name for page in RECORDS} - {index.name}


def test_every_convention_names_the_test_that_holds_it():
    rows = [
        line for line in (ROOT / "docs/conventions.md").read_text().splitlines() if line[:1] == "|"
    ]
    assert not [row for row in rows[2:] if "`tests/" not in row and "every `match=`" not in row]


def test_the_glossary_is_short_and_in_order():
    text = (ROOT / "docs/glossary.md").read_text()
    terms = [line.split("|")[1].strip() for line in text.splitlines() if line[:1] == "|"][2:]
    assert 40 <= len(terms) <= 60
    assert terms == sorted(terms, key=str.lower)
