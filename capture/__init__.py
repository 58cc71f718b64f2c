"""Block 1: from a clip of one camera to a `Sequence`, and the studio that makes exact truth."""
