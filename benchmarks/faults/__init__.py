"""What becomes of meetings, uploads and trainings when parts of a service fail."""
