"""What arms with motors and encoders share, whatever wire they are on: kinematics, motors, pose, the exchange of frames."""
