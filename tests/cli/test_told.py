"""A verb's settings as options: what a command line, a settings file or a default tells reaches the verb."""

from dataclasses import MISSING, dataclass
from pathlib import Path

import pytest
import typer

from dynreg.cli.call import verb
from dynreg.errors import UsageError
from dynreg.verbs.settings import Settings, option, seed, threads


@dataclass(frozen=True)
class AskSettings(Settings):
    """One setting of every kind."""

    between: tuple[str, ...] = option(MISSING, "Two of them.", flag="--for", metavar="A,B")
    count: int = option(1, "How many.", flag="-n", least=1)
    kinds: tuple[str, ...] = option(("a", "b"), "Which ones.", choices=("a", "b", "c"))
    only: tuple[str, ...] | None = option(None, "Only these.", usual="all", some="only", see="ask")
    but: tuple[str, ...] = option((), "Not these.")
    budget: int | None = option(None, "Not what a verb of this name shares.", least=1)
    files: tuple[str, ...] = option((), "One of many.", flag="--with", repeated=True)
    longest: float = option(2.0, "Seconds.", above=0.0)
    way: str = option("short", "Which way.", choices=("short", "long"))
    quick: bool = option(False, "Be quick.")
    link: bool = option(True, "Link them.")
    fair: bool = option(True, "Be fair.", flag="--even/--uneven")
    inner: int = option(7, "Not told on a command line.", flag=None)
    seed: int = seed()
    threads: int = threads()

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.between) != 2:
            problem = f"between {','.join(self.between)!r}"
            raise UsageError(problem, expected="two", do="name two", setting="between")
        for name in {*self.but} & {*self.between}:
            raise UsageError(f"but and between share {name!r}", expected="one of the two", do="drop one")


@pytest.fixture
def ask(tmp_path, monkeypatch):
    """Runs a command line and gives the settings that reached the verb."""
    monkeypatch.chdir(tmp_path)
    reached = []
    app = typer.Typer(rich_markup_mode=None)

    @app.callback()
    def root() -> None:
        """More than one command."""

    @verb(app, "ask", "Ask.")
    def command(call, settings: AskSettings) -> None:
        reached.append(settings)

    def run(line: str) -> AskSettings | None:
        app(["ask", *line.split()], standalone_mode=False)
        return reached.pop() if reached else None  # help reaches no verb

    return run


def test_what_is_not_given_is_the_usual(ask) -> None:
    assert ask("--for x,y") == AskSettings(between=("x", "y"))


def test_every_kind_of_option_is_read(ask) -> None:
    line = "--for drag[hip,knee],x -n 3 --kinds c,a --only x --with one --with two --longest 0.5 --quick --no-link"
    assert ask(f"{line} --uneven --seed 4 --threads 2") == AskSettings(
        between=("drag[hip,knee]", "x"),
        count=3,
        kinds=("c", "a"),
        only=("x",),
        files=("one", "two"),
        longest=0.5,
        quick=True,
        link=False,
        fair=False,
        seed=4,
        threads=2,
    )


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("--for x,y -n 0", "-n 0; expected a whole number of 1 or more"),
        ("--for x,y --kinds a,d", "--kinds 'd'; expected one of a, b, c"),
        ("--for x,y --only ,", "--only ','; expected only such as a,b; see `dynreg ask`"),
        ("--for x,y --but x", "but and between share 'x'"),
        ("--for x", "--for 'x'; expected two"),
        ("--for x,y --longest 0", "--longest 0; expected a number above 0"),
        ("--for x,y --seed -1", "--seed -1; expected a whole number of 0 or more"),
    ],
)
def test_an_error_names_the_flag(line: str, says: str, ask) -> None:
    with pytest.raises(UsageError) as error:
        ask(line)
    assert str(error.value).startswith(says)


@pytest.mark.parametrize("line", ["", "--for x,y --inner 3"])
def test_what_must_be_given_and_what_no_command_line_tells(line: str, ask) -> None:
    with pytest.raises(Exception, match="between|--inner"):
        ask(line)


def test_a_list_may_hold_nothing_where_its_setting_does_not_need_any(ask) -> None:
    assert ask("--for x,y --but ,").but == ask("--for x,y --kinds=").kinds == ()


def test_only_what_verbs_share_comes_from_a_settings_file(ask, monkeypatch) -> None:
    Path("dynreg.toml").write_text("seed = 3\nk = 9\n")
    monkeypatch.setenv("DYNREG_BUDGET", "50")
    assert ask("--for x,y").seed == 3 and ask("--for x,y").budget is None
    assert ask("--for x,y --seed 5").seed == 5


def test_the_help_says_what_stands_in_for_what_is_not_given(ask, capsys) -> None:
    assert ask("--help") is None
    told = " ".join(capsys.readouterr().out.split())
    for said in (
        "Only these. [default: all]",
        "Seed of the random numbers. [default: 0]",
        "Simulation threads. [default: all cores]",
        "Seconds. [default: 2.0]",
        "Which ones. One of a, b, c. [default: a,b]",
        "--way short|long Which way. [default: short]",
        "Link them. [default: link]",
        "-n N How many. [default: 1]",
    ):
        assert said in told
    assert "--inner" not in told and "<" not in told
    assert "--link / --no-link" in told and "--even / --uneven" in told and "--no-quick" not in told
