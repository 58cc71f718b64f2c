"""Meetings recorded as motion, voices and words, by everybody's consent, and shown again."""
