"""An audit fails on what nobody accepted or is accepted in vain, and says what it left out."""

from __future__ import annotations

from pathlib import Path

import pytest

from tools import audit
from tools.audit import Accepted, AuditFinding, Unreachable, judge, npm_findings, pip_audit_findings

PICKLE = AuditFinding("bandit", "B301", "a/b.py", "line 3: pickles")
REASON = "it is read by a reader of ours"


def test_a_finding_fails_unless_it_is_accepted_where_it_is():
    here = Accepted("bandit", "B301", "a/b.py", REASON)
    assert judge([PICKLE], [here], {"bandit"}) == []
    assert judge([PICKLE], [Accepted("bandit", "B301", "*", REASON)], {"bandit"}) == []
    told = judge([PICKLE], [Accepted("bandit", "B301", "a/c.py", REASON)], {"bandit"})
    assert told[0] == "bandit B301 in a/b.py: line 3: pickles"
    assert "accepts bandit B301 in a/c.py, which is not found" in told[1]


def test_what_is_accepted_of_a_tool_that_was_not_asked_stays():
    known = Accepted("pip-audit", "PYSEC-1", "left-pad", REASON)
    assert judge([], [known], {"bandit"}) == []
    assert len(judge([], [known], {"bandit", "pip-audit"})) == 1


@pytest.mark.parametrize(
    ("text", "error", "words"),
    [
        ('tool = "npm"\nid = "GHSA-1"\nwhere = "*"', TypeError, "reason"),
        ('tool = "npm"\nid = "GHSA-1"\nwhere = "*"\nreason = " "', ValueError, "for a reason"),
    ],
)
def test_nothing_is_accepted_without_a_reason(tmp_path: Path, text: str, error, words: str):
    path = tmp_path / "audit.toml"
    path.write_text(f"[[accepted]]\n{text}\n")
    with pytest.raises(error, match=words):
        audit.read_accepted(path)


def test_advisories_of_python_packages_are_read_and_so_is_what_could_not_be_asked():
    report = {
        "dependencies": [
            {"name": "good", "version": "1", "vulns": []},
            {
                "name": "bad",
                "version": "2",
                "vulns": [
                    {"id": "PYSEC-2", "fix_versions": ["3"], "description": "", "aliases": []}
                ],
            },
            {"name": "odd", "skip_reason": "not on PyPI"},
        ]
    }
    assert pip_audit_findings(report) == [
        AuditFinding("pip-audit", "PYSEC-2", "bad", "2: mended by 3"),
        AuditFinding("pip-audit", "skipped", "odd", "not on PyPI"),
    ]


def test_advisories_of_npm_are_read_once_each():
    via = {"name": "bad", "title": "It leaks", "url": "https://github.com/advisories/GHSA-1"}
    report = {"vulnerabilities": {"bad": {"via": [via]}, "user": {"via": ["bad", via]}}}
    assert npm_findings(report) == [AuditFinding("npm", "GHSA-1", "bad", "It leaks")]


def test_a_registry_that_tells_no_advisories_is_said_to_be_skipped(monkeypatch, capsys):
    def away() -> list[AuditFinding]:
        raise Unreachable("405 Method Not Allowed")

    accepted = [Accepted("bandit", PICKLE.id, PICKLE.where, REASON)]
    monkeypatch.setattr(audit, "read_accepted", lambda path: accepted)
    monkeypatch.setattr(audit, "bandit", lambda: [PICKLE])
    monkeypatch.setattr(audit, "pip_audit", away)
    monkeypatch.setattr(audit, "npm", away)
    assert audit.main() == 0
    told = capsys.readouterr().out
    assert "bandit found 1, of which audit.toml accepts 1" in told
    assert "pip-audit is SKIPPED" in told
    assert "npm is SKIPPED" in told
    accepted.clear()
    assert audit.main() == 1
    assert "bandit B301 in a/b.py" in capsys.readouterr().out


def test_npm_that_gets_no_answer_is_skipped_and_npm_that_fails_is_not():
    refused = {"message": "405 Method Not Allowed - POST https://registry.npmjs.org", "error": {}}
    with pytest.raises(Unreachable, match="405 Method Not Allowed"):
        npm_findings(refused)
    with pytest.raises(RuntimeError, match=r"npm must audit; got .*ENOLOCK"):
        npm_findings({"error": {"code": "ENOLOCK", "summary": "no lockfile"}})
