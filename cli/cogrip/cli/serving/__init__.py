"""Commands that serve others: the server with its rooms here, in workers or on a cluster; the gateway; the relay."""
