"""A gateway on a real port, as the control channel's tests have it."""

from tests.services.control.conftest import app as app
from tests.services.control.conftest import caller as caller
from tests.services.control.conftest import clock as clock
from tests.services.control.conftest import meeting as meeting
from tests.services.control.conftest import timed as timed
