"""Effects of loads: forces, wind, pressure, drives, attachments, actuators, and their work."""
