"""Uploaded clips: buffered on disk, checked, stored."""
