"""What is claimed, as commands that anyone can run again; reports name machine and commit."""
