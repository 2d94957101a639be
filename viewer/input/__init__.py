"""From devices to requests: keyboard, gamepad and scripts become one `Intent` per frame."""
