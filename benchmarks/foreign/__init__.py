"""A test set as another program writes it: shares no code with the studio nor with the renderer."""
