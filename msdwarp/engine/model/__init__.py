"""A scene as constant arrays on a device, and its changing state."""
