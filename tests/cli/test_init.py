"""The commands on a shared registry, each in a folder of its own: nothing but the folder says that it is shared."""

import json
import shutil
from pathlib import Path

import tiny_registry


def test_from_init_to_an_answer_that_another_folder_shows(
    dynreg, stores, registry_folder, tmp_path, monkeypatch
):
    name = stores.new()
    where = ("--catalog", stores.catalog(name), "--blobs", stores.blobs(name))
    monkeypatch.delenv("DYNREG_REGISTRY", raising=False)
    monkeypatch.chdir(tmp_path)
    Path("run.csv").write_text(
        tiny_registry.bench_csv(lambda i, row: [*row[:4], 7.2, *row[5:]]), encoding="utf-8"
    )
    shutil.copytree(registry_folder, "old")
    made = dynreg("init", *where, "--registry", "here", "--json")
    assert made.status == 0 and json.loads(made.out)["catalog"] == stores.catalog(name), made.err
    told = dynreg("populate", "servo_pendulum", "-n", "300", "--dry-run", "--registry", "here")
    assert f"GB go to s3://{name}/robots, with a copy" in " ".join(told.out.split()), told.err
    for line in (
        ("import", "old"),
        ("ingest", "run.csv", "--robot", "servo_pendulum", "--name", "monday"),
        ("query", "monday", "-k", "2", "--budget", "8", "--hold-out", "kp=400"),
    ):
        ended = dynreg(*line, "--registry", "here", "--json")
        assert ended.status in (0, 4), ended.err
    answer = json.loads(ended.out)
    assert dynreg("init", *where, "--registry", "there", "--json").status == 0
    (result,) = json.loads(dynreg("list", "--kind", "result", "--registry", "there", "--json").out)["items"]
    shown = json.loads(dynreg("show", result["id"], "--registry", "there", "--json").out)
    assert shown["detail"]["answer"] == answer["answer"]
    assert json.loads(dynreg("verify", "--registry", "there", "--json").out)["clean"]
    stores.sql("postgres", f"DROP DATABASE {name} WITH (FORCE)", f"CREATE DATABASE {name}")
    refused = dynreg("init", *where, "--registry", "anew")
    assert refused.status == 1 and "add --rebuild" in refused.err
    assert dynreg("init", *where, "--registry", "anew", "--rebuild", "--json").status == 0
    assert json.loads(dynreg("show", result["id"], "--registry", "anew", "--json").out) == shown
    stores.drop(name)


def test_init_repeats_no_password(dynreg, tmp_path):
    told = ("init", "--catalog", "postgresql://me:open-sesame@h/db", "--blobs", "s3://b/x")
    ended = dynreg(*told, "--registry", tmp_path / "new", "--debug")
    assert ended.status == 2 and "PGPASSWORD" in ended.err and "open-sesame" not in ended.err + ended.out


def test_a_registry_in_one_folder_is_told_from_something_else_and_addresses_are_read_first(
    dynreg, registry_folder, tmp_path
):
    folder = shutil.copytree(registry_folder, tmp_path / "mine")
    blobs = ("--blobs", "s3://b/x", "--registry", folder)
    ended = dynreg("init", "--catalog", "postgresql://me@h/db", *blobs)
    assert ended.status == 1 and "is a registry in one folder" in ended.err
    assert "name another one with --registry" in ended.err and f"dynreg import {folder}" in ended.err
    ended = dynreg("init", "--catalog", "postgresql://me:open-sesame@h/db", *blobs)
    assert ended.status == 2 and "password" in ended.err and "open-sesame" not in ended.err
