"""Addresses of buckets, and what is said where one cannot be reached: never with a key in it."""

from typing import TYPE_CHECKING
from urllib.parse import parse_qsl, urlsplit

from dynreg.errors import CorruptError, NoPlaceError, RegistryError, UsageError

if TYPE_CHECKING:
    from pyarrow.fs import FileSystem

_SECRET = {"access_key", "secret_key", "session_token", "external_id"}
_OPTIONS = {"region", "scheme", "endpoint_override"}
_ATTEMPTS, _CONNECT_SECONDS, _REQUEST_SECONDS = 4, 5, 60


def reached(uri: str) -> tuple["FileSystem", str]:
    """The file system of an address, and the path in it; UsageError for an odd address, or one with a key in it."""
    from pyarrow.fs import AwsStandardS3RetryStrategy, FileSystem, S3FileSystem

    parts = urlsplit(uri)
    told = dict(parse_qsl(parts.query))
    if parts.username or parts.password or _SECRET & set(told):
        raise UsageError(
            "the address of the bucket holds a key, which would be stored in a file",
            expected="an address without it, such as s3://BUCKET/PREFIX",
            do="keep keys in AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY, or in ~/.aws",
        )
    odd = set(told) - _OPTIONS if parts.scheme == "s3" else set()
    if not parts.scheme or odd or (parts.scheme == "s3" and not parts.netloc):
        raise UsageError(
            f"{uri.partition('?')[0]!r} is no address of a bucket" + (f": {min(odd)!r}" if odd else ""),
            expected=f"s3://BUCKET/PREFIX, with {', '.join(sorted(_OPTIONS))} behind a '?' where they are needed",
            do="give another address",
        )
    if parts.scheme != "s3":
        try:
            return FileSystem.from_uri(uri)
        except (OSError, ValueError) as error:
            raise UsageError(
                f"{uri.partition('?')[0]!r} cannot be opened: {_brief(str(error))}",
                expected="s3://BUCKET/PREFIX",
                do="give an address that pyarrow.fs reaches",
            ) from error
    retries = AwsStandardS3RetryStrategy(max_attempts=_ATTEMPTS)
    limits = {"connect_timeout": _CONNECT_SECONDS, "request_timeout": _REQUEST_SECONDS}
    how = {"background_writes": False, "allow_delayed_open": True}  # a small object goes in one request
    files = S3FileSystem(**told, **limits, **how, retry_strategy=retries)
    return files, f"{parts.netloc}{parts.path}".rstrip("/")


def explained(uri: str, name: str, error: OSError) -> RegistryError:
    """The meaning of what pyarrow says of a bucket; never with a key or a secret in it."""
    text, what = str(error), f"the bucket {uri.partition('?')[0]!r}"
    code = next((word for word in _CODES if word in text.upper()), "")
    if code == "NO_SUCH_BUCKET":
        return absent(uri)
    if code in _RIGHTS:
        return NoPlaceError(
            f"{what} refuses{f' {name!r}' if name else ''}: {code}",
            expected="keys with the right to list, read, write and delete below this prefix",
            do="set AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY (or AWS_PROFILE), or mend the bucket's policy",
        )
    return NoPlaceError(
        f"{what} cannot be reached{f', or {name!r} in it' if name else ''}: {_brief(text)}",
        expected="a bucket that answers at this address",
        do="look after the network, the region and the address, then run the same command again",
    )


_RIGHTS = (
    "ACCESS_DENIED",
    "INVALID_ACCESS_KEY_ID",
    "SIGNATURE_DOES_NOT_MATCH",
    "INVALID_CLIENT_TOKEN_ID",
    "EXPIRED_TOKEN",
    "HTTP STATUS 403",
)
_CODES = ("NO_SUCH_BUCKET", *_RIGHTS)


def lost(file: object, error: Exception | str) -> CorruptError:
    """The error for an object that is gone, or not the one that was registered."""
    told = "No such file or directory" if isinstance(error, FileNotFoundError) else str(error)
    return CorruptError(
        f"{str(file)!r} cannot be read: {told}",
        expected="the file as it was registered",
        do="run `dynreg verify --repair` to see what is lost and what can be rebuilt",
    )


def absent(uri: str) -> NoPlaceError:
    """The error for a bucket that is not there."""
    return NoPlaceError(
        f"there is no bucket at {uri.partition('?')[0]!r}",
        expected="a bucket that is there; dynreg makes none",
        do="make it, or name another one",
    )


def _brief(text: str) -> str:
    """What an error of pyarrow's says, without the request that it repeats."""
    return text.replace("When ", "").partition(" Detail:")[0][:200]
