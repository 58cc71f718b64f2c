"""The schema's history: one for SQLite and PostgreSQL, run at every start."""

from db.migrations.runner import check, downgrade, head, migrate

__all__ = ["check", "downgrade", "head", "migrate"]
