"""The store: populations of simulators with their data and models, recordings, results."""
