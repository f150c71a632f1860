"""Frozen results: what every verb answers, with a JSON form (`schemas/`) and tables for notebooks."""

from dynreg.results.calibration import Calibration, CalibrationStep
from dynreg.results.diagnosis import (
    Cause,
    Diagnosis,
    DiagnosisTrace,
    EffectEstimate,
    Inseparable,
    Looked,
    Moved,
    Noise,
    Pulled,
    Ranked,
    ResidualShare,
    RolloutError,
    Threshold,
    Where,
    cause_key,
)
from dynreg.results.experiment import Experiment, LimitKept
from dynreg.results.library import EffectRow, EffectSize, EffectsList
from dynreg.results.neighbours import (
    ChannelError,
    Neighbour,
    Neighbours,
    Nominal,
    Stage,
    Synthesised,
    Trace,
)
from dynreg.results.result import Cost, Estimate, Gain, Result
from dynreg.results.robot_folder import CarriedEffect, RobotFolder
from dynreg.results.sentence import diagnosis_sentence
from dynreg.results.stored import EntrySummary, Listing, PopulationSummary, RecordingSummary, Verification
from dynreg.results.trials import Confusion, Rate, TrialGroup, TrialResult, TrialTable, rate

RESULTS: tuple[type[Result], ...] = (
    Neighbours,
    PopulationSummary,
    RecordingSummary,
    EntrySummary,
    Listing,
    Verification,
    Calibration,
    Diagnosis,
    EffectsList,
    TrialResult,
    TrialTable,
    Experiment,
    RobotFolder,
)

__all__ = [
    "RESULTS",
    "Calibration",
    "CalibrationStep",
    "CarriedEffect",
    "Cause",
    "ChannelError",
    "Confusion",
    "Cost",
    "Diagnosis",
    "DiagnosisTrace",
    "EffectEstimate",
    "EffectRow",
    "EffectSize",
    "EffectsList",
    "EntrySummary",
    "Estimate",
    "Experiment",
    "Gain",
    "Inseparable",
    "LimitKept",
    "Listing",
    "Looked",
    "Moved",
    "Neighbour",
    "Neighbours",
    "Noise",
    "Nominal",
    "PopulationSummary",
    "Pulled",
    "Ranked",
    "Rate",
    "RecordingSummary",
    "ResidualShare",
    "Result",
    "RobotFolder",
    "RolloutError",
    "Stage",
    "Synthesised",
    "Threshold",
    "Trace",
    "TrialGroup",
    "TrialResult",
    "TrialTable",
    "Verification",
    "Where",
    "cause_key",
    "diagnosis_sentence",
    "rate",
]
