"""The WebRTC connections of this process, by what they are for."""
