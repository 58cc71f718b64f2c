"""One history for both databases, equal to the models, safe when processes start at once."""

from __future__ import annotations

import multiprocessing
from datetime import UTC, datetime

import pytest
from sqlalchemy import inspect, select, text
from sqlalchemy.orm import Session

from db import migrations
from db.engine import make_engine
from db.errors import MigrationFailed
from db.models import Base, PersonRow, Purpose
from db.objects import ObstoreObjects
from db.unit_of_work import Database
from tests.db.rows import full_life


def _tables(url: str) -> set[str]:
    engine = make_engine(url)
    names = set(inspect(engine).get_table_names())
    engine.dispose()
    return names - {"alembic_version"}


def test_history_gives_the_models_and_goes_back_to_nothing(url: str):
    migrations.migrate(url)
    migrations.check(url)
    assert _tables(url) == set(Base.metadata.tables)
    migrations.downgrade(url, "base")
    assert _tables(url) == set()
    migrations.migrate(url)
    migrations.check(url)


def _keys(url: str) -> dict[str, list[tuple[object, ...]]]:
    """The primary keys of all rows, by table, whatever the schema is."""
    engine = make_engine(url)
    about = inspect(engine)
    keys = {one: about.get_pk_constraint(one)["constrained_columns"] for one in _tables(url)}
    found = {}
    with engine.connect() as connection:
        for table, columns in keys.items():
            rows = connection.execute(text(f"SELECT {', '.join(columns)} FROM {table}"))
            found[table] = sorted(map(tuple, rows))
    engine.dispose()
    return found


def test_a_whole_life_goes_back_step_by_step_and_comes_again(url: str, objects: ObstoreObjects):
    migrations.migrate(url)
    database = Database(url)
    for name in ("Ada", "Bo"):
        full_life(database, objects, name)
    database.close()
    whole = _keys(url)
    assert {table for table, rows in whole.items() if not rows} == {"gateway"}
    # seats of the first schema, which nothing renewed, are given up by the second
    back = [f"{number:04}" for number in range(int(migrations.head()) - 1, 1, -1)]
    left = {}
    for revision in back:
        migrations.downgrade(url, revision)
        left = _keys(url)
        # what a table of that time knows, none of its rows is lost
        assert left == {table: whole[table] for table in left}, revision
    assert {"person", "sequence", "model", "meeting", "participant", "audit_event"} <= left.keys()
    migrations.migrate(url)
    migrations.check(url)
    assert {table: rows for table, rows in _keys(url).items() if rows} == left
    engine = make_engine(url)
    with Session(engine) as session:
        ada = session.scalars(select(PersonRow).where(PersonRow.name == "Ada")).one()
        # as everybody's was before there were consents
        assert ada.consents_to(Purpose.RECORDINGS, datetime.now(UTC))
    engine.dispose()


def test_check_notices_a_column_that_is_missing(url: str):
    migrations.migrate(url)
    engine = make_engine(url)
    with engine.begin() as connection:
        connection.execute(text("ALTER TABLE person DROP COLUMN name"))
    engine.dispose()
    with pytest.raises(MigrationFailed, match="name"):
        migrations.check(url)


def test_a_newer_database_is_refused_with_its_revision(url: str):
    migrations.migrate(url)
    engine = make_engine(url)
    with engine.begin() as connection:
        connection.execute(text("UPDATE alembic_version SET version_num = '9999'"))
    engine.dispose()
    with pytest.raises(MigrationFailed, match=r"9999.*newer version"):
        migrations.migrate(url)


def test_processes_that_start_together_don_t_race(url: str):
    context = multiprocessing.get_context("spawn")
    with context.Pool(3) as pool:
        pool.map(migrations.migrate, [url] * 3)
    migrations.check(url)


def test_people_from_before_heights_have_none(url: str):
    migrations.migrate(url)
    migrations.downgrade(url, "0008")
    engine = make_engine(url)
    ada = (
        "INSERT INTO person (id, account, name, created_at) VALUES ('a', 'b', 'Ada', '2026-01-01')"
    )
    with engine.begin() as connection:
        connection.execute(text(ada))
    migrations.migrate(url)
    with engine.begin() as connection:
        found = connection.execute(text("SELECT name, height_m FROM person")).one()
    engine.dispose()
    assert (found.name, found.height_m) == ("Ada", None)


def test_performers_from_before_places_face_the_others_as_they_were_captured(url: str):
    migrations.migrate(url)
    migrations.downgrade(url, "0010")
    engine = make_engine(url)
    with engine.begin() as connection:
        for statement in (
            "INSERT INTO person (id, account, name, created_at) VALUES ('a', 'b', 'Ada', "
            "'2026-01-01')",
            "INSERT INTO model (id, person_id, preset, created_at, data_hash, metrics) VALUES "
            "('m', 'a', 'splats', '2026-01-01', '', '{}')",
            "INSERT INTO meeting (id, account, name, created_at, lobby, environment) "
            "VALUES ('r', 'b', 'Room', '2026-01-01', false, 'studio')",
            # captured turned by 0.3 rad, on the left of the old circle and alone in its middle
            "INSERT INTO performer (id, meeting_id, person_id, model_id, name, place, x_m, y_m, "
            "z_m, yaw_rad) VALUES ('p', 'r', 'a', 'm', 'Ada', 0, -1.0, 0.0, 0.0, 1.2707963267949)",
            "INSERT INTO performer (id, meeting_id, person_id, model_id, name, place, x_m, y_m, "
            "z_m, yaw_rad) VALUES ('q', 'r', 'a', 'm', 'Ada', 1, 0.0, 0.0, 0.0, -0.3)",
        ):
            connection.execute(text(statement))
    migrations.migrate(url)
    migrations.check(url)
    with engine.begin() as connection:
        found = connection.execute(
            text("SELECT front_yaw_rad, eye_height_m FROM performer ORDER BY id")
        ).all()
    migrations.downgrade(url, "0010")
    engine.dispose()
    assert [tuple(row) for row in found] == [pytest.approx((-0.3, 1.6)), pytest.approx((-0.3, 1.6))]


