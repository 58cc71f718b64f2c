"""`metanerf backup` and `metanerf restore` by hand, with a folder that forgets old archives."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from typer.testing import CliRunner

from services.cli.app import app
from services.composition import build_services
from services.settings import load_settings
from tests.db.rows import full_life

runner = CliRunner()


def test_a_folder_keeps_the_newest_archives_and_one_of_them_comes_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("METANERF_DATA_DIR", str(tmp_path / "data"))
    services = build_services(load_settings())
    services.database.migrate()
    person_id = full_life(services.database, services.objects)
    folder = tmp_path / "archives"
    folder.mkdir()
    old, other = folder / "metanerf-20200101-000000Z.tar", folder / "metanerf-notes.tar"
    for path in (old, other):
        path.write_bytes(b"an archive")
    made = runner.invoke(app, ["backup", str(folder)])
    assert made.exit_code == 0, made.output
    assert not old.exists()
    assert other.exists()
    (archive,) = set(folder.iterdir()) - {other}
    assert "to be forgotten by" in made.output

    full = runner.invoke(app, ["restore", str(archive)])
    assert full.exit_code == 1
    assert "must be empty to restore into" in str(full.exception)

    monkeypatch.setenv("METANERF_DATA_DIR", str(tmp_path / "new"))
    back = runner.invoke(app, ["restore", str(archive)])
    assert back.exit_code == 0, back.output
    restored = build_services(load_settings())
    with restored.reading() as unit:
        assert unit.people.get(person_id).name == "Ada"
    for each in (services, restored):
        each.close()


def test_a_lost_object_is_named_and_told_by_the_exit_code(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("METANERF_DATA_DIR", str(tmp_path / "data"))
    services = build_services(load_settings())
    services.database.migrate()
    person_id = full_life(services.database, services.objects)
    sha256 = next(iter(services.objects.list(person_id))).sha256
    services.objects.delete(person_id, sha256)
    services.close()
    made = runner.invoke(app, ["backup", str(tmp_path / "all.tar")])
    assert made.exit_code == 1
    assert f"not in the store, or damaged there: {person_id}/{sha256}" in made.output
    assert os.access(tmp_path / "all.tar", os.R_OK)


def test_an_encrypted_archive_needs_its_key_and_is_forgotten_like_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("METANERF_DATA_DIR", str(tmp_path / "data"))
    services = build_services(load_settings())
    services.database.migrate()
    full_life(services.database, services.objects)
    services.close()
    folder, key, other_key = tmp_path / "archives", tmp_path / "key", tmp_path / "other"
    folder.mkdir()
    key.write_text("a key for tests only, long enough to do\n")
    other_key.write_text("another key for tests only, long enough\n")
    old = folder / "metanerf-20200101-000000Z.tar.encrypted"
    old.write_bytes(b"an archive")
    made = runner.invoke(app, ["backup", str(folder), "--key-file", str(key)])
    assert made.exit_code == 0, made.output
    (archive,) = folder.iterdir()
    assert archive.name.endswith("Z.tar.encrypted")
    monkeypatch.setenv("METANERF_DATA_DIR", str(tmp_path / "new"))
    for options, says in (([], "add --key-file"), (["--key-file", str(other_key)], "got another")):
        refused = runner.invoke(app, ["restore", str(archive), *options])
        assert refused.exit_code == 1
        assert says in str(refused.exception)
    back = runner.invoke(app, ["restore", str(archive), "--key-file", str(key)])
    assert back.exit_code == 0, back.output
