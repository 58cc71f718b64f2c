"""The gateway that the deployment's servers stand in front of: the one of tests/services."""

from __future__ import annotations

from tests.services.conftest import model_file as model_file
from tests.services.conftest import sequence_folder as sequence_folder
from tests.services.conftest import services as services
from tests.services.conftest import settings as settings
