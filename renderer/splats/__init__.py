"""Canonical Gaussian splats, skinned by the 24 bones."""
