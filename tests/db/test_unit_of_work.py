"""Nothing happens unless committed, is claimed twice, or is forgotten when a person goes."""

from __future__ import annotations

import threading
from datetime import timedelta
from pathlib import Path

import pytest
from sqlalchemy import text

from db.erase import erase_person
from db.errors import Conflict, DatabaseAway, NotFound
from db.models import JobKind, JobState, ModelRow, SequenceState, new_id
from db.objects import ObstoreObjects
from db.sweep import sweep
from db.unit_of_work import Database
from tests.db.rows import NOW, full_life, job, person, sequence


def test_rolls_back_what_is_not_committed(database: Database):
    with database.unit_of_work() as unit:
        unit.people.add(person())
        unit.flush()
    with database.reading() as unit:
        assert unit.people.of_account("house") == []


def test_rolls_back_on_error(database: Database):
    def fail() -> None:
        with database.unit_of_work() as unit:
            unit.people.add(person())
            unit.flush()
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail()
    with database.reading() as unit:
        assert unit.people.of_account("house") == []


def test_rows_come_back_as_they_went_with_utc_moments(database: Database):
    ada = person()
    ada.height_m = 1.785
    with database.unit_of_work() as unit:
        unit.people.add(ada)
        unit.flush()
        unit.jobs.add(job(ada.id))
        unit.commit()
    with database.reading() as unit:
        found = unit.people.get(ada.id)
        assert (found.name, found.created_at, found.height_m) == ("Ada", NOW, 1.785)
        assert found.created_at.tzinfo is not None


def test_what_is_no_number_is_stored_as_null(database: Database):
    ada = person()
    odd = job(ada.id)
    odd.params = {"loss": float("nan"), "list": [1.0, float("inf")]}
    with database.unit_of_work() as unit:
        unit.people.add(ada)
        unit.flush()
        unit.jobs.add(odd)
        unit.commit()
    with database.reading() as unit:
        assert unit.jobs.get(odd.id).params == {"loss": None, "list": [1.0, None]}


def test_unknown_id_says_what_was_asked_for(database: Database):
    asked = pytest.raises(NotFound, match="id must be that of a person; got 'nobody'")
    with asked, database.reading() as unit:
        unit.people.get("nobody")


def test_the_same_bytes_twice_for_one_person_is_a_conflict(database: Database):
    ada = person()
    with database.unit_of_work() as unit:
        unit.people.add(ada)
        unit.commit()

    def upload() -> None:
        with database.unit_of_work() as unit:
            unit.sequences.add(sequence(ada.id))
            unit.commit()

    upload()
    with pytest.raises(Conflict):
        upload()


