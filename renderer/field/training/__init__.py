"""A field learnt from a sequence."""
