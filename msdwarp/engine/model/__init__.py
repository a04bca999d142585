"""A scene as arrays on a device, and the state that moves."""
