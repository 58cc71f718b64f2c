"""What every benchmark shares: its clock, its measurements on disk, its file of figures."""
