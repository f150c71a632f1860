"""Diagnose: what a simulator gets wrong, the causes by name, the extended simulator, and what it gains."""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from dynreg.data.names import quantity_of
from dynreg.data.recording import Recording
from dynreg.diagnose.evidence import Evidence, verdict_of
from dynreg.diagnose.fit import fit, polish
from dynreg.diagnose.hypothesis import Coordinates, single_terms
from dynreg.diagnose.joints import fixed_unseen, only_joints, terms_at
from dynreg.diagnose.name import DRAWS, Naming, calibrate, name_one
from dynreg.diagnose.outcome import outcome
from dynreg.diagnose.problem import Point, Problem
from dynreg.diagnose.settings import Settings
from dynreg.diagnose.settle import revise, settle, unlike
from dynreg.diagnose.shortlist import MANY
from dynreg.diagnose.shown import shown
from dynreg.diagnose.threshold import Calibrated, threshold
from dynreg.diagnose.zeros import rezeroed
from dynreg.errors import LogError, NoMatchError, UsageError
from dynreg.registry import Registry
from dynreg.replay.cut import windows
from dynreg.replay.holes import hit, holes, sentence
from dynreg.replay.known import known_values
from dynreg.replay.parts import Parts, parts, thinned
from dynreg.replay.windows import Windows
from dynreg.results import Diagnosis
from dynreg.sim.effects import Term
from dynreg.sim.engines import rollout
from dynreg.sim.robot import Robot, require_commands

LONGEST = 10.0  # s of a rollout, where the robot states no horizon
FEWEST = 50  # measured rows in each of fit and select: fewer say nothing of any cause
ZEROED = 2  # times that the zeros of episodes and the simulator are fitted in turn after each cause
ENDED = 2  # iterations of the last refit where rollouts are rough: each simulates the finer time step
STANDS = 0.05  # rad (m) by which joints may differ from the settled reset pose
STILL = 3.0  # standard deviations of its noise that a channel must move to say anything
Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class Found:
    """What the search for causes came to: points of the calibrated and the extended simulator, round by round.

    problem : the one that `extended` was fitted in, with its zeros of the episodes.
    """

    base: Point
    extended: Point
    rounds: tuple[Naming, ...]
    accepted: int
    threshold: Calibrated
    problem: Problem


def diagnose(
    registry: Registry,
    robot: Robot,
    recording: Recording,
    settings: Settings,
    *,
    name: str = "",
    progress: Progress | None = None,
) -> Diagnosis:
    """Name what `robot`'s simulator lacks to move as the recording says.

    Fit, select and test are disjoint by trajectory; test is read once, for gain and error.
    Raises LogError where the recording cannot say anything: too short, nothing moves, no commands, one window only;
    UsageError where the settings do not fit the robot or the recording.
    """
    began = time.perf_counter()
    problem, split = pose(registry, robot, recording, settings)
    fit_on, select_on = np.flatnonzero(split.fit), np.flatnonzero(split.select)
    held = shown(robot, problem.windows)
    terms = single_terms(robot, settings.effects or (), (*settings.without, *held))
    if settings.joints:
        terms = terms_at(terms, settings.joints)
    if settings.joints and not terms:
        raise UsageError(
            f"none of the effects asked for acts on single joints such as {settings.joints[0]!r}",
            expected="effects of joints",
            do="leave the choice of joints out",
        )
    if not terms:
        measured = "".join(f"; {name} is in the {by} that was measured" for name, by in held.items())
        raise UsageError(
            f"none of the effects {list(settings.effects or ())} can act on robot {robot.name!r}{measured}",
            expected="an effect that can",
            do=f"see `dynreg effects {robot.name}`",
        )
    found = search(registry, problem, terms, fit_on, select_on, settings, progress)
    evidence = Evidence.of(found.problem, recording, found.extended, split.chosen)
    verdict = verdict_of(robot, evidence, found.rounds, found.accepted)
    return outcome(registry, problem, split, recording, settings, found, evidence, verdict, name, began)


