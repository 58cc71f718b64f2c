"""One archive holds everything, comes back whole on either engine, and half of one is refused."""

from __future__ import annotations

import uuid
from datetime import timedelta
from pathlib import Path

import pytest
from sqlalchemy import select

from db import migrations
from db.backup import back_up
from db.errors import ArchiveExpired, BrokenArchive, Conflict, MigrationFailed
from db.models import Base, GatewayRow
from db.objects import ObstoreObjects, open_objects
from db.restore import restore
from db.unit_of_work import Database
from scene.errors import InvalidInput
from tests.db.rows import NOW, full_life
from tests.servers import fresh_database

MONTH = timedelta(days=30)
SQLITE_ALONE = pytest.mark.parametrize("url", ["sqlite"], indirect=True)
"""For what is read of archives alone, whatever database they are of."""
SECRET = b"a secret for tests only, long enough"


def _store(kind: str, folder: Path, request: pytest.FixtureRequest) -> ObstoreObjects:
    """With PostgreSQL goes S3, as when deployed."""
    if kind == "sqlite":
        return open_objects(f"file://{folder}")
    return open_objects(
        f"s3://test/{uuid.uuid4().hex}",
        endpoint=request.getfixturevalue("s3_endpoint"),
        access_key_id="a",
        secret_access_key="b",
    )


def _rows(database: Database) -> dict[str, list[str]]:
    with database.engine.connect() as connection:
        return {
            table.name: sorted(map(repr, connection.execute(select(table))))
            for table in Base.metadata.sorted_tables
        }


def _bytes(objects: ObstoreObjects) -> dict[str, bytes]:
    return {
        f"{owner}/{info.sha256}": b"".join(objects.stream(owner, info.sha256))
        for owner in objects.owners()
        for info in objects.list(owner)
    }


@pytest.mark.parametrize(
    ("kind", "back_on"),
    [
        ("sqlite", "sqlite"),
        pytest.param("sqlite", "postgresql", marks=pytest.mark.server),
        pytest.param("postgresql", "sqlite", marks=pytest.mark.server),
        pytest.param("postgresql", "postgresql", marks=pytest.mark.server),
    ],
)
def test_everything_comes_back_on_either_engine(
    tmp_path: Path, request: pytest.FixtureRequest, kind: str, back_on: str
):
    archive = tmp_path / "all.tar"
    with (
        fresh_database(kind, tmp_path / "from") as url,
        fresh_database(back_on, tmp_path / "to") as empty_url,
    ):
        database, empty = Database(url), Database(empty_url)
        objects = _store(kind, tmp_path / "objects", request)
        back = _store(back_on, tmp_path / "back", request)
        database.migrate()
        for name in ("Ada", "Bo"):
            full_life(database, objects, name)
        made = back_up(database, objects, archive, NOW, MONTH)
        assert (made.objects, made.lost) == (len(_bytes(objects)), ())
        assert sum(made.rows.values()) == sum(map(len, _rows(database).values())) > 0
        assert archive.stat().st_mode & 0o077 == 0
        assert restore(empty, back, archive, NOW + timedelta(days=29)) == made
        assert _rows(empty) == _rows(database)
        assert _bytes(back) == _bytes(objects)
        with pytest.raises(Conflict, match="must be empty to restore into"):
            restore(empty, back, archive, NOW)
        with pytest.raises(Conflict, match="database must be empty"):
            restore(empty, open_objects(f"file://{tmp_path / 'new'}"), archive, NOW)
        database.close()
        empty.close()


@pytest.fixture
def made(database: Database, objects: ObstoreObjects, tmp_path: Path) -> Path:
    full_life(database, objects)
    path = tmp_path / "all.tar"
    back_up(database, objects, path, NOW, MONTH)
    return path


@pytest.fixture
def made_encrypted(database: Database, objects: ObstoreObjects, tmp_path: Path) -> Path:
    full_life(database, objects)
    path = tmp_path / "all.tar.encrypted"
    back_up(database, objects, path, NOW, MONTH, secret=SECRET)
    return path


