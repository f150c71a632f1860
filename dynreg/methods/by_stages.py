"""Parameters in stages, by a plan: paper E's way."""

import numpy as np

from dynreg.adapt.plan import LOSS_UNITS, resolved
from dynreg.adapt.staged import staged, within
from dynreg.methods.answer import Answer, Version
from dynreg.methods.calibrator import Evidence, Limits, Question
from dynreg.methods.losses import loss_of
from dynreg.replay.windows import Replayer
from dynreg.rng import stream


class Staged:
    """Each stage fits its own parameters to its own recordings; see `adapt.plan`."""

    def fit(self, question: Question, evidence: Evidence, limits: Limits) -> Answer:
        """One version for each stage. Raises UsageError for a plan that does not fit the robot or the recording."""
        data = question.data
        space, replayer = data.robot.space, Replayer(data.robot, data.windows, limits.threads)
        episode = [data.recording.episodes[i].name for i in data.windows.episode]
        stages = resolved(evidence.plan, space.names, ~question.free, episode, data.parts.chosen)
        generations = within(stages, limits.simulations)
        losses = [loss_of(stage, data, replayer) for stage in stages]
        found = staged(
            stages,
            losses,
            question.begin,
            lambda name: stream(limits.seed, "staged", data.robot.name, name),
            fitted=question.fitted,
            generations=generations,
            journal=limits.journal,
            progress=limits.progress,
        )
        window = (data.windows.measured.shape[1] - 1) * data.windows.period
        versions = tuple(
            Version(
                stage.table.name,
                data.values_of(one.unit),
                number - 1 if number else None,
                tuple(dict.fromkeys(episode[w] for w in loss.windows)),
                one.first,
                one.last,
                history=one.history,
                unit=LOSS_UNITS[stage.table.loss],
            )
            for number, (stage, loss, one) in enumerate(zip(stages, losses, found, strict=True))
        )
        whole = generations == [s.table.generations for s in stages]
        early = next((one.ended for one in found if one.ended == "converged"), None)
        return Answer(
            versions,
            early or ("plan" if whole else "budget"),
            sum(one.evaluations for one in found),
            sum(
                one.evaluations * len(loss.windows) * window for loss, one in zip(losses, found, strict=True)
            ),
            resumed=sum(one.resumed for one in found),
            free=np.isin(np.arange(len(space)), np.concatenate([stage.parameters for stage in stages])),
        )
