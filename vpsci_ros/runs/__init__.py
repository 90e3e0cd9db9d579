"""A run: its parameters, folder, record, whole files and progress."""
