"""`dynreg init`: a shared registry, and a folder here by which every command reaches it."""

from typing import Annotated

import typer

from dynreg.cli.call import Call


def init(
    call: Call,
    catalog: Annotated[
        str,
        typer.Option(
            "--catalog",
            metavar="URL",
            help="PostgreSQL database of the catalogue: postgresql://USER@HOST/DATABASE, without a password.",
        ),
    ],
    blobs: Annotated[
        str,
        typer.Option(
            "--blobs",
            metavar="URI",
            help="Bucket of the files: s3://BUCKET/PREFIX, without keys.",
        ),
    ],
    rebuild: Annotated[
        bool,
        typer.Option(
            "--rebuild",
            help="The bucket's catalogue is lost: write it anew from the bucket, into an empty database.",
        ),
    ] = False,
) -> None:
    """Share a registry on PostgreSQL and in a bucket.

    The registry's folder is made here, as a local face: every command works with it as with any other registry. The
    same command on another machine joins it. A registry in one folder needs no init.

    The password is read from PGPASSWORD or ~/.pgpass, keys of the bucket from AWS_ACCESS_KEY_ID and
    AWS_SECRET_ACCESS_KEY or ~/.aws.

    Example: dynreg init --registry lab --catalog postgresql://me@db.lab/robots --blobs s3://robots/registry
    """
    from dynreg import session

    with session.share(call.registry, catalog=catalog, blobs=blobs, rebuild=rebuild) as opened:
        result = opened.info()
    call.emit(result, hint="dynreg populate servo_pendulum -n 1000")
