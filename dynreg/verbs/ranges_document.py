"""What a query or a diagnosis leaves open, as the file of ranges tells it."""

from collections.abc import Mapping

import numpy as np

from dynreg.data.units import suffix
from dynreg.errors import UsageError, command
from dynreg.evidence.estimate import free_quantities
from dynreg.evidence.gaussian import Gaussian, coordinates
from dynreg.evidence.hypothesis import Coordinates, Hypothesis
from dynreg.evidence.interval import NORMAL_90
from dynreg.extend.carry import Fields
from dynreg.extend.folder_readme import plain_name
from dynreg.extend.plain import step_of
from dynreg.extend.ranges import Carried, Fixed, Open, Quantity, partners, reached, uniform
from dynreg.extend.traced import ENGINE, MODEL, Traced, traced
from dynreg.results.diagnosis import Diagnosis
from dynreg.results.neighbours import Neighbours
from dynreg.results.result import Interval
from dynreg.sim.config import terms_of
from dynreg.sim.effects import Terms, unit_of
from dynreg.sim.robot import Robot
from dynreg.sim.space import Parameter
from dynreg.verbs.posteriors import posterior_of
from dynreg.verbs.simulator import Simulator

OLDER = "correlations are not known: this result is of an older version. Intervals are taken as independent"
NOWHERE = "nothing in the simulator depends on it: a measured input or another entry decides"
UNCLEAR = (
    "No simulator here is clearly better than nominal. These intervals hold only if the model is complete. "
    "A diagnosis of the same log may have another model. Its intervals then differ."
)
WITHOUT = (
    "{effects}: no field of a MuJoCo model does this. The parameters were fitted together with it: without it "
    "they are wrong, maybe worse than nominal. {instead}"
)
INSTEAD = "tep dynreg's engine, which has it"
Answer = Neighbours | Diagnosis


def opened(result: str, answer: Answer, found: Simulator) -> Open:
    """What an answer (of that id) leaves open about the simulator that it made."""
    robot = found.robot
    terms = terms_of(found.config, robot)
    values = robot.space.from_dict(dict(found.config.values))
    told = answer.parameters if isinstance(answer, Diagnosis) else answer.synthesised.parameters
    kept = answer.posterior if isinstance(answer, Diagnosis) else answer.synthesised.posterior
    sizes = _sizes(answer, robot, terms)
    posterior = posterior_of(kept) if kept else _independent(robot, terms, told, sizes)
    ranges = {
        n: (float(low), float(high)) for n, (low, high) in zip(posterior.names, posterior.limits, strict=True)
    }
    does = traced(robot, values, terms, ranges)
    free = _free(robot, terms, posterior, told | sizes, does, query=isinstance(answer, Neighbours))
    flat = np.array([q.draw == "uniform" for q in free], dtype=bool)
    correlations = np.where(flat[:, None] | flat, np.eye(len(free)), posterior.correlations)
    fixed = tuple(
        Fixed(p.name, p.unit, float(value), _why_fixed(answer), p.sets)
        for p, value in zip(robot.space.parameters, values, strict=True)
        if p.name not in posterior.names
    )
    effects = _effects(terms, does, posterior)
    return Open(
        _about(result, answer, found, kept is not None) | _completeness(answer, robot, effects),
        _model(robot, found),
        correlations,
        free,
        fixed,
        effects,
        does,
    )


