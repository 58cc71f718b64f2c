"""Poses of a clip refined by its pixels while splats are trained."""
