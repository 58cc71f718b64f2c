"""Splats as files: tensors of a model file, .ply, and the viewer's own format."""
