"""PostgreSQL as the catalogue uses it: how a connection is made, how writers take turns, what its errors mean."""

import time
import warnings
from collections.abc import Callable
from contextvars import ContextVar
from functools import wraps
from inspect import isfunction
from typing import Any, ParamSpec, TypeVar

from sqlalchemy import URL, Connection, Engine, create_engine, event, make_url
from sqlalchemy.exc import ArgumentError

from dynreg.errors import Awaited, CorruptError, Interrupted, NoPlaceError, RegistryError, UsageError

LOCK_SECONDS = 60  # how long a writer waits for the others
IDLE_SECONDS = 600  # after which the server ends a transaction whose process says nothing any more
# Seconds before what a server broke off is tried again, a minute in all: a server that starts anew takes some 10 s.
PAUSES = (0.2, 0.5, 1.0, 2.0, 4.0, 8.0, 15.0, 15.0, 15.0)
_SAID = 2  # how often it is tried without a word
_WAIT = 10  # seconds for a connection
_WAITING: ContextVar[bool] = ContextVar("waiting", default=False)  # whether a caller makes its work again
# A process whose machine is gone lets go of its locks after about a minute.
_ALIVE = {"keepalives": 1, "keepalives_idle": 20, "keepalives_interval": 10, "keepalives_count": 4}
_SERVER_ALIVE = "-c tcp_keepalives_idle=20 -c tcp_keepalives_interval=10 -c tcp_keepalives_count=4"

_SECRET = {"password", "sslpassword"}

# What a transaction begins with. Readers see one moment; writers take turns, by a lock that ends with the transaction,
# and see all that was committed before theirs.
_BEGINS = {
    "BEGIN": "SET TRANSACTION ISOLATION LEVEL REPEATABLE READ, READ ONLY",
    "BEGIN IMMEDIATE": "SET TRANSACTION ISOLATION LEVEL READ COMMITTED, READ WRITE;"
    f" SET LOCAL lock_timeout = '{LOCK_SECONDS}s';"
    f" SET LOCAL idle_in_transaction_session_timeout = '{IDLE_SECONDS}s';"
    " SELECT pg_advisory_xact_lock(hashtextextended('dynreg writer ' || current_schema(), 0))",
}

# What its codes mean (appendix A of PostgreSQL's manual), by the beginning of the code: the longest that fits.
_PASSING = ("08", "23", "40", "57P", "25P03")
_LOCKED = ("55P03", "57014")
_RIGHTS = ("42501", "25006", "28", "0L", "0P")
_ROOM = ("53", "58")
_DAMAGED = ("42P01", "42703", "XX001", "XX002")

P, R, T = ParamSpec("P"), TypeVar("R"), TypeVar("T")


def address(text: str) -> URL:
    """The address of a catalogue, as SQLAlchemy has it; UsageError for one of another kind, or with a password in it.

    >>> str(address("postgresql://lab@db.lab/robots"))
    'postgresql+psycopg://lab@db.lab/robots'
    """
    try:
        url = make_url(text)
    except ArgumentError:
        url = None
    if url is None or url.get_backend_name() != "postgresql":
        raise UsageError(
            "the address of the catalogue is none of PostgreSQL",  # as it may hold a password, it is not repeated
            expected="an address such as postgresql://USER@HOST/DATABASE",
            do="give that of a database on a PostgreSQL server",
        )
    if url.password is not None or _SECRET & url.query.keys():
        raise UsageError(
            "the address of the catalogue holds a password, which would be stored in a file",
            expected="an address without it, such as postgresql://USER@HOST/DATABASE",
            do="keep the password in PGPASSWORD, or in ~/.pgpass",
        )
    return url.set(drivername="postgresql+psycopg") if url.drivername == "postgresql" else url


def engine_for(url: URL) -> Engine:
    """Connections to a database, a few of them held ready. Raises RegistryError where psycopg is absent."""
    told = f"{url.query.get('options', '')} {_SERVER_ALIVE}".strip()
    try:
        engine = create_engine(
            url.update_query_dict({"options": told}),
            pool_size=2,
            max_overflow=8,
            pool_pre_ping=True,
            connect_args={"connect_timeout": _WAIT, "application_name": "dynreg", **_ALIVE},
        )
    except ModuleNotFoundError as error:
        raise RegistryError(
            "a catalogue on PostgreSQL needs psycopg",
            expected="the package psycopg",
            do="install it: pip install 'dynreg[postgres]'",
        ) from error

    @event.listens_for(engine, "begin")
    def _begin(connection: Connection) -> None:
        connection.exec_driver_sql(_BEGINS[connection.get_execution_options().get("dynreg_begin", "BEGIN")])

    return engine


