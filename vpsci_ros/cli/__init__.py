"""The `vpsci` command: a file for each group of subcommands; `main.py` joins them."""
