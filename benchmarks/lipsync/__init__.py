"""Whether a voice is heard when lips are seen to move, by viewers and in recordings."""
