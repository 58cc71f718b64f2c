"""Splats learnt from a sequence."""
