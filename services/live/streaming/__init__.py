"""What goes out to viewers and listeners: pictures, poses, voices, shared screens."""
