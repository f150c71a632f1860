"""The servers of shared stores for tests: PostgreSQL from the system's package, and moto's stand-in for S3.

Both listen on this machine alone, keep what they hold in a temporary folder, and go with the tests.
"""

import ctypes
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory

KEYS = {"AWS_ACCESS_KEY_ID": "test", "AWS_SECRET_ACCESS_KEY": "test", "AWS_EC2_METADATA_DISABLED": "true"}
# What a crash of the machine may take matters to no test; what one of the server may take does.
_HASTY = (
    "fsync=off",
    "full_page_writes=off",
    "max_connections=60",
    "listen_addresses=127.0.0.1",
)
# Only the user `locked` has a password.
_WHO = "host all locked 127.0.0.1/32 scram-sha-256\nhost all all 127.0.0.1/32 trust\n"


@dataclass
class Stores:
    """Where the servers are; `new` gives a place in them that nothing else uses."""

    port: int
    endpoint: str
    postgres: "Postgres"
    number: int = 0
    lock: threading.Lock = field(default_factory=threading.Lock)

    def catalog(self, database: str, user: str = "postgres") -> str:
        return f"postgresql://{user}@127.0.0.1:{self.port}/{database}"

    def blobs(self, bucket: str, prefix: str = "robots") -> str:
        return f"s3://{bucket}/{prefix}?scheme=http&endpoint_override={self.endpoint}"

    def new(self, like: str | None = None) -> str:
        """The name of a new database and bucket, empty or with what another pair holds."""
        with self.lock:
            self.number += 1
            name = f"dynreg{os.getpid()}x{self.number}"
        self.sql("postgres", f"CREATE DATABASE {name}" + (f" TEMPLATE {like}" if like else ""))
        files = self.files()
        files.create_dir(name)
        if like:
            for path in _objects(files, like):
                files.copy_file(path, path.replace(like, name, 1))
        return name

    def drop(self, name: str) -> None:
        self.sql("postgres", f"DROP DATABASE IF EXISTS {name} WITH (FORCE)")
        files = self.files()
        for path in _objects(files, name):
            files.delete_file(path)

    def sql(self, database: str, *statements: str) -> list:
        import psycopg

        with psycopg.connect(
            host="127.0.0.1", port=self.port, user="postgres", dbname=database, autocommit=True
        ) as connection:
            done = [connection.execute(statement) for statement in statements]
            return done[-1].fetchall() if done and done[-1].description else []

    def files(self):
        from pyarrow.fs import S3FileSystem

        return S3FileSystem(
            access_key="test",
            secret_key="test",
            scheme="http",
            endpoint_override=self.endpoint,
            region="us-east-1",
            allow_bucket_creation=True,
        )


def why_none() -> str:
    """Why this machine cannot run the servers; "" where it can."""
    if _programs() is None:
        return "no PostgreSQL server: apt-get install postgresql"
    absent = [name for name in ("psycopg", "moto", "flask_cors") if find_spec(name) is None]
    return f"no {absent[0]}: pip install 'dynreg[dev]'" if absent else ""


@contextmanager
def running() -> Iterator[Stores]:
    """Both servers, with what they hold in a temporary folder."""
    programs = _programs()
    os.environ.update(KEYS)
    with TemporaryDirectory(
        prefix="stores-"
    ) as place:  # not among pytest's folders, which are one user's alone
        folder = Path(place)
        folder.chmod(0o711)
        with _postgres(programs, folder / "postgres") as postgres, _moto(folder) as endpoint:
            yield Stores(postgres.port, endpoint, postgres)


