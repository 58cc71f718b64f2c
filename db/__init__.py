"""Rows and objects: SQL models, migrations, object storage, repositories."""