def test_an_encrypted_archive_shows_nothing_and_comes_back(
    made_encrypted: Path, database: Database, objects: ObstoreObjects, tmp_path: Path
):
    whole = made_encrypted.read_bytes()
    for told in (b"Ada", b"manifest.json", *(one[:20] for one in _bytes(objects).values())):
        assert told not in whole
    assert made_encrypted.stat().st_mode & 0o077 == 0
    empty, back = Database(f"sqlite:///{tmp_path}/new.db"), open_objects(f"file://{tmp_path}/new")
    restore(empty, back, made_encrypted, NOW, secret=SECRET)
    assert (_rows(empty), _bytes(back)) == (_rows(database), _bytes(objects))
    empty.close()


@SQLITE_ALONE
@pytest.mark.parametrize("secret", [None, b"another secret for tests, long enough"])
def test_without_its_key_an_encrypted_archive_is_refused(
    made_encrypted: Path, tmp_path: Path, secret: bytes | None
):
    says = "its key must be named" if secret is None else "got another"
    _is_refused(made_encrypted, tmp_path, InvalidInput, says, secret)


@SQLITE_ALONE
def test_a_plain_archive_is_none_that_was_encrypted(made: Path, tmp_path: Path):
    _is_refused(made, tmp_path, InvalidInput, "must be encrypted where a key is named", SECRET)


@SQLITE_ALONE
@pytest.mark.parametrize("share", [0.001, 0.3, 0.6, 0.999])
def test_half_an_encrypted_archive_is_refused(made_encrypted: Path, tmp_path: Path, share: float):
    whole = made_encrypted.read_bytes()
    made_encrypted.write_bytes(whole[: max(30, int(share * len(whole)))])
    _is_refused(made_encrypted, tmp_path, BrokenArchive, "must be whole", SECRET)


def _is_refused(
    path: Path, folder: Path, kind: type[Exception], says: str, secret: bytes | None = None
) -> None:
    """And leaves nothing behind, so that a whole archive goes in afterwards."""
    empty, objects = Database(f"sqlite:///{folder}/new.db"), open_objects(f"file://{folder}/new")
    with pytest.raises(kind, match=says):
        restore(empty, objects, path, NOW, secret=secret)
    assert objects.owners() == []
    empty.close()


@SQLITE_ALONE
@pytest.mark.parametrize("share", [0.0, 0.3, 0.6, 0.95])
def test_half_an_archive_is_refused(made: Path, tmp_path: Path, share: float):
    whole = made.read_bytes()
    manifest = whole.index(b"manifest.json")
    made.write_bytes(whole[: int(share * manifest)])
    _is_refused(made, tmp_path, BrokenArchive, r"must be (a whole archive|as it was put)")


@SQLITE_ALONE
def test_a_changed_object_or_row_is_refused(made: Path, tmp_path: Path):
    whole = made.read_bytes()
    for before, after in ((b"Ada 3", b"Ada x"), (b'"name":"Ada"', b'"name":"Eve"')):
        assert before in whole
        made.write_bytes(whole.replace(before, after))
        _is_refused(made, tmp_path, BrokenArchive, "other bytes|tables that differ")


@SQLITE_ALONE
def test_an_archive_that_was_to_be_forgotten_is_refused(made: Path, tmp_path: Path):
    empty = Database(f"sqlite:///{tmp_path}/new.db")
    with pytest.raises(ArchiveExpired, match="people who were erased since"):
        restore(empty, open_objects(f"file://{tmp_path}/new"), made, NOW + timedelta(days=31))
    empty.close()


def test_what_is_no_archive_is_refused(tmp_path: Path):
    path = tmp_path / "all.tar"
    for data in (b"", b"no archive", b"x" * 4096):
        path.write_bytes(data)
        _is_refused(path, tmp_path, BrokenArchive, "must be a whole archive")


