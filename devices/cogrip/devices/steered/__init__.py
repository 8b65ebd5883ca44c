"""SpaceMouse and gamepads: input only. They steer a simulated mass; no force reaches the hand."""