def _free(
    robot: Robot,
    terms: Terms,
    posterior: Gaussian,
    intervals: Mapping[str, Interval],
    does: Traced,
    query: bool,
) -> tuple[Quantity, ...]:
    """The free quantities, in the posterior's order."""
    parameters = {p.name: p for p in robot.space.parameters}
    whole = posterior.untold if query else ()
    flat = uniform(posterior, whole)
    out = []
    for i, name in enumerate(posterior.names):
        p, own = parameters.get(name), intervals[name]
        effect = None if p else next(t.key for t in terms.terms if name.startswith(f"{t.key}."))
        out.append(
            Quantity(
                name=name,
                unit=own.unit,
                value=own.value,
                interval=(own.low, own.high),
                limits=tuple(posterior.limits[i].tolist()),
                scale=posterior.scales[i],
                centre=float(posterior.centre[i]),
                deviation=float(posterior.deviations[i]),
                draw="uniform" if flat[i] else "normal",
                told=_by(posterior, name, bool(flat[i]), query),
                at_bound=bool(getattr(own, "at_bound", False)),
                nominal=None if p is None else p.nominal,
                effect=effect,
                sets=p.sets if p else (),
                reaches=reached(does, name),
                left_out=_left_out(does, name, effect),
            )
        )
    return tuple(out)


def _left_out(does: Traced, name: str, effect: str | None) -> str | None:
    """Why a quantity that is drawn changes nothing; None where it does."""
    if reached(does, name):
        return None
    return does.held.get(name, does.held.get(effect, (NOWHERE, "")))[0]


def _by(posterior: Gaussian, name: str, flat: bool, query: bool) -> str:
    """By what a quantity is known, in words."""
    if name not in posterior.untold:
        return "by the log"
    if not query:
        return "not by the log: by its tolerance in robot.toml"
    if flat:
        return "not by the log: its interval is its whole range"
    return (
        f"not alone: its interval is its whole range, but it goes with {', '.join(partners(posterior, name))}"
    )


def _sizes(answer: Answer, robot: Robot, terms: Terms) -> dict[str, Interval]:
    """{"payload.share": interval} of the effects' sizes: those of causes, and those that acted from the start."""
    causes = {cause.key: cause.parameters for cause in getattr(answer, "causes", ())}
    kept = getattr(answer, "posterior", None)
    posterior, out = kept and posterior_of(kept), {}
    for term, values in zip(terms.terms, terms.values, strict=True):
        for p, value in zip(term.effect.parameters, values[0], strict=True):
            name, value = f"{term.key}.{p.name}", float(value)
            if p.name in causes.get(term.key, {}):
                out[name] = causes[term.key][p.name]
            elif term.key in causes:
                raise UsageError(
                    f"the result has {term.key} with {sorted(causes[term.key])}, as an earlier version named it",
                    expected=f"its {p.name}",
                    do="diagnose the recording again",
                )
            elif posterior and name in posterior.names:
                sides = [posterior.centre + z * posterior.deviations for z in (-NORMAL_90, NORMAL_90)]
                ends = [float(posterior.values(z)[posterior.names.index(name)]) for z in sides]
                out[name] = Interval(value=value, low=ends[0], high=ends[1], unit=unit_of(robot, term, p))
    return out


def _independent(
    robot: Robot, terms: Terms, told: Mapping[str, Interval], sizes: Mapping[str, Interval]
) -> Gaussian:
    """The posterior of a result that kept none: what its intervals say, each by itself."""
    own = [
        p
        for p in robot.space.parameters
        if p.name in told and told[p.name].low is not None and told[p.name].low < told[p.name].high
    ]
    c = Coordinates(robot, robot.space.nominal)  # of effects alone: all parameters are known
    rows = {
        n: (s, l) for n, s, l in zip(*free_quantities(c, Hypothesis(terms.terms)), strict=True) if n in sizes
    }
    names = (*(p.name for p in own), *rows)
    scales = (*(p.scale for p in own), *(scale for scale, _ in rows.values()))
    limits = np.array([*(_limits(p, told[p.name]) for p in own), *(l for _, l in rows.values())]).reshape(
        -1, 2
    )
    intervals = {**told, **sizes}
    ends = np.array([[getattr(intervals[n], side) for n in names] for side in ("low", "value", "high")])
    low, value, high = coordinates(scales, limits, np.clip(ends.reshape(3, -1), *limits.T))
    # where a range cuts an interval off, its other side tells the deviation
    deviations = np.maximum(value - low, high - value) / NORMAL_90
    whole = tuple(
        n for n, (a, b) in zip(names, zip(low, high, strict=True), strict=True) if (a, b) == (0.0, 1.0)
    )
    return Gaussian(names, scales, limits, value, deviations, np.eye(len(names)), whole)