def _ends_with_us() -> None:
    """Have the system end this process with its parent, so that killed tests leave no server (on Linux)."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(1, signal.SIGINT)


class Postgres:
    """A server on a port of this machine, which can be stopped and started; what it holds stays meanwhile."""

    def __init__(self, programs: Path, folder: Path):
        folder.mkdir(parents=True)
        user = _ordinary_user()
        if user is not None:
            os.chown(folder, user.pw_uid, user.pw_gid)
        self.port, self._programs, self._folder = _free_port(), programs, folder
        self._run = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True, "cwd": folder}
        if user is not None:
            self._run |= {"user": user.pw_uid, "group": user.pw_gid, "extra_groups": []}
        how = ["-U", "postgres", "-A", "trust", "-E", "UTF8", "--no-sync"]
        made = subprocess.run([programs / "initdb", "-D", folder / "data", *how], **self._run)
        if made.returncode:
            raise RuntimeError(f"initdb: {made.stdout}")
        (folder / "data" / "pg_hba.conf").write_text(_WHO)
        self.start()

    def start(self) -> None:
        """Start it, and wait until it answers."""
        options = [word for setting in _HASTY for word in ("-c", setting)]
        where = ["-D", self._folder / "data", "-p", str(self.port), "-k", self._folder]
        with (self._folder / "log").open("a") as log:
            self._server = subprocess.Popen(
                [self._programs / "postgres", *where, *options],
                preexec_fn=_ends_with_us,
                **self._run | {"stdout": log, "stderr": log},
            )
        _wait_for(self.port, self._server)
        ready = [self._programs / "pg_isready", "-h", "127.0.0.1", "-p", str(self.port)]
        while subprocess.run(ready, **self._run).returncode:
            if self._server.poll() is not None:
                raise RuntimeError(f"PostgreSQL ended with status {self._server.poll()}")
            time.sleep(0.05)

    def stop(self, how: signal.Signals = signal.SIGINT) -> None:
        """End it and all its sessions: SIGINT as an orderly restart does, SIGQUIT at once."""
        self._server.send_signal(how)
        self._server.wait()


@contextmanager
def _postgres(programs: Path, folder: Path) -> Iterator[Postgres]:
    postgres = Postgres(programs, folder)
    try:
        yield postgres
    finally:
        postgres.stop(signal.SIGQUIT)  # nothing of it is kept


@contextmanager
def _moto(folder: Path) -> Iterator[str]:
    port = _free_port()
    with (folder / "moto.log").open("w") as log:
        server = subprocess.Popen(
            [sys.executable, "-m", "moto.server", "-H", "127.0.0.1", "-p", str(port)],
            stdout=log,
            stderr=log,
            preexec_fn=_ends_with_us,
            env=os.environ | {"MOTO_ALLOW_NONEXISTENT_REGION": "1"},
        )
    try:
        _wait_for(port, server)
        yield f"127.0.0.1:{port}"
    finally:
        server.kill()
        server.wait()


def _programs() -> Path | None:
    found = shutil.which("initdb")
    folders = [Path(found).resolve().parent] if found else []
    folders += sorted(
        Path("/usr/lib/postgresql").glob("*/bin"),
        key=lambda p: int(re.sub(r"\D", "", p.parent.name) or 0),
        reverse=True,
    )
    needed = ("initdb", "postgres", "pg_isready")
    return next((f for f in folders if all((f / name).exists() for name in needed)), None)


def _ordinary_user():
    """Somebody else than root, as whom alone PostgreSQL runs; None where this process is no root."""
    if os.getuid() != 0:
        return None
    import pwd  # not on every system

    for name in ("postgres", "nobody"):
        try:
            return pwd.getpwnam(name)
        except KeyError:
            continue
    raise RuntimeError("neither 'postgres' nor 'nobody' is a user here")


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def _wait_for(port: int, server: subprocess.Popen, seconds: float = 60.0) -> None:
    end = time.monotonic() + seconds
    while time.monotonic() < end and server.poll() is None:
        with socket.socket() as probe:
            probe.settimeout(1.0)
            if probe.connect_ex(("127.0.0.1", port)) == 0:
                return
        time.sleep(0.05)
    raise RuntimeError(f"{server.args[0]} did not come up (status {server.poll()})")


def _objects(files, bucket: str) -> list[str]:
    from pyarrow.fs import FileSelector, FileType

    told = files.get_file_info(FileSelector(bucket, recursive=True))
    return [info.path for info in told if info.type is FileType.File]