def test_whoever_waited_in_the_lobby_before_the_rename_still_waits(url: str):
    migrations.migrate(url)
    migrations.downgrade(url, "0009")
    engine = make_engine(url)
    with engine.begin() as connection:
        connection.execute(
            text(
                "INSERT INTO meeting (id, account, name, created_at, lobby, environment) "
                "VALUES ('m', 'a', 'Room', '2026-01-01', true, 'studio')"
            )
        )
        connection.execute(
            text(
                "INSERT INTO participant (id, meeting_id, account, display_name, seat, joined_at, "
                "seen_at, standing) "
                "VALUES ('p', 'm', 'a', 'Bo', 0, '2026-01-01', '2026-01-01', 'waiting')"
            )
        )
    migrations.migrate(url)
    migrations.check(url)
    with engine.begin() as connection:
        assert connection.execute(text("SELECT admission FROM participant")).scalar() == "waiting"
        # what leaves it out is let in, as before
        connection.execute(
            text(
                "INSERT INTO participant (id, meeting_id, account, display_name, seat, joined_at, "
                "seen_at) VALUES ('q', 'm', 'a', 'Cy', 1, '2026-01-01', '2026-01-01')"
            )
        )
    migrations.downgrade(url, "0009")
    with engine.begin() as connection:
        kept = connection.execute(text("SELECT id, standing FROM participant ORDER BY id")).all()
    engine.dispose()
    assert [tuple(row) for row in kept] == [("p", "waiting"), ("q", "admitted")]


def test_a_meeting_from_before_there_were_sealed_ones_is_not_sealed(url: str):
    migrations.migrate(url)
    migrations.downgrade(url, "0014")
    engine = make_engine(url)
    with engine.begin() as connection:
        connection.execute(
            text(
                "INSERT INTO meeting (id, account, name, created_at, lobby, invitation, "
                "environment) VALUES ('m', 'a', 'Room', '2026-01-01', true, 0, 'studio')"
            )
        )
    migrations.migrate(url)
    migrations.check(url)
    with engine.begin() as connection:
        sealed = connection.execute(text("SELECT sealed FROM meeting")).scalar()
    engine.dispose()
    assert bool(sealed) is False


def test_a_meeting_from_before_invitations_keeps_who_is_in_it_both_ways(url: str):
    migrations.migrate(url)
    migrations.downgrade(url, "0011")
    engine = make_engine(url)
    with engine.begin() as connection:
        for statement in (
            "INSERT INTO meeting (id, account, name, created_at, lobby, environment) "
            "VALUES ('m', 'a', 'Room', '2026-01-01', true, 'studio')",
            "INSERT INTO participant (id, meeting_id, account, display_name, seat, joined_at, "
            "seen_at) VALUES ('p', 'm', 'a', 'Bo', 0, '2026-01-01', '2026-01-01')",
        ):
            connection.execute(text(statement))
    migrations.migrate(url)
    migrations.check(url)
    with engine.begin() as connection:
        assert connection.execute(text("SELECT invitation FROM meeting")).scalar() == 0
    migrations.downgrade(url, "0011")
    with engine.begin() as connection:
        kept = connection.execute(text("SELECT meeting_id FROM participant")).all()
    engine.dispose()
    assert [tuple(row) for row in kept] == [("m",)]


def test_people_from_before_consents_have_the_consent_that_was_everybodys(url: str):
    migrations.migrate(url)
    migrations.downgrade(url, "0012")
    engine = make_engine(url)
    with engine.begin() as connection:
        for key, account in (("a", "house"), ("b", "guest"), ("c", "guest-1")):
            connection.execute(
                text(
                    "INSERT INTO person (id, account, name, created_at) "
                    f"VALUES ('{key}', '{account}', 'Ada', '2026-01-01')"
                )
            )
    migrations.migrate(url)
    migrations.check(url)
    with Session(engine) as session:
        people = {one.id: one for one in session.scalars(select(PersonRow))}
    usual = {Purpose.MEETINGS, Purpose.RECORDINGS}
    given = {
        key: {purpose for purpose in Purpose if one.consents_to(purpose, datetime.now(UTC))}
        for key, one in people.items()
    }
    # the demo's people are moved by every guest, as before
    assert given == {"a": usual, "b": usual | {Purpose.DRIVING}, "c": usual}
    migrations.downgrade(url, "0012")
    with engine.begin() as connection:
        kept = connection.execute(text("SELECT id FROM person ORDER BY id")).scalars().all()
    engine.dispose()
    assert list(kept) == ["a", "b", "c"]
