"""Derivatives of a loss: substeps taken again and kept, and led back from their ends to their starts."""
