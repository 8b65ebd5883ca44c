"""Omega, delta, sigma, lambda and the Novint Falcon through the package `forcedimension_core`, which needs the vendor's SDK."""
