"""What crosses the network: messages, the session and its clock, and the parts of messages."""
