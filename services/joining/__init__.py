"""Joining a meeting from the command line: a clip of a person in the place of their webcam."""
