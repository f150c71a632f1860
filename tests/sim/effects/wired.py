"""Tables of robot.toml for position drives on joints, as the tests of effects between bodies wire their arms."""

from collections.abc import Sequence


def wired(joints: Sequence[str], gain: float, rate_gain: float) -> str:
    """A drive, an action and a position channel for each joint, and a dry friction of all of them as a parameter."""
    out = '[[parameters]]\nname = "friction"\nunit = "N*m"\nnominal = 0.0\nlow = -1.0\nhigh = 1.0\n'
    out += 'sets = ["port.friction.coulomb[*] +="]\n'
    for name in joints:
        out += f'[[drives]]\njoint = "{name}"\ntype = "position"\ngain = {gain}\nrate_gain = {rate_gain}\n'
        out += f'[[actions]]\nname = "{name}/target"\nunit = "rad"\n'
        out += f'[[channels]]\nname = "{name}/position"\nunit = "rad"\n'
    return out
