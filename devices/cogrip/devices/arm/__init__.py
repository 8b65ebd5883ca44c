"""Parts that all arms with motors and encoders share, whatever their wire: kinematics, motors, pose, the exchange of frames."""
