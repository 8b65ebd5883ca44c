"""Recorded people as devices: `replay:RUN#user=1` and `replay:hand.csv#time=t_s&x=x_m`."""
