"""Dynamics models: MLPs trained by the thousand from one base, and their losses on any data set."""
