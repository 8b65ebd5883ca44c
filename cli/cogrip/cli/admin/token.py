"""`cogrip token`: the rights to join an encrypted server."""

from cyclopts import App

from cogrip.cli.admin.token_list import token_list
from cogrip.cli.terminal.commands import add_commands

COMMANDS = {
    "new": ("admin.token_new:token_new", "Make a token, and print its join link."),
    "list": ("admin.token_list:token_list", "List the tokens of a server, and their states."),
    "revoke": ("admin.token_revoke:token_revoke", "Revoke tokens, and end the seats that were taken with them."),
    "keys": (
        "admin.token_keys:keys",
        "Keys of tokens that others sign, such as the login of a university: add, list, remove.",
    ),
}

token = App(name="token")
add_commands(token, COMMANDS)
token.default(token_list)
