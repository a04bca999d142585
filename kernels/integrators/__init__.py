"""Integration methods: the composition of kernels, and the stages of methods."""