def test_a_lost_or_damaged_object_is_told_and_the_rest_is_copied(
    database: Database, objects: ObstoreObjects, tmp_path: Path
):
    owner = full_life(database, objects)
    stored = sorted(info.sha256 for info in objects.list(owner))
    objects.delete(owner, stored[0])
    folder = tmp_path / "objects" / owner / stored[1][:2] / stored[1]
    folder.write_bytes(b"rotten")
    made = back_up(database, objects, tmp_path / "all.tar", NOW, MONTH)
    assert made.lost == (f"{owner}/{stored[0]}", f"{owner}/{stored[1]}")
    assert made.objects == len(stored) - 2


class _Erasing(ObstoreObjects):
    """A store in which somebody is erased while it is copied."""

    def __init__(self, objects: ObstoreObjects, erase) -> None:
        self._inner, self._erase = objects, erase

    def stream(self, owner: str, sha256: str):
        if (erase := self._erase) is not None:
            self._erase = None
            erase(owner)
        return self._inner.stream(owner, sha256)


def test_somebody_who_is_erased_meanwhile_is_in_no_archive(
    database: Database, objects: ObstoreObjects, tmp_path: Path
):
    stays, goes = (full_life(database, objects, name) for name in ("Ada", "Bo"))

    def erase(_owner: str) -> None:
        with database.unit_of_work() as unit:
            unit.people.erase(goes)
            unit.commit()
        objects.delete_all(goes)

    path = tmp_path / "all.tar"
    made = back_up(database, _Erasing(objects, erase), path, NOW, MONTH)
    assert (made.lost, made.rows["person"]) == ((), 1)
    assert goes.encode() not in path.read_bytes()
    assert stays.encode() in path.read_bytes()


def test_a_schema_of_another_version_is_refused(url: str, tmp_path: Path, objects: ObstoreObjects):
    database = Database(url)
    with pytest.raises(MigrationFailed, match="got None"):
        back_up(database, objects, tmp_path / "all.tar", NOW, MONTH)
    database.migrate("0011")
    with pytest.raises(
        MigrationFailed, match=f"version {migrations.head()} to be copied; got 0011"
    ):
        back_up(database, objects, tmp_path / "all.tar", NOW, MONTH)
    database.close()


def test_leases_of_gateways_are_neither_kept_nor_in_the_way(
    url: str, objects: ObstoreObjects, tmp_path: Path
):
    def with_a_gateway(at: str) -> Database:
        database = Database(at)
        database.migrate()
        row = GatewayRow(
            id="one", url="https://one.example", renewed_at=NOW, free=1, draining=False
        )
        with database.unit_of_work() as unit:
            unit.gateways.renew(row)
            unit.commit()
        return database

    database = with_a_gateway(url)
    full_life(database, objects)
    path = tmp_path / "all.tar"
    assert "gateway" not in back_up(database, objects, path, NOW, MONTH).rows
    back = with_a_gateway(f"sqlite:///{tmp_path}/new.db")
    restore(back, open_objects(f"file://{tmp_path}/new"), path, NOW)
    with back.reading() as unit:
        assert len(unit.people.of_account("house")) == 1
    for each in (database, back):
        each.close()


def test_an_archive_of_an_earlier_schema_is_brought_to_this_one(
    url: str, objects: ObstoreObjects, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    database = Database(url)
    database.migrate()
    full_life(database, objects)
    migrations.downgrade(url, "0011")
    path = tmp_path / "all.tar"
    with monkeypatch.context() as earlier:
        earlier.setattr(migrations, "head", lambda: "0011")
        assert back_up(database, objects, path, NOW, MONTH).revision == "0011"
    new_url = f"sqlite:///{tmp_path}/new.db"
    empty, back = Database(new_url), open_objects(f"file://{tmp_path}/new")
    restore(empty, back, path, NOW)
    migrations.check(new_url)
    with empty.reading() as unit:
        assert [one.name for one in unit.people.of_account("house")] == ["Ada"]
    for each in (database, empty):
        each.close()
