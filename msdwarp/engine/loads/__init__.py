"""What else acts on particles: forces, wind, pressure, drives, attachments, actuators."""