def test_each_job_is_claimed_once_oldest_first(database: Database):
    ada = person()
    jobs = [job(ada.id, created_at=NOW + timedelta(seconds=i)) for i in range(8)]
    with database.unit_of_work() as unit:
        unit.people.add(ada)
        unit.flush()
        for one in reversed(jobs):
            unit.jobs.add(one)
        unit.commit()
    with database.unit_of_work() as unit:
        oldest = unit.jobs.claim([JobKind.TRAIN], "first", NOW)
        unit.commit()
    assert oldest is not None
    assert oldest.id == jobs[0].id
    claimed = [oldest.id]

    def worker(name: str) -> None:
        while True:
            with database.unit_of_work() as unit:
                found = unit.jobs.claim([JobKind.TRAIN], name, NOW)
                unit.commit()
            if found is None:
                return
            claimed.append(found.id)

    threads = [threading.Thread(target=worker, args=(str(i),)) for i in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(claimed) == sorted(one.id for one in jobs)


def test_a_training_is_claimed_once_its_clip_is_captured(database: Database):
    ada = person()
    clip = sequence(ada.id)
    clip.state = SequenceState.CAPTURING

    def claimed() -> str | None:
        with database.unit_of_work() as unit:
            found = unit.jobs.claim(list(JobKind), "a", NOW)
            unit.commit()
        return found and found.id

    with database.unit_of_work() as unit:
        unit.people.add(ada)
        unit.flush()
        unit.sequences.add(clip)
        unit.flush()
        training, capture = job(ada.id), job(ada.id, created_at=NOW + timedelta(seconds=1))
        capture.kind = JobKind.CAPTURE
        for one in (training, capture):
            one.sequence_id = clip.id
            unit.jobs.add(one)
        unit.commit()
    assert [claimed(), claimed()] == [capture.id, None]
    with database.unit_of_work() as unit:
        unit.sequences.get(clip.id).state = SequenceState.READY
        unit.commit()
    assert claimed() == training.id


def test_only_the_latest_attempt_may_write(database: Database):
    ada = person()
    with database.unit_of_work() as unit:
        unit.people.add(ada)
        unit.flush()
        unit.jobs.add(job(ada.id))
        unit.commit()
    with database.unit_of_work() as unit:
        first = unit.jobs.claim([JobKind.TRAIN], "a", NOW)
        unit.commit()
    assert first is not None
    late = NOW + timedelta(minutes=1)
    with database.unit_of_work() as unit:
        assert unit.jobs.with_expired_lease(NOW) == []
        (silent,) = unit.jobs.with_expired_lease(late)
        silent.state = JobState.QUEUED
        unit.commit()
    with database.unit_of_work() as unit:
        second = unit.jobs.claim([JobKind.TRAIN], "b", late)
        unit.commit()
    assert second is not None
    assert second.attempt == 2
    with database.unit_of_work() as unit:
        assert not unit.jobs.write(first.id, 1, {"progress": 0.9})
        assert unit.jobs.write(first.id, 2, {"progress": 0.2})
        unit.commit()
    with database.reading() as unit:
        assert unit.jobs.get(first.id).progress == 0.2


def test_erasing_a_person_leaves_nothing_of_theirs_and_all_of_the_others(
    database: Database, objects: ObstoreObjects
):
    ada, bob = full_life(database, objects, "Ada"), full_life(database, objects, "Bob")
    erased = erase_person(database.unit_of_work, objects, ada, "house", NOW)
    assert erased.remaining == 0
    assert erased.deleted_objects == 10
    assert erased.deleted_rows == dict.fromkeys(
        (
            "audit_event",
            "job",
            "model",
            "model_file",
            "motion",
            "performer",
            "person",
            "recording_chunk",
            "recording_export",
            "recording_member",
            "upload",
            "upload_chunk",
        ),
        1,
    ) | {"sequence": 2}
    with database.reading() as unit:
        assert unit.people.count_rows(bob) == 14
        (left,) = [e for e in unit.audit.of_account("house") if e.action == "person.erased"]
        assert ada not in str(left.details)
    assert len(list(objects.list(bob))) == 10
    with database.engine.connect() as connection:
        names = connection.execute(text("SELECT name FROM performer")).scalars().all()
    assert names == ["Bob"]


def test_a_better_model_takes_the_place_of_another_which_goes_once_nobody_needs_it(
    database: Database, objects: ObstoreObjects
):
    ada = full_life(database, objects)
    with database.unit_of_work() as unit:
        (worse,) = unit.models.of_person(ada)
        better = ModelRow(
            id=new_id(), person_id=ada, preset="splats", created_at=NOW, data_hash="", metrics={}
        )
        unit.models.add(better)
        unit.flush()
        (meeting_id,) = unit.models.supersede(worse.id, better, NOW)
        assert unit.models.supersede(new_id(), better, NOW) == []
        unit.commit()
    with database.reading() as unit:
        assert [one.model_id for one in unit.meetings.get(meeting_id).performers] == [better.id]
        assert [one.id for one in unit.models.of_person(ada)] == [better.id]
        assert unit.models.get(worse.id).superseded_at == NOW
    sweep(database.unit_of_work, objects, NOW + timedelta(hours=5))
    with database.reading() as unit:
        assert unit.models.get(worse.id).superseded_at == NOW
    sweep(database.unit_of_work, objects, NOW + timedelta(hours=7))
    with database.reading() as unit, pytest.raises(NotFound):
        unit.models.get(worse.id)


def test_erasing_nobody_is_told(database: Database, objects: ObstoreObjects):
    with pytest.raises(NotFound):
        erase_person(database.unit_of_work, objects, "nobody", "house", NOW)


def test_readers_on_sqlite_wait_for_no_writer(tmp_path: Path):
    database = Database(f"sqlite:///{tmp_path / 'a.db'}")
    database.migrate()
    with database.unit_of_work() as writer, database.reading() as reader:
        writer.people.add(person())
        writer.flush()
        assert reader.people.of_account("house") == []
    database.close()


def test_a_database_that_is_away_is_named_as_such():
    database = Database("postgresql+psycopg://nobody@127.0.0.1:1/none")
    with pytest.raises(DatabaseAway, match="the database must answer"):
        database.ping()
    with pytest.raises(DatabaseAway), database.reading() as unit:
        unit.people.of_account("house")


def test_whoever_hangs_in_a_transaction_holds_nobody_up_for_ever(
    postgres_url: str, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("db.engine.PATIENCE_MS", 300)
    database, ada = Database(postgres_url), person()
    database.migrate()
    with database.unit_of_work() as unit:
        unit.people.add(ada)
        unit.commit()

    def hang_while_another_writes() -> None:
        with database.unit_of_work() as hung:
            hung.people.get(ada.id).name = "hangs"
            hung.flush()
            with database.unit_of_work() as other:
                other.people.get(ada.id).name = "Ada Lovelace"
                other.commit()
            hung.commit()

    with pytest.raises(DatabaseAway, match="idle-in-transaction"):
        hang_while_another_writes()
    with database.reading() as unit:
        assert unit.people.get(ada.id).name == "Ada Lovelace"
    database.close()
