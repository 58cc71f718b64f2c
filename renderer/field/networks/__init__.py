"""The networks of a field, and the encodings and grids before them."""
