"""The only place where the blocks meet: REST, meetings, workers and the command line."""

import scene  # noqa: F401 - says how threads wait, before numpy is first imported
