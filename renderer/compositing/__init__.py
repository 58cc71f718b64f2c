"""What surrounds the performers, and pictures as an encoder takes them."""
