"""Live look: pictures of themselves that people send with their motion."""
