"""Parameters and physical causes together, by a diagnosis."""

import numpy as np

from dynreg.diagnose.account import Account, with_account
from dynreg.diagnose.diagnose import Diagnosed, diagnose
from dynreg.diagnose.options import DiagnosisOptions
from dynreg.evidence.lockstep import counted, run
from dynreg.methods.answer import Answer, Version
from dynreg.methods.calibrator import Evidence, Limits, Question, episodes_of
from dynreg.methods.judged import saw
from dynreg.sim.config import SimConfig, effects_of


class ByDiagnosis:
    """The calibrated simulator, and that with the causes that the diagnosis names; their number sets what it spends."""

    def fit(self, question: Question, evidence: Evidence, limits: Limits) -> Answer:
        """One version or two. Raises as `diagnose.diagnose`."""
        data = question.data
        start = None if question.start is None else SimConfig.of(data.robot, question.start)
        options = DiagnosisOptions(hold_out=question.hold_out, seed=limits.seed, threads=limits.threads)
        search = diagnose(
            data.robot, data.recording, options, start, cache=evidence.cache, progress=limits.progress
        )
        (made, seen), rollouts = run(counted(with_account(search, options)), threads=limits.threads)
        versions: list[Version] = []
        posed = made.problem.data
        for kind, (values, terms) in seen.simulators.items():
            parent = len(versions) - 1 if versions else None
            made_of = effects_of(terms)
            versions.append(Version(kind, values, parent, episodes_of(question), effects=made_of))
        return Answer(
            tuple(versions),
            made.verdict,
            rollouts,
            None,  # most of them run through some windows only
            intervals=_intervals(made, seen),
            causes=tuple(versions[-1].effects),
            saw=saw(data, posed.windows, posed.parts.chosen),
            free=np.isin(np.arange(len(data.robot.space)), made.found.model.coordinates.free),
        )


def _intervals(made: Diagnosed, seen: Account) -> dict[str, tuple[float, float]]:
    """{parameter: (low, high)} of 90 % of those that were fitted, the fitted value inside."""
    c, point = made.found.model.coordinates, made.found.current
    names = made.problem.model.robot.space.names
    value = c.values(np.clip(point.nominal, *c.nominal_bounds.T))
    low, high = seen.draws.quantiles(c.values(seen.draws.z[:, : len(point.nominal)]))
    return {names[i]: (float(min(low[i], value[i])), float(max(high[i], value[i]))) for i in c.free}
