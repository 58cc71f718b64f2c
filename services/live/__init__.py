"""Live meetings: packets, rooms and rendered views over WebRTC."""
