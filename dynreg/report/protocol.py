"""The room of commands for legs that hang free in turn."""

from rich.console import Group, RenderableType
from rich.text import Text

from dynreg.report.grid import table
from dynreg.results.protocol import LegProtocol


def tables(result: LegProtocol) -> Group:
    """What the operator does, the file of each leg, and the evidence to expect where least shows."""
    effects = list(dict.fromkeys(e.effect for leg in result.legs for e in leg.expected))
    rows = []
    for leg in result.legs:
        least = [min((e.nats for e in leg.expected if e.effect == name), default=None) for name in effects]
        rows.append((leg.leg, leg.file, leg.seconds, *least))
    parts: list[RenderableType] = [Text(str(result), style="bold")]
    parts.append(table(("leg", "file", "time [s]", *(f"{name} [nats]" for name in effects)), rows))
    parts += [Text(leg.operator) for leg in result.legs[:1]]
    parts.append(Text("nats: evidence to expect of an effect of medium size, in the joint where least shows"))
    return Group(*parts)
