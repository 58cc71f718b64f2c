"""The control channel of a meeting: who is there, who may come in, what they say."""
