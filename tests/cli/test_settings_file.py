"""Settings: file < environment < flags, and wrong ones are errors."""

from pathlib import Path

import pytest

from dynreg.cli.settings import Settings, read_settings
from dynreg.errors import UsageError
from dynreg.session import place


def test_without_anything_there_are_no_settings(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)
    assert read_settings(None, {}) == Settings()


def test_the_later_source_wins(dynreg, session, monkeypatch: pytest.MonkeyPatch) -> None:
    Path("dynreg.toml").write_text('k = 2\nregistry = "from-file"\n')
    dynreg("query", "bench")
    assert session.asked[-1][2]["k"] == 2 and session.path == Path("from-file")
    monkeypatch.setenv("DYNREG_K", "3")
    monkeypatch.setenv("DYNREG_REGISTRY", "from-environment")
    dynreg("query", "bench")
    assert session.asked[-1][2]["k"] == 3 and session.path == Path("from-environment")
    dynreg("query", "bench", "-k", "4", "--registry", "from-flag")
    assert session.asked[-1][2]["k"] == 4 and session.path == Path("from-flag")


def test_a_home_is_meant_by_its_sign_wherever_the_registry_is_told(
    dynreg, session, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    for name in ("HOME", "USERPROFILE"):
        monkeypatch.setenv(name, str(tmp_path / "home"))
    Path("dynreg.toml").write_text('registry = "~/from-file"\n')
    dynreg("list")
    assert session.path == tmp_path / "home" / "from-file"
    monkeypatch.setenv("DYNREG_REGISTRY", "~/from-environment")
    dynreg("list")
    assert session.path == place(None) == tmp_path / "home" / "from-environment"
    dynreg("list", "--registry=~/from-flag")
    assert session.path == place("~/from-flag") == tmp_path / "home" / "from-flag"
    Path("~").mkdir()
    assert place("~") == Path("~"), "a folder of that very name"
    assert place("~nobody-of-this-name/x") == Path("~nobody-of-this-name/x")


def test_the_registry_may_stand_before_the_verb_and_the_one_behind_it_wins(dynreg, session) -> None:
    dynreg("--registry", "early", "list")
    assert session.path == Path("early")
    dynreg("--registry", "early", "list", "--registry", "late")
    assert session.path == Path("late")


def test_a_named_settings_file_goes_before_the_default_one(dynreg, session) -> None:
    Path("dynreg.toml").write_text("k = 2\n")
    Path("other.toml").write_text("k = 9\n")
    dynreg("query", "bench", "--settings", "other.toml")
    assert session.asked[-1][2]["k"] == 9


def test_every_setting_can_come_from_the_environment() -> None:
    given = {
        "registry": "r",
        "threads": "2",
        "seed": "5",
        "k": "4",
        "distance": "embedding",
        "budget": "9",
        "executor": "ray",
        "quiet": "true",
    }
    assert set(given) == set(Settings.model_fields)
    found = read_settings(None, {f"DYNREG_{key.upper()}": value for key, value in given.items()})
    assert found == Settings(
        registry=Path("r"),
        threads=2,
        seed=5,
        k=4,
        distance="embedding",
        budget=9,
        executor="ray",
        quiet=True,
    )


@pytest.mark.parametrize("text", ["kk = 3\n", "k = 0\n", 'k = "many"\n', "k = \n", "threads = -1\n"])
def test_a_wrong_file_names_itself(text: str, tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text(text)
    with pytest.raises(UsageError, match=r"mine\.toml"):
        read_settings(file, {})


def test_a_wrong_variable_names_itself() -> None:
    with pytest.raises(UsageError, match="DYNREG_K='abc'.*expected"):
        read_settings(None, {"DYNREG_K": "abc"})


def test_every_option_of_every_verb_is_told_with_its_help_and_its_default(dynreg) -> None:
    from dynreg.session import rows
    from dynreg.verbs.settings import options

    for name, row in rows().items():
        told = " ".join(dynreg(name, "--help").out.split())
        for one, how in options(row.settings):
            flag = (how.flag or f"--{one.name.replace('_', '-')}").split("/")[0]
            assert how.flag is None or (f"{flag} " in told and how.help.split(".")[0].split()[0] in told)
            assert not how.usual or how.usual.split()[0] in told
