"""Long work: a queue in the database, workers that run each job in a child process, its events."""
