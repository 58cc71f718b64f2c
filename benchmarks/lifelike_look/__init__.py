"""Live look on lifelike performers, whom cameras of any place show as they truly are."""
