"""Coarser levels of a model of splats, for who is small on screen or costs too much."""
