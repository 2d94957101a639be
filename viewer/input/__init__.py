"""Devices to wishes: keyboard, gamepad and scripts become one `Intent` per frame."""
