"""What is known against the packages that we use, and what bandit sees in our Python: `make audit`.

pip-audit asks PyPI about every pinned Python package, `npm audit` asks npm about what the page
ships with, and bandit, which needs no network, reads the source. A finding fails the audit unless
`audit.toml` accepts it by its id, with the reason. Where a registry does not answer questions about
advisories, that half is left out and said to be.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx

ROOT = Path(__file__).resolve().parents[1]
SOURCES = ("scene", "db", "capture", "renderer", "services", "benchmarks", "tools")
_EVERYWHERE = "*"
_ADVISORIES = "https://pypi.org/pypi/{name}/{version}/json"
"""What pip-audit asks; a mirror of PyPI may have packages, and no answer to this."""


class Unreachable(Exception):
    """The registry does not answer questions about advisories."""


@dataclass(frozen=True)
class AuditFinding:
    """What a tool has found, and where: in a file, or in a package."""

    tool: str
    id: str
    where: str
    words: str


@dataclass(frozen=True)
class Accepted:
    """A finding that stands, for a reason."""

    tool: str
    id: str
    where: str
    reason: str

    def covers(self, finding: AuditFinding) -> bool:
        """Whether this is about that finding."""
        same = (self.tool, self.id) == (finding.tool, finding.id)
        return same and self.where in (_EVERYWHERE, finding.where)


def read_accepted(path: Path) -> list[Accepted]:
    """The findings that a file accepts. Raises TypeError for one that lacks a field, and ValueError
    for one without a reason."""
    found = [Accepted(**one) for one in tomllib.loads(path.read_text()).get("accepted", ())]
    for one in found:
        if not one.reason.strip():
            raise ValueError(f"a finding must be accepted for a reason; got none for {one.id}")
    return found


def bandit() -> list[AuditFinding]:
    """What bandit finds in our packages."""
    report = _json([sys.executable, "-m", "bandit", "-q", "-r", *SOURCES, "-f", "json"])
    if report["errors"]:
        raise RuntimeError(f"bandit must read every file; got {report['errors']}")
    return [
        AuditFinding(
            "bandit",
            one["test_id"],
            one["filename"].removeprefix("./"),
            f"line {one['line_number']}: {one['issue_text']}",
        )
        for one in report["results"]
    ]


def pip_audit() -> list[AuditFinding]:
    """Advisories about the Python packages that are pinned, those of the tests too.

    Raises Unreachable.
    """
    torch = next(line for line in _dependencies() if line.startswith("torch=="))
    _ask_pypi(*torch.split("=="))
    with tempfile.TemporaryDirectory() as folder:
        beside = Path(folder) / "torch.txt"  # pinned by version alone, in no lock
        beside.write_text(torch)
        files = ["-r", "requirements-dev.lock", "-r", str(beside)]
        quietly = ["--no-deps", "--disable-pip", "--progress-spinner", "off", "-f", "json"]
        report = _json([sys.executable, "-m", "pip_audit", *files, *quietly])
    return pip_audit_findings(report)


def pip_audit_findings(report: dict[str, Any]) -> list[AuditFinding]:
    """What pip-audit's report says; a package that could not be asked about is a finding too."""
    found = []
    for package in report["dependencies"]:
        if "skip_reason" in package:
            found.append(
                AuditFinding("pip-audit", "skipped", package["name"], package["skip_reason"])
            )
        for one in package.get("vulns", ()):
            mended = ", ".join(one["fix_versions"]) or "no version"
            words = f"{package['version']}: mended by {mended}"
            found.append(AuditFinding("pip-audit", one["id"], package["name"], words))
    return found


def npm() -> list[AuditFinding]:
    """Advisories about the packages that the page ships with. Raises Unreachable."""
    report = _json(["npm", "audit", "--omit=dev", "--json"], ROOT / "client")
    return npm_findings(report)


def npm_findings(report: dict[str, Any]) -> list[AuditFinding]:
    """What `npm audit` says. Raises Unreachable."""
    if "message" in report:  # of the request, which was refused or got no answer
        raise Unreachable(report["message"])
    if "vulnerabilities" not in report:
        raise RuntimeError(f"npm must audit; got {report}")
    found = [
        AuditFinding("npm", one["url"].rpartition("/")[2], one["name"], one["title"])
        for package in report["vulnerabilities"].values()
        for one in package["via"]
        if isinstance(one, dict)  # a name says that another package of the report has it
    ]
    return sorted(set(found), key=lambda one: (one.where, one.id))


def judge(
    findings: Sequence[AuditFinding], accepted: Sequence[Accepted], asked: set[str]
) -> list[str]:
    """What fails the audit, in words: findings that nothing accepts, and what is accepted of the
    tools that were `asked` though it is not found."""
    wrong = [
        f"{one.tool} {one.id} in {one.where}: {one.words}"
        for one in findings
        if not any(accept.covers(one) for accept in accepted)
    ]
    stale = [
        f"audit.toml accepts {one.tool} {one.id} in {one.where}, which is not found: take it out"
        for one in accepted
        if one.tool in asked and not any(one.covers(finding) for finding in findings)
    ]
    return wrong + stale


def main() -> int:
    """Audit, say what was found, and return the exit status."""
    accepted = read_accepted(ROOT / "audit.toml")
    findings, asked = list[AuditFinding](), set[str]()
    tools: dict[str, Callable[[], list[AuditFinding]]] = {
        "bandit": bandit,
        "pip-audit": pip_audit,
        "npm": npm,
    }
    for name, tool in tools.items():
        try:
            found = tool()
        except Unreachable as error:
            print(f"audit: {name} is SKIPPED, for its advisories cannot be had here: {error}")
            continue
        asked.add(name)
        findings += found
        stand = sum(any(one.covers(finding) for one in accepted) for finding in found)
        print(f"audit: {name} found {len(found)}, of which audit.toml accepts {stand}")
    wrong = judge(findings, accepted, asked)
    for line in wrong:
        print(f"audit: {line}")
    return 1 if wrong else 0


def _dependencies() -> list[str]:
    return tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["dependencies"]


def _ask_pypi(name: str, version: str) -> None:
    """Raise Unreachable unless PyPI tells advisories: pip-audit takes a 404 for a package of
    nobody's, and finds nothing."""
    url = _ADVISORIES.format(name=name, version=version)
    try:
        answer = httpx.get(url, timeout=20.0, follow_redirects=True)
    except httpx.HTTPError as error:
        raise Unreachable(f"{url}: {error}") from error
    if answer.status_code != 200 or "vulnerabilities" not in answer.json():
        raise Unreachable(f"{url} answers {answer.status_code} and tells no advisories")


def _json(command: list[str], folder: Path = ROOT) -> dict[str, Any]:
    """What a command prints, which says by its exit status too that it found something."""
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    try:
        return json.loads(done.stdout)
    except json.JSONDecodeError as error:
        raise RuntimeError(
            f"{command[0]} {' '.join(command[1:4])} must print a report; got status "
            f"{done.returncode} and: {done.stderr.strip() or done.stdout.strip()}"
        ) from error


if __name__ == "__main__":
    sys.exit(main())
