"""`cogrip room`: rooms on demand of a running server."""

from cyclopts import App

from cogrip.cli.admin.room_list import room_list
from cogrip.cli.terminal.commands import add_commands

COMMANDS = {
    "new": ("admin.room_new:room_new", "Open a room of a template, and print its join links."),
    "list": ("admin.room_list:room_list", "List the rooms of a running server."),
    "close": ("admin.room_close:room_close", "Close a room on demand; whoever is in it is sent out."),
}

room = App(name="room")
add_commands(room, COMMANDS)
room.default(room_list)
