"""The store: populations of simulators with their data and models, recordings, results."""

from dynreg.registry.comparing import Fault, VerifyReport
from dynreg.registry.exporting import export
from dynreg.registry.files import write_file
from dynreg.registry.records import (
    EntryRecord,
    PopulationArrays,
    PopulationRecord,
    RecordingInfo,
    ResultRecord,
    ShardData,
)
from dynreg.registry.registry import Registry
from dynreg.registry.verifying import verify

__all__ = [
    "EntryRecord",
    "Fault",
    "PopulationArrays",
    "PopulationRecord",
    "RecordingInfo",
    "Registry",
    "ResultRecord",
    "ShardData",
    "VerifyReport",
    "export",
    "verify",
    "write_file",
]
