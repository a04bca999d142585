"""Devices, arrays in their memory, and the threads of a CPU."""
