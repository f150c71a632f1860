"""The verbs of dynreg. These modules alone know the registry and make results."""
