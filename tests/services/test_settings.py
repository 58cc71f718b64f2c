"""One flat place of settings; secrets that are none are refused where it matters."""

from __future__ import annotations

import stat
from pathlib import Path

import pytest

from capture.detection.network_files import NetworkSource
from scene.errors import InvalidInput
from services.settings import Settings, load_settings


def test_every_setting_says_what_it_is_for():
    for name, field in Settings.model_fields.items():
        assert field.description, name


def test_environment_sets_by_name(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    monkeypatch.setenv("METANERF_DATA_DIR", str(tmp_path))
    monkeypatch.setenv("METANERF_ICE_SERVERS", '["stun:example.org"]')
    made = load_settings()
    assert made.database_url == f"sqlite:///{tmp_path}/metanerf.db"
    assert made.ice_servers == ["stun:example.org"]


@pytest.mark.parametrize("secret", [None, "short", "change-me-" * 5, "this-is-a-placeholder-" * 3])
def test_production_refuses_placeholder_secrets(secret: str | None, tmp_path: Path):
    with pytest.raises(InvalidInput, match=r"jwt_secret must be .* in production.*openssl rand"):
        load_settings(environment="production", jwt_secret=secret, data_dir=tmp_path)


def test_faults_are_told_by_name_and_value():
    with pytest.raises(InvalidInput, match="port"):
        load_settings(port=99999)


def test_the_embedded_default_keeps_its_own_secret(tmp_path: Path):
    first = load_settings(data_dir=tmp_path).signing_key()
    assert load_settings(data_dir=tmp_path).signing_key() == first
    assert len(first) >= 32
    assert stat.S_IMODE((tmp_path / "jwt_secret").stat().st_mode) == 0o600


def test_a_child_reads_the_same_settings(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    monkeypatch.setenv("METANERF_PORT", "1234")
    made = load_settings(
        data_dir=tmp_path,
        jwt_secret="x" * 40,
        port=4321,
        worker_kinds=["train"],
        pose_model=tmp_path / "a.task",
    )
    environment = made.child_environment()
    for name in list(environment):
        monkeypatch.setenv(name, environment[name])
    assert load_settings() == made


@pytest.mark.parametrize("name", ["pose", "face", "hand"])
def test_a_models_source_follows_the_settings(tmp_path: Path, name: str):
    given = {"": tmp_path / "a.task", "_url": "http://a/b.task", "_sha256": "ab"}
    settings = load_settings(
        data_dir=tmp_path, **{f"{name}_model{part}": value for part, value in given.items()}
    )
    source: NetworkSource = getattr(settings, f"{name}_model_source")()
    assert (source.path, source.url, source.sha256) == tuple(given.values())
    assert source.model.name == name
    assert source.folder.is_relative_to(tmp_path)