def pose(
    registry: Registry | None, robot: Robot, recording: Recording, settings: Settings
) -> tuple[Problem, Parts]:
    """The recording cut into windows, its parts, and the coordinates that start from the simulator asked for.

    Windows with holes, where a command, an input or a weighted channel holds no number for long, are left out.
    """
    require_commands(robot, recording)
    if settings.joints:
        robot = only_joints(robot, settings.joints)
    horizon = settings.horizon or robot.file.replay.horizon or LONGEST
    rate = robot.file.robot.control_rate
    if rate is not None and horizon * rate < 2:
        raise UsageError(
            f"horizon {horizon:g} s", expected=f"at least two commands, {2 / rate:g} s", do="cut less fine"
        )
    table = robot.file.replay.model_copy(update={"horizon": horizon})
    cut = windows(replace(robot, file=robot.file.model_copy(update={"replay": table})), recording)
    lost = holes(robot, recording)
    cut = cut.take(np.flatnonzero(~hit(cut, lost)))
    why = f": {sentence(recording, lost)}" if lost else ""
    if len(cut) < 2:
        raise LogError(
            f"the recording makes {len(cut)} rollout of {horizon:g} s{why}",
            expected="at least two: one to fit, one to select by, and a third to test the result",
            do="record more episodes, or cut it finer with --horizon",
        )
    split = parts(recording, cut, settings.hold_out, paired=True)
    if not split.select.any():
        raise LogError(
            f"nothing is left to select a cause by{why}",
            expected="at least two episodes beside those held out",
            do="record more episodes, hold out less, or cut it finer with --horizon",
        )
    _check_length(robot, cut, split, why)
    if settings.windows:
        split = thinned(split, cut.episode, settings.windows, settings.seed)
    cut = _settled(robot, cut.scaled_by(robot, split.chosen), settings.engine)
    cut = replace(cut, run=replace(cut.run, joints=settings.joints))
    _check_motion(robot, cut, split)
    centre = _centre(registry, robot, recording, settings)
    coordinates = Coordinates(robot, known_values(robot, recording), centre, settings.tolerance)
    if settings.joints:
        values = coordinates.values(np.zeros(len(coordinates)))
        moved = tuple(coordinates.values(np.full(len(coordinates), way)) for way in (1.0, -1.0))
        known = fixed_unseen(robot, cut.take(split.chosen), coordinates.known, values, moved, settings.engine)
        coordinates = Coordinates(robot, known, centre, settings.tolerance)
    return Problem(robot, cut, coordinates, settings.engine, settings.threads), split


def search(
    registry: Registry | None,
    problem: Problem,
    terms: list[Term],
    fit_on: np.ndarray,
    select_on: np.ndarray,
    settings: Settings,
    progress: Progress | None = None,
    *,
    needed: float | None = None,
) -> Found:
    """Calibrate, find the threshold, add one cause after the other while they pass it, refit on fit and select.

    needed : the threshold [nats], where it is known.
    """
    report = progress or (lambda *_: None)
    report("calibrate", 0, 1)
    many = len(terms) > MANY
    base, effective = calibrate(problem, fit_on, draws=0 if many else DRAWS, seed=settings.seed)
    report("calibrate", 1, 1)
    if needed is None:
        of = {"runs": settings.threshold_runs, "seed": settings.seed}
        limit = threshold(registry, problem, terms, fit_on, select_on, **of, progress=progress)
    else:
        limit = Calibrated(needed, ())
    rounds: list[Naming] = []
    accepted, current, zeroed = 0, base, problem
    for number in range(settings.max_causes):
        report("causes", number, settings.max_causes)
        left = unlike(problem.robot, terms, current.hypothesis.terms)
        if not left:
            break
        naming = name_one(zeroed, current, left, fit_on, select_on, effective)
        rounds.append(naming)
        if number == 0:
            base = naming.start.point
        if naming.chosen is None or naming.chosen.nats < limit.nats:
            break
        accepted += 1
        rounds = revise(zeroed, rounds, fit_on, select_on, effective)
        zeroed, current = _zeroed(problem, zeroed, rounds[-1].chosen.point, fit_on, select_on)
    report("causes", settings.max_causes, settings.max_causes)
    both = np.concatenate([fit_on, select_on])
    pooled = np.concatenate(
        [effective, np.tile(effective.mean(axis=0), (len(select_on) * problem.segments, 1))]
    )
    if many and problem.stands:
        # fitted on all windows already; a last round that found no more has gone on with `current`
        current = current if len(rounds) == accepted else rounds[-1].start.point
        zeroed.refine([current], both)
        return Found(base, current, tuple(rounds), accepted, limit, zeroed)
    if many and problem.rough:
        base, current = _ended(problem, zeroed, base, current if accepted else None, both)
        return Found(base, current, tuple(rounds), accepted, limit, zeroed)
    (base,), _ = fit(problem, [base], both, pooled, iterations=1 if many else 4)
    if not accepted:
        current = base
    elif many:
        current = _polished(zeroed, current, both)
    else:
        current = settle(zeroed, current, both, pooled, seed=settings.seed)
    return Found(base, current, tuple(rounds), accepted, limit, zeroed)


def _zeroed(
    problem: Problem, zeroed: Problem, point: Point, fit_on: np.ndarray, select_on: np.ndarray
) -> tuple[Problem, Point]:
    """The point refitted in turn with the zeros of the episodes, and the problem whose windows have these.

    zeroed : the same problem with the zeros of an earlier point.
    """
    for _ in range(ZEROED):
        cut = rezeroed(zeroed, problem.windows, point, np.concatenate([fit_on, select_on]))
        if cut is problem.windows:  # nothing is set to zero anew
            break
        zeroed = replace(zeroed, windows=cut)
        zeroed.refine([point], np.arange(len(cut)))
        effective = zeroed.effective(zeroed.residuals([point], fit_on)[0])
        (point,), _ = fit(zeroed, [point], fit_on, effective, iterations=3)
    return zeroed, point


