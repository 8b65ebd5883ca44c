"""Arms on a serial line that speak the hfab bracket-ASCII protocol: Polhem, vintage Phantom, WoodenHaptics."""
