"""What becomes of files that are damaged, and of runs that are interrupted."""
