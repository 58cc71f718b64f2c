"""Clips on their way in: received in bounded pieces, checked, stored."""
