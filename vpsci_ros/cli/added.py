"""Commands that other Python packages, and the folders of `vpsci_ros/extras/`, add to `vpsci` by entry points."""

from typing import Any

import typer
from typer.core import TyperGroup

from vpsci_ros.runs.plugins import PluginGroup

COMMANDS = PluginGroup("vpsci_ros.commands", "command", typer.Typer, {})
"""Name of a command -> an application of Typer: one command of its own, or a group of several."""


class WithAddedCommands(TyperGroup):
    """The built-in commands, then the added ones; an added one is imported when it is called or shown in the help."""

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names of all commands."""
        return [*super().list_commands(ctx), *COMMANDS.names()]

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return the command named `cmd_name`; None where there is none.

        :raises InvalidInput: what is installed under this name cannot be imported, or is no application of Typer.
        """
        own = super().get_command(ctx, cmd_name)
        if own is not None or cmd_name not in COMMANDS.names():
            return own
        added = COMMANDS.find(cmd_name)
        command: Any = typer.main.get_command(added)
        command.name = cmd_name
        panels = (command.rich_help_panel, added.rich_help_panel)  # typer leaves a group's own out
        command.rich_help_panel = next((panel for panel in panels if isinstance(panel, str)), "Added")
        return command
