"""How far models of real people are from themselves, by a ruler that no change of capture moves."""
