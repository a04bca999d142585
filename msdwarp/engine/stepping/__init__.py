"""What advances a state: effects assembled, stages launched, substeps taken."""
