"""`cogrip token`: who may come in."""

from cyclopts import App

from cogrip.cli.admin.token_list import token_list

COMMANDS = {
    "new": ("cogrip.cli.admin.token_new:token_new", "Make a token, and print its join link."),
    "list": ("cogrip.cli.admin.token_list:token_list", "List the tokens of a server, and what has become of them."),
    "revoke": (
        "cogrip.cli.admin.token_revoke:token_revoke",
        "Let nobody in by these tokens any more, and end their seats.",
    ),
}

token = App(name="token", help="Tokens: who may come into a sealed server.")
for _name, (_target, _help) in COMMANDS.items():
    token.command(_target, name=_name, help=_help)
token.default(token_list)
