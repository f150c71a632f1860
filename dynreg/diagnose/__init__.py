"""Diagnose: name the physical causes that a simulator lacks, and say how sure that is."""
