"""Block 3: the models of a person, their training, evaluation, serving and composition."""

import scene  # noqa: F401 - says how threads wait, before numpy is first imported
