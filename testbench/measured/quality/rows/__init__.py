"""What rows say of each other: grid and noise of a column, curves through the neighbours."""
