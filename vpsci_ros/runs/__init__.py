"""A run: its parameters, folder, record, atomic file writes and progress."""
