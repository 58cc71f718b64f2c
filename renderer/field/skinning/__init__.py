"""Canonical space and posed space: inverse linear blend skinning."""
