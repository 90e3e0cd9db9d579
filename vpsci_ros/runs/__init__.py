"""What a run is: its parameters, its folder, its record, whole files, and what is seen of it while it runs."""
