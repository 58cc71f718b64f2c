"""Splats to pictures: projection, tiles, alpha compositing, and the way back."""
