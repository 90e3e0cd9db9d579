"""The `vpsci` command: one file a group of subcommands, `main.py` puts them together."""
