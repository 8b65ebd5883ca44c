"""Advice on settings before anybody holds a device."""
