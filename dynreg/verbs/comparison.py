"""The result of a comparison, from what was found."""

from collections.abc import Mapping

import numpy as np

from dynreg.compare.compare import Compared
from dynreg.compare.contenders import Made, Plan, Predicts
from dynreg.results.comparison import Comparison, Contender
from dynreg.results.result import Cost
from dynreg.verbs.simulators import Simulator, made
from dynreg.verbs.subjects import Recorded

SHORT = 0.1  # s: the shortest command of the published ones


def document(
    asked: Recorded,
    plan: Plan,
    simulators: Mapping[str, Simulator],
    found: Compared,
    seconds: float,
) -> Comparison:
    """All that was found, with notes. simulators : by the names under which they were compared."""
    fit, validation, test = found.parts
    return Comparison(
        robot=asked.robot.name,
        recording=asked.recording.id,
        recording_name=asked.name,
        parts={"fit": fit.stop, "validation": validation.stop - fit.stop, "test": test.stop - test.start},
        track=found.told.track,
        longest=plan.longest,
        seed=plan.seed,
        starts=plan.starts,
        generations=plan.generations,
        contenders=tuple(_contender(n, c, simulators.get(n)) for n, c in found.contenders.items()),
        best=found.errors.best,
        errors=found.errors,
        paths=found.paths,
        driven=found.driven,
        paces=found.paces,
        notes=(*_seen(asked, simulators, found), *_notes(found)),
        cost=Cost(evaluations=0, rollouts=len(simulators), seconds=seconds),
    )


def _contender(name: str, contender: Predicts, simulator: Simulator | None) -> Contender:
    if isinstance(contender, Made):
        return Contender(name=name, kind=contender.kind, parameters=dict(contender.parameters))
    config = simulator.config
    how = made(simulator.lineage)
    return Contender(
        name=name,
        kind="simulator of a population" if how == "entry" else f"{how} simulator".strip(),
        simulator=simulator.id,
        parameters=dict(config.values),
        effects={key: dict(values) for key, values in config.effects.items()},
    )


def _seen(asked: Recorded, simulators: Mapping[str, Simulator], found: Compared) -> tuple[str, ...]:
    """Which simulators were fitted to episodes that hold commands to test, and to how many of these."""
    names = np.array([e.name for e in asked.recording.episodes])[found.told.episode[found.parts[-1]]]
    out = []
    for name, one in simulators.items():
        if one.fitted_to is None:
            out.append(
                f"{name} was fitted to this recording, and nothing says to which part: it may have seen the"
                " commands to test, which models made here have not"
            )
        elif many := int(np.isin(names, sorted(one.fitted_to)).sum()):
            out.append(
                f"{name} was fitted to episodes of this recording that hold {many} of the {len(names)}"
                " commands to test: it may have seen them, which models made here have not"
            )
    return tuple(out)


def _notes(found: Compared) -> tuple[str, ...]:
    told, out = found.told, []
    if told.left_out:
        out.append(f"commands left out, at whose begin or end no pose was measured: {told.left_out}")
    if told.on_the_way:
        out.append(
            "first commands of episodes left out, because the robot seems to move before them, at speeds that nobody"
            f" knows: {told.on_the_way}"
        )
    usual = float(np.median(told.commands.seconds))
    if usual < SHORT:
        out.append(
            f"half of the commands last {usual:.2g} s or less: what is left of earlier ones than the last is"
            " in no model made here, and ten of them are a short way"
        )
    if found.paths is None:
        out.append("the test part has no ten commands in a row without a gap: no paths are compared")
    return tuple(out)
