"""The only place where the blocks meet: REST, meetings, workers and the command line."""
