"""What msdwarp's speed and accuracy are measured by; run as modules from the project's root, see README.md."""
