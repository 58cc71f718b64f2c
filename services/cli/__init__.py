"""The `metanerf` command: by hand what the services do, and the services themselves."""

from services.cli.app import main

__all__ = ["main"]
