"""`photosite serve`: the workbench in the browser."""

from __future__ import annotations

import signal
import webbrowser
from pathlib import Path

import click

from photosite.cli import options
from photosite.cli.command import Command
from photosite.cli.output import say, show
from photosite.errors import InputError


class _Server(Command):
    """A command that runs until it is stopped."""

    shows_time = False


@click.command("serve", cls=_Server)
@click.argument("folder", type=click.Path(path_type=Path), required=False)
@click.option(
    "--port", type=options.Whole(0, 65535), default=0, metavar="N", help="Port on 127.0.0.1; 0: any free one."
)
@click.option("--open", "opens", is_flag=True, help="Open the page in the default browser.")
@click.option(
    "--upload-limit",
    "upload_mb",
    type=options.Whole(1, 4096),
    default=256,
    metavar="MB",
    help="Size limit of an upload.",
)
@click.option(
    "--job-limit", "job_minutes", type=options.Whole(1), default=30, metavar="MIN", help="Time limit of a computation."
)
@options.json_option
def command(folder: Path | None, port: int, opens: bool, upload_mb: int, job_minutes: int, as_json: bool) -> None:
    """Serve the workbench, a page in the browser on this machine, until Ctrl-C.

    The page simulates cameras, calibrates folders, compares sensors, plans measurements and sweeps, with the functions
    of the commands. It can read scenes, sensor files, lenses and frames in FOLDER, and nothing else on the disk;
    without FOLDER, uploaded files only. The printed link holds the server's key: anyone with the link can use the
    server, and only from this machine. Nothing is sent anywhere.

    Needs the extra app: pip install '.[app]' in the clone.

    Example: photosite serve measurements --open
    """
    try:
        from photosite.app.server import Settings, serve
    except ModuleNotFoundError as error:
        if (error.name or "").split(".")[0] not in ("fastapi", "uvicorn", "starlette"):
            raise
        hint = "Run pip install '.[app]' in the clone"
        raise InputError(f"the package {error.name} is not installed", hint=hint) from None
    if folder is not None and not folder.is_dir():
        raise InputError("folder", value=str(folder), expected="an existing folder")

    def started(link: str) -> None:
        show(as_json, {"link": link, "folder": folder}, lambda: link)
        say("photosite: serving on this machine only; Ctrl-C ends the server")
        if opens:
            webbrowser.open(link)

    if hasattr(signal, "SIGHUP") and signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:
        # The event loop would print the exception by which other commands end; the server ends by itself at SIGTERM.
        signal.signal(signal.SIGHUP, lambda *_: signal.raise_signal(signal.SIGTERM))
    serve(Settings(folder=folder, upload_bytes=upload_mb << 20, job_s=60.0 * job_minutes), port, started)
