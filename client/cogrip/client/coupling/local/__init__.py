"""Contact with what stands fast, rendered at the client itself (`coupling.kind = "local"`), in front of a wave line."""
