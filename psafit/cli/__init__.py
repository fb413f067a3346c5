"""The command line: thin, and lazy, since `psafit --help` must not wait for the numerical libraries."""

from __future__ import annotations

import io
import os
import sys

import click

import psafit
from psafit import plugins
from psafit.cli.catalogue import terms
from psafit.cli.challenges import challenge
from psafit.cli.common import BAD_INPUT, CHECK_FAILED, DONE, Group, discard_output, escaped
from psafit.cli.diagnosing import diagnose
from psafit.cli.fitting import check, fit, reproduce, validate
from psafit.cli.importing import import_files
from psafit.cli.reporting import report
from psafit.cli.rig import check_cause, new, plan
from psafit.cli.simulating import simulate
from psafit.cli.watching import watch
from psafit.errors import InputError, PsafitError
from psafit.files import remedy_of

# Our matrices are small: threads of the linear algebra library only wait for each other there. Read when it is loaded.
for _library in ("OPENBLAS", "MKL"):
    os.environ.setdefault(f"{_library}_NUM_THREADS", "1")


def main() -> None:
    """Run the command; turn what psafit raises on purpose into one line and an exit code."""
    os.environ["MPLBACKEND"] = "agg"  # no window is ever opened
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # a terminal may know fewer letters than a title has
            stream.reconfigure(errors="backslashreplace")
    try:
        code = commands.main(standalone_mode=False, prog_name="psafit")
        if sys.stdout is not None:  # nobody's, where it was closed
            sys.stdout.flush()  # a full disk is reported here, not at the interpreter's end
    except click.exceptions.NoArgsIsHelpError as error:
        click.echo(error.format_message())
        code = DONE
    except click.ClickException as error:
        where = _path(getattr(error, "ctx", None))
        message = " ".join(error.format_message().split())
        ended = f"{message} See" if message.endswith("?") else f"{message.rstrip('.')}; see"
        _say(f"{where}: {ended} {where} --help")
        code = BAD_INPUT
    except InputError as error:
        for line in str(error).split("\n"):
            _say(f"psafit: {line}")
        code = BAD_INPUT
    except PsafitError as error:
        _say(f"psafit: {error}")
        code = CHECK_FAILED
    except (KeyboardInterrupt, click.Abort):
        typed = "\n" if sys.stderr is not None and sys.stderr.isatty() else ""  # the terminal shows ^C
        click.echo(f"{typed}psafit: interrupted; repeat the same command, which goes on from what is done", err=True)
        code = BAD_INPUT
    except BrokenPipeError:  # at the last flush
        discard_output()
        code = DONE
    except MemoryError:
        _say("psafit: the memory of this machine does not suffice; close other programs, or give fewer --jobs")
        code = BAD_INPUT
    except Exception as error:
        if blamed := plugins.blamed(error):
            _say(f"psafit: {blamed}")
        elif isinstance(error, OSError):
            discard_output()
            where = f"{error.filename}: " if error.filename else ""
            _say(f"psafit: {where}{error.strerror or error}; {remedy_of(error)}")
        else:
            raise
        code = BAD_INPUT
    sys.exit(code if isinstance(code, int) else DONE)


def _path(context: click.Context | None) -> str:
    """The command as it is typed: ``psafit challenge make``."""
    names: list[str] = []
    while context is not None and context.parent is not None:
        names.insert(0, str(context.info_name))
        context = context.parent
    return " ".join(["psafit", *names])


def _say(message: str, longest: int = 300) -> None:
    """One line on standard error, without what would steer a terminal; of a word longer than any path, its ends."""
    words = (w if len(w) <= longest else f"{w[:100]}…{w[-40:]}" for w in escaped(message).split(" "))
    click.echo(" ".join(words), err=True)


@click.group(cls=Group, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(psafit.__version__, prog_name="psafit")
def commands() -> None:
    """Fit the simulation of a piezo stack that kicks a ball, and find what it gets wrong."""


_ALL = (
    check, fit, diagnose, validate, reproduce, terms, simulate, report, watch, challenge, check_cause, new,
    import_files, plan,
)  # fmt: skip
for _command in _ALL:
    commands.add_command(_command)
