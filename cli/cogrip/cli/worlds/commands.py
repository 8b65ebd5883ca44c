"""`cogrip worlds`: the commands for worlds of one's own."""

from cyclopts import App

from cogrip.cli.terminal.commands import add_commands
from cogrip.cli.worlds.listing import world_list

COMMANDS = {
    "list": ("worlds.listing:world_list", "List the kinds of object, and where each comes from."),
    "check": ("worlds.check:world_check", "Run the conformance suite on one world, or tell what becomes of a scene."),
}

worlds = App(name="worlds")
add_commands(worlds, COMMANDS)
worlds.default(world_list)