def let_idle(connection: Connection) -> None:
    """Have the server keep a transaction, however long nothing is asked: else its lock goes while files are moved."""
    connection.exec_driver_sql("SET LOCAL idle_in_transaction_session_timeout = 0")


def persistent(work: Callable[P, R]) -> Callable[P, R]:
    """A put or a look that is made again where the server broke it off: a put is idempotent by its content.

    It waits a minute in all, with growing pauses, and says so; within another that waits it leaves that to it. Raises
    NoPlaceError where the server is away longer.
    """

    @wraps(work)
    def run(*args: P.args, **told: P.kwargs) -> R:
        if _WAITING.get():
            return work(*args, **told)
        outermost = _WAITING.set(True)
        try:
            return _tried(lambda: work(*args, **told))
        finally:
            _WAITING.reset(outermost)

    return run


def waiting(kind: type[T]) -> type[T]:
    """A class whose public methods, looks and puts, are each made again where a server broke them off."""
    for name, method in list(vars(kind).items()):
        if isfunction(method) and not name.startswith("_"):
            setattr(kind, name, persistent(method))
    return kind


def _tried(work: Callable[[], R]) -> R:
    for number, pause in enumerate(PAUSES):
        try:
            return work()
        except Interrupted as error:
            if number == _SAID:
                text = f"{error.problem}: it is tried again for {sum(PAUSES):.0f} s"
                warnings.warn(text, Awaited, 3)
            time.sleep(pause)
    try:
        return work()
    except Interrupted as error:
        raise NoPlaceError(
            f"{error.problem}; it was tried again for {sum(PAUSES):.0f} s",
            expected=error.expected,
            do=f"{error.do}: what was stored stays",
        ) from error


def shown(url: URL) -> str:
    """An address as it may be printed: its query may hold more than anybody should see."""
    return url.set(drivername="postgresql", query={}).render_as_string(hide_password=True)


def explained(url: URL, error: Exception) -> RegistryError:
    """The meaning of an error of PostgreSQL (or of SQLAlchemy about one) for the catalogue at `url`, by its code.

    Only damage to what is stored is a CorruptError.
    """
    cause: Any = getattr(error, "orig", None) or error
    code = getattr(cause, "sqlstate", None) or _code_in(str(cause))
    what, told = f"the catalogue {shown(url)!r}", f"{_first_line(cause)} ({code or type(cause).__name__})"
    if code == "3D000":
        return NoPlaceError(
            f"there is no database {url.database!r} on the server of {what}",
            expected="a database that is there, an empty one for a new registry",
            do=f"make it with `createdb {url.database}`, or name another one",
        )
    if code.startswith(_LOCKED):
        return NoPlaceError(
            f"{what} stayed locked for {LOCK_SECONDS} s: {told}",
            expected="short transactions of other processes",
            do="wait for the other dynreg processes, or end the one that hangs",
        )
    if code.startswith(_RIGHTS):
        return NoPlaceError(
            f"{what} refuses this user: {told}",
            expected="a user who may read and write its tables, with the right password",
            do="set PGPASSWORD or mend ~/.pgpass, or have the rights granted, then run the same command again",
        )
    if code.startswith(_ROOM):
        return NoPlaceError(
            f"the server of {what} has no room, or its disk failed: {told}",
            expected="free connections, memory and disk on the server",
            do="look after the server, then run the same command again",
        )
    if code.startswith(_DAMAGED):
        return CorruptError(
            f"{what} is damaged: {told}",
            expected="the tables that dynreg made",
            do="restore it from a backup, or run `dynreg verify --repair` to write it again from the ledger",
        )
    if not code or code.startswith(_PASSING):
        return Interrupted(
            f"{what} cannot be reached, or broke off: {told}",
            expected="a PostgreSQL server that answers at this address",
            do="look after the server and the network, then run the same command again",
        )
    return NoPlaceError(
        f"PostgreSQL refused to work on {what}: {told}",
        expected="values of a usual size, and a server of version 12 or newer",
        do="run the same command again with --debug, and tell what it says",
    )


# A refused connection has no code, only the server's words.
_WORDS = {
    "authentication failed": "28P01",
    "no password supplied": "28P01",
    "no pg_hba.conf entry": "28000",
    "does not exist": "3D000",
    "permission denied for database": "42501",
    "too many": "53300",
    "not permitted to log in": "28000",
}


def _code_in(text: str) -> str:
    found = next((code for words, code in _WORDS.items() if words in text), "")
    return "28000" if found == "3D000" and "role " in text else found


def _first_line(cause: Exception) -> str:
    return next(iter(str(cause).strip().splitlines()), type(cause).__name__)
