"""Arms over USB HID that speak the Haptikfabriken/WoodenHaptics reports, one each way a millisecond."""
