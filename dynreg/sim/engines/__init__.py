"""What advances many simulators at once; every engine is a function of the same signature."""
