"""Registries, logs, robots and files whose names mean something to a shell, a URL or SQLite: here they mean nothing."""

import shutil
from pathlib import Path

import pytest

import dynreg as package
from dynreg.cli.completion import recording_names

NAMES = {
    "colon": "a:b",
    "url": "100%25?mode=ro#part&x=1",
    "spaces": " a  b ",
    "dash": "-dash",
    "pattern": "[x]*{y}?",
    "shell": "$HOME;`id`|'q\"\\",
    "newline": "two\nlines\t\x1b[31m",
    "home": "~",
    "scheme": "file:",
    "letters": "übung-λ",
    "no text": "\udcff\udcfe",
}


@pytest.mark.parametrize("name", NAMES.values(), ids=NAMES)
def test_every_verb_takes_an_odd_name_as_it_is(
    name: str, dynreg, registry_folder, tmp_path, monkeypatch
) -> None:
    def well(*line: str) -> None:
        ended = dynreg(*line)
        fits_nothing = ended.status == 4 and "no simulator fits" in ended.err
        assert ended.status == 0 or fits_nothing, ended.err

    monkeypatch.chdir(tmp_path)
    shutil.copytree(registry_folder, name)
    log, robot = f"./{name}.csv", f"./{name}-robot"
    shutil.copy(registry_folder.parent / "bench.csv", log)
    shutil.copytree(Path(package.__file__).parent / "robots" / "servo_pendulum", robot)
    registry = f"--registry={name}"
    well("list", registry)
    well("info", registry, "--json")
    well("verify", "--repair", registry)
    well("doctor", log, "--robot", robot)
    well("robots", "check", robot)
    well("ingest", log, "--robot", "servo_pendulum", registry)
    well("show", "@last", registry)
    well("query", "bench", "-k", "2", "--no-synthesise", "--no-replay", registry, f"--report={name}.html")
    well("report", "@last", f"--out={name}.page", registry)
    well("export", "bench", f"--to={name}-copy", registry)
    well("list", f"--registry={name}-copy")
    before = {path.name for path in tmp_path.iterdir()}
    assert before == {name, *(f"{name}{end}" for end in (".csv", "-robot", ".html", ".page", "-copy"))}
    monkeypatch.setenv("DYNREG_REGISTRY", name)
    well("list")
    assert "bench" in recording_names("")


@pytest.mark.parametrize("verb", ["show", "query", "report", "export", "diagnose"])
def test_a_word_that_is_no_text_names_nothing(
    verb: str, dynreg, registry_folder, tmp_path, monkeypatch
) -> None:
    monkeypatch.chdir(tmp_path)
    shutil.copytree(registry_folder, "registry")
    more = ("--to", "copy") if verb == "export" else ()
    ended = dynreg(verb, "\udcff", *more, "--registry", "registry")
    assert ended.status == 4 and "'\\udcff'" in ended.err and ended.err.count("\n") == 1
