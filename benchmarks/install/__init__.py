"""What the code weighs: packages, the plain user's install, start-up, lines and knobs."""
