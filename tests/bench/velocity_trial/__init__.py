"""Velocity estimators compared: on recorded hands as each device's encoders see them, and in whole sessions."""
