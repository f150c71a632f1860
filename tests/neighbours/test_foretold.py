"""A dry run tells what populating would cost, and keeps nothing."""

import pytest
from secret_servo import ENTRIES, TRAINING

from dynreg import session
from dynreg.errors import UsageError


def test_a_dry_run_keeps_nothing_and_counts_what_is_missing(servos, registry_snapshot):
    before = registry_snapshot(servos.path)
    told = servos.populate("servo_pendulum", ENTRIES + 400, training=TRAINING, dry_run=True)
    assert registry_snapshot(servos.path) == before
    expected = told.expected
    assert (told.entries, told.planned, told.added) == (ENTRIES, ENTRIES + 400, 0)
    assert expected.missing == 400 and expected.seconds["base"] == 0.0, "what is shared is there"
    assert all(expected.seconds[step] > 0 for step in ("simulate", "train", "store", "link"))
    shards = sum(path.stat().st_size for path in (servos.path / "shards").iterdir())
    assert expected.disk_bytes == pytest.approx(400 / ENTRIES * shards, rel=0.2)
    assert 0 < expected.disk_bytes < expected.free_bytes and expected.memory_bytes >= 0


def test_a_new_population_needs_a_base_model_too(tmp_path):
    with session.open(tmp_path / "registry") as opened:
        told = opened.populate("servo_pendulum", 50, training=TRAINING, dry_run=True, link=False)
        assert told.expected.seconds["base"] > 0 and told.expected.seconds["link"] == 0
        assert opened.registry.populations() == () and opened.registry.robots() == {}
        with pytest.raises(UsageError, match="--dry-run with --effects"):
            opened.populate("servo_pendulum", 50, effects=True, like="log", dry_run=True)
        for name, other in {
            "--no-link": {"link": False},
            "--dry-run": {"dry_run": True},
            "--effects": {"effects": True, "like": "log"},
        }.items():
            with pytest.raises(UsageError, match=f"--relink with {name}"):
                opened.populate("servo_pendulum", 50, relink=True, **other)


def test_of_a_shared_registry_it_is_told_where_the_bytes_go(stores, tmp_path, monkeypatch):
    name = stores.new()
    monkeypatch.setattr("shutil.disk_usage", None)  # the disk here has no say
    where = {"catalog": stores.catalog(name), "blobs": stores.blobs(name)}
    with session.share(tmp_path / "face", **where) as opened:
        told = opened.populate("servo_pendulum", 50, training=TRAINING, dry_run=True)
        assert told.expected.free_bytes is None and told.expected.bucket == f"s3://{name}/robots"
        assert opened.registry.populations() == ()
    stores.drop(name)


def test_what_was_never_linked_is_linked_whole(tmp_path, monkeypatch):
    monkeypatch.setattr("dynreg.verbs.linking.FITTED", 10)
    monkeypatch.setattr("dynreg.verbs.foretold.FITTED", 10)
    with session.open(tmp_path / "registry") as opened:
        told = {"training": TRAINING, "dry_run": True}
        opened.populate("servo_pendulum", ENTRIES, training=TRAINING, link=False)
        unlinked = opened.populate("servo_pendulum", ENTRIES, **told).expected
        assert unlinked.missing == 0 < unlinked.seconds["link"]
        opened.populate("servo_pendulum", ENTRIES, training=TRAINING)
        assert opened.populate("servo_pendulum", ENTRIES, **told).expected.seconds["link"] == 0.0
