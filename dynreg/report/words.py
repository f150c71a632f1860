"""Short numbers, counts and intervals in the text of every result."""

from collections.abc import Mapping, Sequence

from dynreg.data.names import episode_of
from dynreg.errors import taken_apart
from dynreg.results.diagnosis import EffectEstimate
from dynreg.results.result import Cost, Estimate, Interval

SHOWN_EPISODES = 6
FEWEST_PARTED = 3  # rollouts of which one can be held out
NOT_SCORED = (
    "Channels not scored have weight 0 in robot.toml, or hold still. Overall error and gain leave them out."
)


def number(value: float | int | None) -> str:
    """Three significant digits; `-` for None.

    >>> number(0.123456), number(1234.5), number(7), number(None)
    ('0.123', '1234', '7', '-')
    """
    if value is None:
        return "-"
    if isinstance(value, int):
        return str(value)
    return f"{value:.3g}" if abs(value) < 999.5 else f"{value:.0f}"


def count(how_many: int, what: str) -> str:
    """A number and its noun.

    >>> count(1, "simulation"), count(2, "simulation")
    ('1 simulation', '2 simulations')
    """
    return f"{how_many} {what}{'' if how_many == 1 else 's'}"


def channel_words(name: str, scored: bool) -> str:
    """A channel, marked where no score counts it.

    >>> channel_words("arm/velocity", scored=False)
    'arm/velocity (not scored)'
    """
    return name if scored else f"{name} (not scored)"


def interval_words(reliable: bool) -> str:
    """What intervals are called, in a heading or a legend."""
    return "90 % interval" if reliable else "unreliable interval"


def interval(estimate: Estimate | EffectEstimate) -> str:
    """A value with its 90 % interval (if it has one), and a mark if it is at the edge of its range."""
    edge = " (at the edge)" if estimate.at_bound else ""
    bounds = "" if estimate.low is None else f" [{number(estimate.low)}, {number(estimate.high)}]"
    return f"{number(estimate.value)}{bounds}{edge}"


def interval_text(e: Interval) -> str:
    """A value with its interval."""
    return f"{number(e.value)} [{number(e.low)}, {number(e.high)}]"


def cost_words(cost: Cost, simulators: int | None = None) -> str:
    """The cost of a search; `simulators` : among how many it was, None where that is not known.

    A simulator may be evaluated more than once: a search can have several stages.
    """
    among = "" if simulators is None else f" among {count(simulators, 'simulator')}"
    evaluated = count(cost.evaluations, "distance evaluation") + among
    return f"cost: {evaluated}, {cost.rollouts} simulations, {cost.seconds:.1f} s"


def held_out_words(parts: Mapping[str, Sequence[str]]) -> str:
    """Which episodes were held out, and where they are pieces of runs that were fitted as well; "" where none were.

    parts : names of episodes, or "run[3]" of windows of one.

    >>> held_out_words({"fit": ("a", "b"), "select": ("c",), "test": ("d",)})
    'Held out: d, of 4 episodes.'
    >>> held_out_words({"fit": ("run[0]", "run[2]"), "select": ("run[3]",), "test": ("run[1]",)})
    'Held out: run[1], a piece of the one run that was fitted as well. How it does in another run was not tested.'
    """
    test, others = parts.get("test", ()), (*parts.get("fit", ()), *parts.get("select", ()))
    if not test:
        return ""
    episodes = [dict.fromkeys(episode_of(name) for name in names) for names in (test, others)]
    own, every = episodes[0], {**episodes[0], **episodes[1]}
    apart = not own.keys() & episodes[1].keys()
    named = [*(own if apart else test)]
    shown = ", ".join(named[:SHOWN_EPISODES])
    shown += f" and {len(named) - SHOWN_EPISODES} more" if len(named) > SHOWN_EPISODES else ""
    if apart:
        return f"Held out: {shown}, of {count(len(every), 'episode')}."
    runs = "the one run that was" if len(every) == 1 else "runs that were"
    pieces = "a piece" if len(test) == 1 else "pieces"
    return f"Held out: {shown}, {pieces} of {runs} fitted as well. How it does in another run was not tested."


def to_hold_out(parts: Mapping[str, Sequence[str]] | None, cut: str) -> str:
    """What to do where nothing was held out; cut : how to make more rollouts, for of two none can be held out.

    parts : None in documents that tell none.

    >>> to_hold_out({"fit": ("a", "b"), "select": ("c",)}, "cut them shorter")
    'Nothing was held out. Record more episodes, or use --hold-out.'
    >>> to_hold_out({"fit": ("a",), "select": ("b",)}, "cut them shorter")
    'Nothing was held out. Record more episodes, or cut them shorter.'
    """
    few = parts is not None and sum(map(len, parts.values())) < FEWEST_PARTED
    return f"Nothing was held out. Record more episodes, or {cut if few else 'use --hold-out'}."


def first_of(problems: Sequence[str]) -> tuple[str, str, str]:
    """The first problem as (problem, expected, do), with the number of further ones in `problem`."""
    problem, expected, do = taken_apart(problems[0])
    return problem + (f" (and {len(problems) - 1} more)" if len(problems) > 1 else ""), expected, do
