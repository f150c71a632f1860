"""The room of a diagnosis: its words, its tables and its page."""

from dynreg.report.diagnosis.drawn import page
from dynreg.report.diagnosis.text import tables
from dynreg.report.diagnosis.words import hint

__all__ = ["hint", "page", "tables"]
