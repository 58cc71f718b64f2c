"""The light a clip was captured in, and people shown in another."""
