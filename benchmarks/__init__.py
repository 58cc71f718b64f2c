"""What is claimed, as commands that anyone can run again; reports name machine and commit."""

# before any benchmark loads numba or torch, which read OpenMP's wait policy once: threads that spin
# would be counted to whatever is timed after a picture
import renderer as renderer