def _limits(p: Parameter, told: Interval) -> tuple[float, float]:
    return getattr(told, "limits", None) or (p.low, p.high)


def _why_fixed(answer: Answer) -> str:
    if isinstance(answer, Neighbours):
        return "the log tells it"
    return "not fitted: the log tells it, or no rollout shows it"


def _effects(terms: Terms, does: Traced, posterior: Gaussian) -> tuple[Carried, ...]:
    """What has each effect of the simulator."""
    out = []
    for term in terms.terms:
        why, where = does.held.get(term.key, ("", "fields"))
        sizes = [n for n in posterior.names if n.startswith(f"{term.key}.")]
        if not why and not any(reached(does, name) for name in sizes):
            why, where = "its sizes are not free", MODEL
        out.append(Carried(term.key, term.effect.title_at(term.at), where, why))
    return tuple(out)


def _completeness(answer: Answer, robot: Robot, effects: tuple[Carried, ...]) -> dict[str, object]:
    """Whether a MuJoCo model with the draws in its fields is the simulator that was fitted, and why not."""
    apart = [e.key for e in effects if e.carried_by == ENGINE]
    if robot.planar or not apart:
        return {"complete_in_model": not robot.planar}
    instead = f"S{INSTEAD}."
    if isinstance(answer, Diagnosis):
        instead = f"Take the ranges of a query of the same log, or a calibration, or s{INSTEAD}."
    return {
        "complete_in_model": False,
        "incomplete": WITHOUT.format(effects=", ".join(apart), instead=instead),
    }


def _about(result: str, answer: Answer, found: Simulator, correlated: bool) -> dict[str, object]:
    """The facts of the whole file."""
    reliable = answer.reliable if isinstance(answer, Neighbours) else not answer.unexplained
    partly = isinstance(answer, Diagnosis) and answer.verdict == "partly_explained"
    warning = answer.reliance if partly or not reliable else ""
    if isinstance(answer, Diagnosis) and answer.worse:
        warning = f"{warning} The test part is predicted better by {answer.began}.".strip()
    notes = () if correlated else (OLDER,)
    if isinstance(answer, Neighbours) and reliable and answer.unclear:
        warning = UNCLEAR
    if isinstance(answer, Neighbours) and answer.answer_kind != "synthesised":
        notes += (f"the query recommends another simulator, {answer.answer[:12]} ({answer.answer_kind})",)
    return {
        "robot": answer.robot,
        "recording": answer.recording_name,
        "kind": answer.schema_name(),
        "result": result,
        "simulator": found.id,
        "verdict": None if isinstance(answer, Neighbours) else answer.verdict,
        "reliable": reliable,
        "warning": warning or None,
        "correlated": correlated,
        "notes": notes,
    }


def _model(robot: Robot, found: Simulator) -> dict[str, object]:
    """The model to which the assignments belong."""
    if robot.planar:
        return {"problem": f"MuJoCo does not move the robot: its engine is {robot.running()}"}
    ports = Fields.of(robot, robot.space.from_dict(dict(found.config.values))).ports
    timed = robot.file.robot.control_rate is None
    return {
        "file": plain_name(robot),
        "made_by": command("export", found.id[:12], "--as", "robot", "--to", "FOLDER"),
        "control_rate": None if timed else float(ports.control["rate"][0]),
        "timestep": None if timed else step_of(robot, ports),
        "settings": tuple(f"{s.name} = {s.nominal:g}{suffix(s.unit)}" for s in robot.file.settings),
    }