def _check_length(robot: Robot, cut: Windows, split: Parts, why: str) -> None:
    """LogError where fit or select has too few measured rows to tell a cause from chance; `why` is said with it."""
    weighted = [i for i, c in enumerate(robot.file.channels) if c.weight > 0]
    known = np.isfinite(cut.measured[:, 1:, weighted]).any(axis=2).sum(axis=1)
    for part in ("fit", "select"):
        rows = int(known[getattr(split, part)].sum())
        if rows < FEWEST:
            raise LogError(
                f"the {part} part has {rows} measured rows{why}",
                expected=f"at least {FEWEST}",
                do="record longer, or more episodes",
            )


def _ended(
    problem: Problem, zeroed: Problem, base: Point, extended: Point | None, chosen: np.ndarray
) -> tuple[Point, Point]:
    """The calibrated and the extended model refitted where rollouts are rough; the same one where no cause is named.

    The finer time step is simulated at every point: what it changes is not the same from one to the next, and the
    causes must not gain by it. Together they take less time: most of a fine rollout goes to the steps, not the rows.
    """
    if extended is None:
        (base,), _ = polish(problem, [base], chosen, iterations=ENDED)
        extended = base
    elif zeroed is problem:
        (base, extended), _ = polish(problem, [base, extended], chosen, iterations=ENDED)
    else:
        (base,), _ = polish(problem, [base], chosen, iterations=ENDED)
        (extended,), _ = polish(zeroed, [extended], chosen, iterations=ENDED)
    zeroed.refine([extended], chosen)
    return base, extended


def _polished(problem: Problem, point: Point, chosen: np.ndarray) -> Point:
    """The point refitted with the time step's part and the samples of its own residual, twice."""
    for _ in range(2):
        problem.refine([point], chosen)
        effective = problem.effective(problem.residuals([point], chosen)[0])
        (point,), _ = fit(problem, [point], chosen, effective, iterations=2)
    return point


def _settled(robot: Robot, cut: Windows, engine: str | None) -> Windows:
    """Windows in which a floating base begins as it stands after its reset begin at just that state.

    Joints put where their noise has them would lift feet off the ground, and the robot would turn as it lands.
    """
    if robot.file.reset.settle <= 0 or not (robot.model.jnt_type == 0).any():  # 0: a free joint
        return cut
    run = cut.run
    inputs = None if run.inputs is None else run.inputs[:, :1]
    first = replace(run, actions=run.actions[:, :1], inputs=inputs, initial=None)
    stands = rollout(robot, robot.space.nominal[None], first, engine=engine).states[0][:, 0]
    joints = [i for i, name in enumerate(robot.channels) if quantity_of(name) == "position"]
    apart = np.nan_to_num(np.abs(cut.measured[:, 0, joints] - stands[:, joints])).max(axis=1, initial=0.0)
    initial = np.where(apart[:, None] < STANDS, np.nan, run.initial)
    return replace(cut, run=replace(run, initial=initial))


def _check_motion(robot: Robot, cut: Windows, split: Parts) -> None:
    """LogError where commands never change, or no weighted channel moves beyond its noise."""
    actions = cut.run.actions[split.chosen]
    if not (np.ptp(actions, axis=1) > 0).any():
        raise LogError(
            "the commands never change",
            expected="a recording in which the robot is moved",
            do="record one, such as `dynreg excite` writes",
        )
    use = np.flatnonzero(cut.weight > 0)
    noise = np.array([max(c.noise, c.quantum) for c in robot.file.channels])[use]
    still = cut.spread[use] <= STILL * noise
    if still.all():
        raise LogError(
            f"no measured channel moves by more than its noise ({robot.channels[use[0]]!r}, for one)",
            expected="motion",
            do="record larger motions, or correct the noise in robot.toml",
        )


def _centre(
    registry: Registry | None, robot: Robot, recording: Recording, settings: Settings
) -> np.ndarray | None:
    """(P,) parameters of the simulator to start from; None for the nominal ones."""
    if settings.start == "nominal" or registry is None:
        return None
    if settings.start == "nearest":
        try:
            answer = registry.latest("neighbours", recording.id).document["answer_parameters"]
        except NoMatchError:
            raise NoMatchError(
                "no query about this recording is stored",
                expected="its nearest simulator",
                do="run `dynreg query` first, or start from nominal",
            ) from None
        return robot.space.from_dict(answer)
    identity, kind = registry.resolve(settings.start, ("simulator", "entry"))
    if kind == "entry":
        return robot.space.from_dict(dict(registry.load_entry(identity).parameters))
    config = registry.simulator(identity)
    if config["robot"] != robot.hash:
        raise UsageError(
            f"simulator {identity[:12]} is one of robot {config['robot_name']!r}",
            expected=f"one of {robot.name!r}",
            do="choose another to start from",
        )
    return robot.space.from_dict(config["values"])
