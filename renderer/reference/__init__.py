"""Plain, slow twins that every fast path is tested against."""
