"""Trained models: their files, and the most recently used ones in memory."""

from __future__ import annotations

import tempfile
import threading
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from db.errors import NotFound
from db.models import ModelFileRow, ModelRow
from db.objects import Objects, StoredObject, fetch
from db.unit_of_work import Database
from renderer.performer_model import PerformerModel

WEIGHTS = "model.safetensors"
"""The file of a model that every preset has."""
SPLATS = "splats.ply"
"""The splats as other viewers open them, where the model is made of such."""
VIEWER_FILE = "viewer.splats"
"""The splats as our page draws them, where the model is made of such; its format is that of
`renderer.splats.files.viewer_file`."""


@dataclass(eq=False)
class _Entry:
    person_id: str
    model: PerformerModel


class ModelCache:
    """Loads models and keeps a few. Safe to use from several threads.

    Only memory is a cache: a copy on the local disk would outlive the erasure of its person.
    """

    def __init__(self, database: Database, objects: Objects, size: int) -> None:
        self._database, self._objects, self._size = database, objects, size
        self._entries: OrderedDict[str, _Entry] = OrderedDict()
        self._guard = threading.Lock()
        self._loading: dict[str, threading.Lock] = {}

    def load(self, model_id: str) -> PerformerModel:
        """The model of this id. Raises NotFound, or BrokenModel for a file that can't be read."""
        with self._database.reading() as unit:
            row = unit.models.get(model_id)
        return self.load_row(row)

    def load_row(self, row: ModelRow) -> PerformerModel:
        """The model of a row read already."""
        sha256 = weights_of(row)
        with self._guard:
            if sha256 in self._entries:
                self._entries.move_to_end(sha256)
                return self._entries[sha256].model
            loading = self._loading.setdefault(sha256, threading.Lock())
        with loading:  # two who ask for one model load it once
            with self._guard:
                if sha256 in self._entries:
                    return self._entries[sha256].model
            model = self._read(row.person_id, sha256)
            with self._guard:
                self._entries[sha256] = _Entry(row.person_id, model)
                while len(self._entries) > self._size:
                    self._entries.popitem(last=False)
                self._loading.pop(sha256, None)
        return model

    def forget_person(self, person_id: str) -> None:
        """Drop every model of an erased person."""
        with self._guard:
            gone = [key for key, entry in self._entries.items() if entry.person_id == person_id]
            for key in gone:
                del self._entries[key]

    def forget_erased(self) -> None:
        """Drop every model of those whom another process has erased."""
        with self._guard:
            kept = {entry.person_id for entry in self._entries.values()}
        if not kept:
            return
        with self._database.reading() as unit:
            erased = kept - unit.people.among(kept)
        for person_id in erased:
            self.forget_person(person_id)

    def _read(self, person_id: str, sha256: str) -> PerformerModel:
        from renderer.model_files import load_model

        with tempfile.TemporaryDirectory(prefix="metanerf-model-") as folder:
            path = Path(folder) / WEIGHTS
            fetch(self._objects, person_id, sha256, path)
            return load_model(path)


def write_files(model: PerformerModel, folder: Path) -> list[Path]:
    """Write every file by which `model` is handed out."""
    from renderer.model_files import save_model
    from renderer.splats.files.ply import write_ply
    from renderer.splats.files.viewer_file import write_viewer_file

    files = [folder / WEIGHTS]
    save_model(model, files[0])
    if (splats := model.splats) is not None:
        files += [folder / SPLATS, folder / VIEWER_FILE]
        write_ply(splats, files[1])
        write_viewer_file(splats, files[2])
    return files


def store_files(
    put: Callable[[Path], StoredObject], person_id: str, files: list[Path]
) -> list[ModelFileRow]:
    """Store files by `put`; the rows that point at them."""
    rows = []
    for path in files:
        stored = put(path)
        rows.append(
            ModelFileRow(
                name=path.name, person_id=person_id, bytes=stored.bytes, sha256=stored.sha256
            )
        )
    return rows


def weights_of(row: ModelRow) -> str:
    """sha256 of the model's weights."""
    for file in row.files:
        if file.name == WEIGHTS:
            return file.sha256
    raise NotFound(f"model must have a file {WEIGHTS!r}; got {[f.name for f in row.files]}")
