"""Drawing and encoding for viewers: by a thread of the gateway, or in renderers outside it."""
