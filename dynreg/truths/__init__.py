"""Hidden robots by physics of their own, for trials: nothing here comes from the simulators that are judged by them."""
