"""The schema's history: one for SQLite and PostgreSQL, run at every start."""

from db.migrations.runner import check, downgrade, migrate

__all__ = ["check", "downgrade", "migrate"]
