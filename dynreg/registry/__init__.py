"""The store: populations of simulators with their data and models, recordings, results."""

from dynreg.registry.collecting import Unneeded, collect
from dynreg.registry.comparing import Fault, VerifyReport
from dynreg.registry.exporting import export
from dynreg.registry.files import write_file
from dynreg.registry.importing import Imported, open_source, take_in
from dynreg.registry.infos import RecordingInfo, ResultRecord, RobotInfo
from dynreg.registry.mapped import MappedModels
from dynreg.registry.records import (
    EntryRecord,
    MeasuredEntry,
    PopulationArrays,
    PopulationRecord,
    ShardData,
)
from dynreg.registry.registry import Registry
from dynreg.registry.removing import Removal, removal, remove
from dynreg.registry.server import persistent
from dynreg.registry.verifying import rebuild, verify

__all__ = [
    "EntryRecord",
    "Fault",
    "Imported",
    "MappedModels",
    "MeasuredEntry",
    "PopulationArrays",
    "PopulationRecord",
    "RecordingInfo",
    "Registry",
    "Removal",
    "ResultRecord",
    "RobotInfo",
    "ShardData",
    "Unneeded",
    "VerifyReport",
    "collect",
    "export",
    "open_source",
    "persistent",
    "rebuild",
    "removal",
    "remove",
    "take_in",
    "verify",
    "write_file",
]
