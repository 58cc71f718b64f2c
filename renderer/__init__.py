"""Block 3: the models of a person, their training, evaluation, serving and composition."""
