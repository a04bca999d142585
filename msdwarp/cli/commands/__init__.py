"""What the commands do, once the app has read their flags: they know nothing of the app."""
