"""What dynreg can be asked to do: the only rooms that know the registry, and that make Results."""
